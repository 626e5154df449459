"""Turn real flights of a toy quadcopter, whose author corrected its mass by them, into .tlog and a vehicle file.

``python tests/benchmarks/mambo_logs.py CLONE OUT``: CLONE is a clone of
github.com/David-davidlxl/modeling-controlling-and-flight-testing-of-a-small-quadcopter, of which four recordings
(RSdata.mat) of commit fb94ca0 are read; they stay the author's. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/mambo.toml --data OUT

Attitude, position, velocity and rates are the vehicle's own estimate; the specific force is its accelerometer less the
offset that the recording holds beside it. All are means of two samples of 200 Hz. Outputs are the motor commands.
"""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, throttle, vehicle_toml, write_tlog
from scipy.io import loadmat
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "fb94ca0012a7e0171ee8f0cd78d8b466bc613cc5"
PATH = "Simulink models/asbQuadcopterRealFlight (version {})/RSdata.mat"
VERSIONS = (1, 2, 3, 4)
GRAVITY, CLEAR_M, EVERY = 9.80665, 0.3, 2
FULL_COMMAND = 500.0
# tasks/vehicleVars.m: mass before the correction; thrust is linear in the command.
MASS_KG, INERTIA = 0.063, (5.82857e-5, 7.16914e-5, 1.0e-4)
ARM_M, HEIGHT_M, RADIUS_M = 0.0624 * 0.5**0.5, -0.015876, 0.033
CT, COMMAND_TO_SPEED2, DENSITY = 0.0107, 13840.8, 1.225
PLACES = ((1, -1, "cw"), (1, 1, "ccw"), (-1, 1, "cw"), (-1, -1, "ccw"))
"""Forward, right, spin: by the author's mixer, and as the rates answer the commands."""


def main() -> int:
    clone, out = clone_and_out(__doc__)
    for version in VERSIONS:
        write_tlog(
            out / f"mambo_{version}.tlog",
            _motion(git(clone, "show", f"{COMMIT}:{PATH.format(version)}")),
        )
    (out / "mambo.toml").write_text(vehicle_toml(_vehicle()), encoding="utf-8")
    print(f"{len(VERSIONS)} logs and mambo.toml in {out}")
    return 0


def _motion(data: bytes) -> Motion:
    file = loadmat(io.BytesIO(data), squeeze_me=True, struct_as_record=False)
    estimate, sensed, command = (_rows(file, f"rt_{name}") for name in ("estim", "sensor", "motor"))
    high = np.flatnonzero(estimate[:, 2] < -CLEAR_M)
    kept = slice(high[0], high[-1] + 1)
    state, felt, motors = (_means(x[kept]) for x in (estimate, sensed[:, :3], command))
    at_rest = _rows(file, "rt_calib")[0, :3]
    return Motion(
        time_s=_means(file["rt_estim"].time[kept, None])[:, 0],
        position=state[:, :3],
        velocity=state[:, 6:9],
        quaternion=np.roll(Rotation.from_euler("ZYX", state[:, 3:6]).as_quat(), 1, axis=1),
        rates=state[:, 9:12],
        force=felt - at_rest - (0.0, 0.0, GRAVITY),
        outputs_us=1000.0 + 1000.0 * np.abs(motors) / FULL_COMMAND,
    )


def _rows(file: dict[str, Any], name: str) -> Array:
    """Values (n, columns) of a recorded signal."""
    return np.asarray(file[name].signals.values, dtype=float)


def _means(x: Array) -> Array:
    """Means (n / 2, columns) of two samples each."""
    return x[: len(x) // EVERY * EVERY].reshape(-1, EVERY, x.shape[1]).mean(axis=1)


def _vehicle() -> dict[str, Any]:
    fans = [
        {
            "position_m": [x * ARM_M, y * ARM_M, HEIGHT_M],
            "lip_radius_m": RADIUS_M,
            "rotors": [{"servo": k, "spin": spin}],
        }
        for k, (x, y, spin) in enumerate(PLACES, 1)
    ]
    most = CT * DENSITY * np.pi * RADIUS_M**4 * COMMAND_TO_SPEED2 * FULL_COMMAND
    return {
        "name": "mambo",
        "mass_kg": MASS_KG,
        "inertia_kgm2": INERTIA,
        "hover_thrust": 0.61,
        "rotor_radius_m": RADIUS_M,
        "fan": fans,
        "throttle": throttle(round(float(most), 4), expo=0.0, voltage_v=3.95),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
