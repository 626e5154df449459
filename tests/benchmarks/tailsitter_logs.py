"""Turn real flights of a tail-sitter with four rotors into .tlog and a vehicle file.

``python tests/benchmarks/tailsitter_logs.py CLONE OUT``: CLONE is a clone of
github.com/RockyJBL/Tailsitter-hovering-dataset, of which six flights of commit 5bba36f are read. They stay their
authors'.
Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/tailsitter.toml --data OUT

Position, velocity and attitude are those of motion capture at 100 Hz, smoothed by the authors. Outputs are pulses of
the four motors. Pulses of the two elevons stand in the logs as outputs 5 and 6. There is no accelerometer and no
voltage: the specific force is the derivative of the velocity, rates are those of the attitude.
"""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, fans, throttle, vehicle_toml, write_tlog
from scipy.io import loadmat
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "5bba36f3a1690d4e5f0a95e1bc4a14638f6595b4"
SETUPS = (
    "step_size1",
    "step_size2",
    "step_size3",
    "manual_position",
    "manual_altitude",
    "manual_stabilized",
)
REPEAT = 3
"""Of the three repeats of each setup."""
RATE_HZ, GRAVITY = 100.0, 9.80665
MASS_KG = 0.83
ARM_M, RADIUS_M, INERTIA = 0.16, 0.0635, (0.012, 0.006, 0.016)
"""Guesses, from the picture and the motors; no moment is judged."""
MAX_THRUST_N = 7.44
"""What the six flights need together where thrust is in proportion to the pulse."""
PLACES = ((1, 1, "ccw"), (-1, -1, "ccw"), (1, -1, "cw"), (-1, 1, "cw"))
"""Belly, right and spin of the motors in the order of the autopilot."""


def main() -> int:
    clone, out = clone_and_out(__doc__)
    for setup in SETUPS:
        name = f"{setup}_{REPEAT}"
        data = git(clone, "show", f"{COMMIT}:dataset/{name}.mat")
        write_tlog(out / f"{name}.tlog", _motion(loadmat(io.BytesIO(data), squeeze_me=True)))
    text = vehicle_toml(_vehicle())
    (out / "tailsitter.toml").write_text(text, encoding="utf-8")
    print(f"{len(SETUPS)} logs and tailsitter.toml in {out}")
    return 0


def _motion(columns: dict[str, Array]) -> Motion:
    """The world is east-north-up, the body forward-left-up; yaw is small in all flights."""
    flip = np.array([1.0, -1.0, -1.0])
    attitude = Rotation.from_euler("ZYX", (columns["vision_attitude"] * flip)[:, ::-1])
    velocity = columns["vision_velocity"] * flip
    acceleration = np.gradient(velocity, 1.0 / RATE_HZ, axis=0)
    return Motion(
        time_s=columns["time"],
        position=columns["vision_position"] * flip,
        velocity=velocity,
        quaternion=np.roll(attitude.as_quat(), 1, axis=1),
        rates=_rates(attitude),
        force=attitude.inv().apply(acceleration - (0.0, 0.0, GRAVITY)),
        outputs_us=columns["actuator_outputs"],
    )


def _rates(attitude: Rotation) -> Array:
    """Angular rate (n, 3) in the body frame: the turn from the sample before to the one after."""
    turn = (attitude[:-2].inv() * attitude[2:]).as_rotvec()
    return np.pad(turn * RATE_HZ / 2.0, ((1, 1), (0, 0)), mode="edge")


def _vehicle() -> dict[str, Any]:
    return {
        "name": "tail-sitter",
        "mass_kg": MASS_KG,
        "inertia_kgm2": INERTIA,
        "hover_thrust": 0.27,
        "rotor_radius_m": RADIUS_M,
        "fan": fans(PLACES, ARM_M, RADIUS_M),
        "throttle": throttle(MAX_THRUST_N, expo=0.0, voltage_v=11.1),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
