"""Flights of hobby quadcopters that a computer on the ground flies by their video.

A clone of github.com/Mitchell-Torok/Adaptive-Quadcopter-MPC-Using-Remote-Monocular-Vision, of which six recordings of
commit 0e08929 are read.

Position, velocity and attitude are those of motion capture where it was on, and else the authors' filter on the video,
both at 15 Hz. Outputs are four copies of the throttle that the controller asks for, so that no moment can be judged.
There is no accelerometer and no voltage: the specific force is the derivative of the velocity over three samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from sources.clone import read
from sources.motion import FLIP, Array, Motion, at, smoothed, span, specific_force, turn_rates
from sources.table_text import Rows, columns, rows_of
from sources.vehicle_file import fans, throttle, vehicle

COMMIT = "0e0892994431d880fdf0ceaf39208c3b7af12e75"
FOLDER = "logs/ExperimentDataSets"
CAPTURED = "mot_pose"
SEEN = "ukf_pose"
LOGS = {
    "cinewhoop_18": ("Cinewhoop/18", CAPTURED),
    "cinewhoop_24": ("Cinewhoop/24", CAPTURED),
    "cinewhoop_28": ("Cinewhoop/28", CAPTURED),
    "cinewhoop_32": ("Cinewhoop/32", CAPTURED),
    "whoop_circle": ("TinyWhoop/circle_1", SEEN),
    "freestyle_circle": ("Freestyle/circle_1", SEEN),
}
"""Name: folder, and the columns of the motion."""
RATE_HZ = 15.0
SMOOTHED = 3
CLEAR_M = 0.5
PLACES = (
    (1, 1, "ccw"),
    (-1, 1, "cw"),
    (-1, -1, "ccw"),
    (1, -1, "cw"),
)


def _vehicle(
    name: str, mass_kg: float, arm_m: float, radius_m: float, gain: float
) -> dict[str, object]:
    """A vehicle that full throttle accelerates by ``gain`` [m/s2]; all but the gain is a guess."""
    weight_arm = mass_kg * arm_m**2
    return vehicle(
        name=name,
        mass_kg=mass_kg,
        inertia=(weight_arm, weight_arm, 1.8 * weight_arm),
        hover_thrust=round(9.81 / gain, 3),
        radius_m=radius_m,
        fan=fans(PLACES, arm_m, radius_m),
        throttle=throttle(round(mass_kg * gain / 4.0, 4), expo=0.0, voltage_v=14.8),
    )


VEHICLES = {
    "cinewhoop_18": _vehicle("cinewhoop", 0.35, 0.06, 0.038, 18.0),
    "cinewhoop_24": _vehicle("cinewhoop", 0.35, 0.06, 0.038, 24.0),
    "cinewhoop_28": _vehicle("cinewhoop", 0.35, 0.06, 0.038, 28.0),
    "cinewhoop_32": _vehicle("cinewhoop", 0.35, 0.06, 0.038, 32.0),
    "whoop": _vehicle("whoop", 0.03, 0.025, 0.016, 22.0),
    "freestyle": _vehicle("freestyle", 0.6, 0.08, 0.0635, 38.5),
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for name, (folder, motion) in LOGS.items():
        text = read(clone, COMMIT, f"{FOLDER}/{folder}/log.csv").decode()
        yield name, motion_of(rows_of(text), motion)


def motion_of(rows: Rows, motion: str) -> Motion:
    """The flight from the first sample above ``CLEAR_M`` to the last. The world is north-west-up."""
    clock = columns(rows, "timestamp")
    time = np.arange(clock[0], clock[-1], 1.0 / RATE_HZ)

    def three(names: str) -> Array:
        wanted = " ".join(f"{motion}_{name}" for name in names.split())
        return FLIP * at(time, clock, columns(rows, wanted))

    turns = columns(rows, " ".join(f"{motion}_{name}" for name in ("qx", "qy", "qz", "qw")))
    attitude = Slerp(clock, Rotation.from_quat(turns * [*FLIP, 1.0]))(time)
    position = three("x y z")
    velocity = three("vx vy vz")
    acceleration = np.gradient(smoothed(velocity, SMOOTHED), 1.0 / RATE_HZ, axis=0)
    command = np.interp(time, clock, columns(rows, "u2")).clip(0.0, 1.0)
    whole = Motion(
        time_s=time,
        position=position,
        velocity=velocity,
        attitude=attitude,
        rates=turn_rates(attitude, RATE_HZ),
        force=specific_force(attitude, acceleration),
        outputs_us=np.tile((1000.0 + 1000.0 * command)[:, None], 4),
    )
    return whole[span(position[:, 2] < -CLEAR_M)]
