"""Turn real flights of a racing quadrotor in motion capture (NeuroBEM) into .tlog and a vehicle file.

``python tests/benchmarks/neurobem_logs.py CLONE OUT``: CLONE is a clone of github.com/RCL-NUS/NeuroMHE, which holds
test flights of the NeuroBEM data set (Bauersfeld et al., RSS 2021, arXiv:2106.08015); they stay their authors'. The
six files below 4 MB of commit 64e184c are read. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/neurobem.toml --data OUT

Pose, velocity, specific force and rotor speeds are the authors' own, filtered, at 400 Hz; means of four samples are
written. An output is a rotor speed as a share of FULL_RAD_S, so thrust is its square.
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

COMMIT = "64e184c00d536b57c4e2a678488d28c09ecef418"
FOLDER = "SecVII-A (source code)/Check_RMSE/MATLAB_code_for_mass_verification"
FLIGHTS = (
    "20210218170320seg2",
    "20210218171908seg2",
    "20210218172600seg1",
    "20210223104803seg2",
    "20210223114138seg3",
    "20210223172724seg2",
)
TIME, RATES, QUATERNION = 0, slice(4, 7), slice(7, 11)
FORCE, VELOCITY, POSITION = slice(11, 14), slice(14, 17), slice(17, 20)
SPEEDS = slice(20, 24)
"""Columns: body forward-left-up, velocity in the body, quaternion x first, rotor speeds in rad/s."""
EVERY = 4
MASS_KG, INERTIA = 0.772, (0.0025, 0.0021, 0.0043)
"""The authors' later mass; 0.752 kg in the paper."""
THRUST_PER_SPEED2 = 1.504e-6
"""In N s2, as the first flight's hover needs it."""
FULL_RAD_S = 2500.0
FORWARD_M, RIGHT_M, RADIUS_M = 0.075, 0.1, 0.0648
"""Guesses of the arms; the radius is that of 5.1 inches."""
PLACES = (
    (-1, 1, "cw"),
    (1, 1, "ccw"),
    (-1, -1, "ccw"),
    (1, -1, "cw"),
)
"""Forward, right, spin, as the rates answer the rotor speeds."""
FLIP = np.array([1.0, -1.0, -1.0])
"""Left and up to right and down."""


def main() -> int:
    clone, out = clone_and_out(__doc__)
    for name in FLIGHTS:
        data = git(clone, "show", f"{COMMIT}:{FOLDER}/bemnn{name}.mat")
        rows = np.asarray(loadmat(io.BytesIO(data))[f"bemnn{name}"], float)
        write_tlog(out / f"{name}.tlog", _motion(_means(rows)))
    vehicle = vehicle_toml(_vehicle())
    (out / "neurobem.toml").write_text(vehicle, encoding="utf-8")
    print(f"{len(FLIGHTS)} logs and neurobem.toml in {out}")
    return 0


def _means(rows: Array) -> Array:
    """Means (n / 4, columns) of four samples each."""
    count = len(rows) // EVERY
    whole = rows[: count * EVERY]
    means: Array = whole.reshape(count, EVERY, -1).mean(axis=1)
    return means


def _motion(rows: Array) -> Motion:
    pose = Rotation.from_quat(rows[:, QUATERNION])
    turn = Rotation.from_euler("x", 180, degrees=True)
    attitude = turn * pose * turn
    speeds = rows[:, SPEEDS] / FULL_RAD_S
    return Motion(
        time_s=rows[:, TIME],
        position=FLIP * rows[:, POSITION],
        velocity=FLIP * pose.apply(rows[:, VELOCITY]),
        quaternion=np.roll(attitude.as_quat(), 1, axis=1),
        rates=FLIP * rows[:, RATES],
        force=FLIP * rows[:, FORCE],
        outputs_us=1000.0 + 1000.0 * speeds,
    )


def _vehicle() -> dict[str, Any]:
    fans = [
        {
            "position_m": [x * FORWARD_M, y * RIGHT_M, 0.0],
            "lip_radius_m": RADIUS_M,
            "rotors": [{"servo": k, "spin": spin}],
        }
        for k, (x, y, spin) in enumerate(PLACES, 1)
    ]
    full_n = THRUST_PER_SPEED2 * FULL_RAD_S**2
    return {
        "name": "racing quadrotor",
        "mass_kg": MASS_KG,
        "inertia_kgm2": list(INERTIA),
        "hover_thrust": 0.45,
        "rotor_radius_m": RADIUS_M,
        "fan": fans,
        "throttle": throttle(full_n, expo=1.0, voltage_v=16.0),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
