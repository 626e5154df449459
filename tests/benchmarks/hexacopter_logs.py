"""Turn real flights of a hexacopter into .tlog and a vehicle file, to judge diagnosis on another new source.

``python tests/benchmarks/hexacopter_logs.py CLONE OUT``: CLONE is a clone of github.com/wuwushrek/sde4mbrl, of which
the training flights of commit f4f34bf are read (a pickle of numpy arrays; nothing else in it is built). Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/hexacopter.toml --data OUT

States are those of the autopilot (PX4) as the authors keep them: east-north-up, forward-left-up. The six motor commands
are averaged by the authors over 40 samples. There is no time: one sample is 10.5 ms by rates against attitude and by
velocity against position. There is no accelerometer: the specific force is the derivative of the velocity, averaged as
the commands are.
"""

from __future__ import annotations

import io
import pickle
import sys
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, fans, throttle, vehicle_toml, write_tlog
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "f4f34bfd4c05d0562bd546b0839622d5d2470183"
FLIGHTS = "sde4mbrlExamples/rotor_uav/hexa_ahg/my_data/trajs.pkl"
STEP_S, AVERAGE, GRAVITY = 0.0105, 40, 9.80665
MASS_KG, INERTIA = 2.295, [0.008, 0.008, 0.011]
"""The authors' prior (prior_hexa.yaml)."""
ARM_M, RADIUS_M = 0.275, 0.127
"""Guesses: a frame of 550 mm with propellers of ten inches."""
MAX_THRUST_N = 11.3
"""As the three flights need it together; over them thrust goes with the command to the power of 0.95: linear."""
PLACES = ((0.0, 1.0, "cw"), (0.0, -1.0, "ccw"), (0.866, -0.5, "cw"), (-0.866, 0.5, "ccw"), (0.866, 0.5, "ccw"),
          (-0.866, -0.5, "cw"))  # fmt: skip
"""Forward, right and spin of the six motors: PX4's hexarotor x, which the authors' mixer agrees with."""


def main() -> int:
    clone, out = clone_and_out(__doc__)
    flights = _Arrays(io.BytesIO(git(clone, "show", f"{COMMIT}:{FLIGHTS}"))).load()["train"]
    for k, (states, commands) in enumerate(flights, 1):
        motion = _motion(np.asarray(states, float), np.asarray(commands, float))
        write_tlog(out / f"hexacopter_{k}.tlog", motion)
    (out / "hexacopter.toml").write_text(vehicle_toml(_vehicle()), encoding="utf-8")
    print(f"{len(flights)} logs and hexacopter.toml in {out}")
    return 0


class _Arrays(pickle.Unpickler):
    """Reads numpy arrays and refuses everything else."""

    def find_class(self, module: str, name: str) -> Any:
        if (module.removesuffix(".core.multiarray"), name) not in {
            ("numpy", "_reconstruct"), ("numpy", "ndarray"), ("numpy", "dtype")
        }:  # fmt: skip
            raise pickle.UnpicklingError(f"{FLIGHTS} holds {module}.{name}, not only arrays")
        return super().find_class(module.replace("numpy.core", "numpy._core"), name)


def _motion(states: Array, commands: Array) -> Motion:
    """``states`` (n, 13): position, velocity, quaternion w first, rates; ``commands`` (n, 6), 0 to 1."""
    position, velocity, wxyz, rates = np.split(states, (3, 6, 10), axis=1)
    # East-north-up to north-east-down, and forward-left-up to forward-right-down.
    world = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    body = Rotation.from_euler("x", 180, degrees=True)
    attitude = world * Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]) * body
    speed = world.apply(velocity)
    force = np.gradient(speed, STEP_S, axis=0) - (0.0, 0.0, GRAVITY)
    inner = slice(AVERAGE, len(states) - AVERAGE)
    return Motion(
        time_s=np.arange(len(states))[inner] * STEP_S,
        position=world.apply(position)[inner],
        velocity=speed[inner],
        quaternion=np.roll(attitude.as_quat(), 1, axis=1)[inner],
        rates=body.apply(rates)[inner],
        force=_average(attitude.inv().apply(force))[inner],
        outputs_us=1000.0 + 1000.0 * commands[inner],
    )


def _average(x: Array) -> Array:
    """Mean (n, 3) over 40 samples, placed as the authors place it."""
    kernel = np.ones(AVERAGE) / AVERAGE
    return np.stack([np.convolve(column, kernel, mode="same") for column in x.T], axis=1)


def _vehicle() -> dict[str, Any]:
    return {
        "name": "hexacopter",
        "mass_kg": MASS_KG,
        "inertia_kgm2": INERTIA,
        "hover_thrust": 0.33,
        "rotor_radius_m": RADIUS_M,
        "fan": fans(PLACES, ARM_M, RADIUS_M),
        "throttle": throttle(MAX_THRUST_N, expo=0.0, voltage_v=14.8),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
