"""Flights of a racing quadrotor in motion capture (NeuroBEM).

A clone of github.com/RCL-NUS/NeuroMHE, which holds test flights of the NeuroBEM data set (Bauersfeld et al., RSS 2021,
arXiv:2106.08015). The six files below 4 MB of commit 64e184c are read.

Pose, velocity, specific force and rotor speeds are the authors' own, filtered, at 400 Hz; means of four samples are
written. An output is a rotor speed as a share of FULL_RAD_S, so thrust is its square.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from sources.clone import read
from sources.motion import FLIP, Array, Motion, means
from sources.vehicle_file import fans, throttle, vehicle

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
TIME = 0
RATES = slice(4, 7)
QUATERNION = slice(7, 11)
FORCE = slice(11, 14)
VELOCITY = slice(14, 17)
POSITION = slice(17, 20)
SPEEDS = slice(20, 24)
"""Columns: body forward-left-up, velocity in the body, quaternion x first, rotor speeds in rad/s."""
EVERY = 4
MASS_KG = 0.772
INERTIA = (0.0025, 0.0021, 0.0043)
"""The authors' later mass; 0.752 kg in the paper."""
THRUST_PER_SPEED2 = 1.504e-6
"""In N s2, as the first flight's hover needs it."""
FULL_RAD_S = 2500.0
FORWARD_M = 0.075
RIGHT_M = 0.1
RADIUS_M = 0.0648
"""Guesses of the arms; the radius is that of 5.1 inches."""
PLACES = (
    (-1, 1, "cw"),
    (1, 1, "ccw"),
    (-1, -1, "ccw"),
    (1, -1, "cw"),
)
"""Forward, right, spin, as the rates answer the rotor speeds."""
IN_METRES = [(x * FORWARD_M, y * RIGHT_M, spin) for x, y, spin in PLACES]
VEHICLES = {
    "neurobem": vehicle(
        name="racing quadrotor",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=0.45,
        radius_m=RADIUS_M,
        fan=fans(IN_METRES, 1.0, RADIUS_M),
        throttle=throttle(THRUST_PER_SPEED2 * FULL_RAD_S**2, expo=1.0, voltage_v=16.0),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for name in FLIGHTS:
        yield name, motion_of(means(rows_of(clone, name), EVERY))


def rows_of(clone: Path, name: str) -> Array:
    """Samples (n, columns) of a flight."""
    data = read(clone, COMMIT, f"{FOLDER}/bemnn{name}.mat")
    return np.asarray(loadmat(io.BytesIO(data))[f"bemnn{name}"], float)


def motion_of(rows: Array) -> Motion:
    pose = Rotation.from_quat(rows[:, QUATERNION])
    turn = Rotation.from_euler("x", 180, degrees=True)
    return Motion(
        time_s=rows[:, TIME],
        position=FLIP * rows[:, POSITION],
        velocity=FLIP * pose.apply(rows[:, VELOCITY]),
        attitude=turn * pose * turn,
        rates=FLIP * rows[:, RATES],
        force=FLIP * rows[:, FORCE],
        outputs_us=1000.0 + 1000.0 * rows[:, SPEEDS] / FULL_RAD_S,
    )
