"""Flights of a hexarotor of 12 kg.

A clone of github.com/DevangPatwardhan/Wind-Estimation-Disturbance-Observer, of which three recordings of commit d6fa484
are read.

Attitude, rates, velocity (north-east-down), position and rotor speeds are recorded at 10 Hz. There is no accelerometer:
the specific force is the derivative of the velocity. In two recordings angles are in degrees, the third position is
the altitude, and the horizontal position counts against the velocity. An output is a rotor speed as a share of
FULL_RAD_S, so thrust is its square.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from models.common.frames import GRAVITY
from sources.clone import read
from sources.motion import Motion, span, specific_force
from sources.table_text import Rows, columns, rows_of
from sources.vehicle_file import fans, throttle, vehicle

COMMIT = "d6fa484897dfc0b99e9436db3c2a509faeb10897"
# RunMeFirst.m
MASS_KG = 12.0
INERTIA = (0.643, 0.682, 0.832)
ARM_M = 0.6
RADIUS_M = 0.2286
FULL_RAD_S = 700.0
TURNING_RAD_S = 200.0
SPEEDS = "u1 u2 u3 u4 u5 u6"


@dataclass(frozen=True)
class Recording:
    """One file, and whether its angles are degrees and its places are up."""

    name: str
    path: str
    degrees: bool


RECORDINGS = (
    Recording("hexarotor_line", "Data/Data2025-12-13 16-36-44.csv", degrees=False),
    Recording("hexarotor_hover", "Data/hover.csv", degrees=True),
    Recording("hexarotor_descent", "Data/climb.csv", degrees=True),
)


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for recording in RECORDINGS:
        text = read(clone, COMMIT, recording.path).decode()
        yield recording.name, motion_of(rows_of(text), recording.degrees)


def motion_of(rows: Rows, degrees: bool) -> Motion:
    """From the first to the last moment when all rotors turn."""
    speeds = columns(rows, SPEEDS)
    flown = rows[span(speeds.min(axis=1) > TURNING_RAD_S)]
    time = columns(flown, "t")
    velocity = columns(flown, "u v w")
    attitude = Rotation.from_euler("ZYX", columns(flown, "psi theta phi"), degrees=degrees)
    rates = columns(flown, "p q r")
    place = columns(flown, "x y z")
    return Motion(
        time_s=time,
        position=-place if degrees else place,
        velocity=velocity,
        attitude=attitude,
        rates=np.radians(rates) if degrees else rates,
        force=specific_force(attitude, np.gradient(velocity, time, axis=0)),
        outputs_us=1000.0 + 1000.0 * columns(flown, SPEEDS) / FULL_RAD_S,
    )


def place_of(k: int) -> tuple[float, float, str]:
    """Of the author's model: every 60 degrees from the front [m]."""
    angle = np.radians(60.0 * k)
    forward = round(ARM_M * float(np.cos(angle)), 4)
    right = round(ARM_M * float(np.sin(angle)), 4)
    return forward, right, "cw" if k % 2 else "ccw"


def with_thrust(per_speed2: float) -> dict[str, Any]:
    """The vehicle: N s2, as the flight's own level flight needs it at 12 kg."""
    full_n = per_speed2 * FULL_RAD_S**2
    share = MASS_KG * GRAVITY / 6.0 / full_n
    return vehicle(
        name="hexarotor of 12 kg",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=round(share**0.5, 3),
        radius_m=RADIUS_M,
        fan=fans(map(place_of, range(6)), 1.0, RADIUS_M),
        throttle=throttle(full_n, expo=1.0, voltage_v=44.4),
    )


VEHICLES = {
    "hexarotor_line": with_thrust(1.833e-4),
    "hexarotor_hover": with_thrust(1.225e-4),
}
"""The second is that of the hover and, below 300 m, of the descent."""
