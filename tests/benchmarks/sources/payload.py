"""Flights of a nano quadcopter, with a load on a cord or larger propellers.

A clone of github.com/IMRCLab/crazyswarm2-tools, of which twenty logs of commit 847605a are read (format of the
Crazyflie's memory card, which a log describes itself).

Position, velocity, attitude and rates are the estimator's. The accelerometer is real in the flights with a load. The
others have none; there the specific force is the derivative of the velocity over nine samples. All are logged at 250 Hz
and written at 125 Hz. Outputs are the forces that the controller asks of the four motors, by the firmware's
distribution of thrust and torque.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from models.common.frames import GRAVITY
from sources.clone import read
from sources.motion import FLIP, Array, Motion, averaged, span, specific_force
from sources.vehicle_file import CRAZYFLIE_PLACES, fans, throttle, vehicle

COMMIT = "847605ab2d2d7ed5040ab0c7d2c7116c047b4de5"
LOADED = (182, 183, 184, 201, 202, 203, 204, 205, 206)
PROPELLERS = ("08", 12, 16, 20, 24, 28, 32, 36, 40, 44, 48)
"""Every fourth of the flights with larger motors and propellers that are long enough to be judged."""
EVERY = 2
SMOOTHED = 9
MASS_KG = 0.032
INERTIA = (16.6e-6, 16.6e-6, 29.3e-6)
"""Mass of the vehicle alone by the authors' model_payload.py; inertia of the firmware."""
ARM_M = 0.046 * 0.5**0.5
RADIUS_M = 0.0225
TORQUE_M = 0.005964552
"""By the firmware: arm along an axis, and torque over thrust."""
FULL_N = 0.25
"""Force of one motor that is written as full output; no command reaches it."""
MIXER = np.array(
    [
        [-1, -1, -1],
        [-1, +1, +1],
        [+1, +1, -1],
        [+1, -1, +1],
    ]
)
"""What a roll, a pitch and a yaw add to each motor."""


def named(name: str, mass_kg: float, level: float) -> dict[str, Any]:
    """A vehicle file; ``level``: thrust over commanded thrust."""
    return vehicle(
        name=name,
        mass_kg=mass_kg,
        inertia=INERTIA,
        hover_thrust=0.35,
        radius_m=RADIUS_M,
        fan=fans(CRAZYFLIE_PLACES, ARM_M, RADIUS_M),
        throttle=throttle(FULL_N * level, expo=0.0, voltage_v=3.7),
    )


VEHICLES = {
    "payload_1": named("payload_1", MASS_KG, level=0.768),
    "payload_2": named("payload_2", MASS_KG, level=0.911),
    "propellers": named("propellers", 0.037, level=1.055),
}
"""With the load of 5 g flights 184 and 201 are in balance; standard motors and propellers of the thirty flights before
need 1.055."""


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for kind, numbers in (("payload", LOADED), ("propellers", PROPELLERS)):
        for number in numbers:
            data = read(clone, COMMIT, f"logs/log{number}")
            yield f"{kind}_{number}", motion_of(columns_of(data))


def columns_of(data: bytes) -> dict[str, Array]:
    """Columns of the one kind of record in a log: names with types, then rows of an id, a time and values."""
    end = data.index(b"\0", 7)
    (count,) = struct.unpack_from("<H", data, end + 1)
    place = end + 3
    kinds = []
    for _ in range(count):
        stop = data.index(b"\0", place)
        name, kind = data[place:stop].decode()[:-1].split("(")
        kinds.append((name, f"<{kind.replace('h', 'i2').replace('f', 'f4')}"))
        place = stop + 1
    # An event's time is in milliseconds as a whole number of version 1, in microseconds of version 2.
    (version,) = struct.unpack_from("<H", data, 1)
    clock, per_s = ("<u4", 1e3) if version == 1 else ("<u8", 1e6)
    row = np.dtype([("id", "<u2"), ("time", clock), *kinds])
    rows = np.frombuffer(data, row, (len(data) - 4 - place) // row.itemsize, place)
    columns = {name: rows[name].astype(float) for name in row.names or ()}
    return columns | {"time": rows["time"] / per_s}


def motion_of(columns: dict[str, Array]) -> Motion:
    """The world is north-west-up, the body forward-left-up."""

    def three(name: str) -> Array:
        return np.stack([columns[f"{name}{axis}"] for axis in "xyz"], axis=1)

    attitude = Rotation.from_euler("ZYX", (FLIP * three("ctrlLee.rpy"))[:, ::-1])
    thrust = columns["ctrlLee.thrustSI" if "ctrlLee.thrustSI" in columns else "ctrlLee.thrustSi"]
    turns = three("ctrlLee.torque") / (4.0 * ARM_M, 4.0 * ARM_M, 4.0 * TORQUE_M)
    motors = thrust[:, None] / 4.0 + turns @ MIXER.T
    velocity = FLIP * three("stateEstimateZ.v") / 1e3
    if "acc.x" in columns:
        force = FLIP * three("acc.") * GRAVITY
    else:
        slope = np.gradient(velocity, columns["time"], axis=0)
        force = specific_force(attitude, averaged(slope, SMOOTHED))
    whole = Motion(
        time_s=columns["time"],
        position=FLIP * three("stateEstimateZ.") / 1e3,
        velocity=velocity,
        attitude=attitude,
        rates=FLIP * three("ctrlLee.omega"),
        force=force,
        outputs_us=1000.0 + 1000.0 * np.clip(motors / FULL_N, 0.0, 1.0),
    )
    return whole[span(thrust > 0.5 * MASS_KG * GRAVITY)][::EVERY]
