"""A flight in which two fans lose thrust for a minute each.

A clone of github.com/rfly-openha/documents (Reliable Flight Control Group, Beihang University), of which one flight of
commit 3489a2c is read: a PX4 log as .csv, hardware in the loop.

The flight is written whole, and as two parts with one fan each. The estimator's own acceleration (10 Hz) is the
specific force; rates are the turn from one attitude (20 Hz) to the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from models.common.frames import GRAVITY
from sources.clone import read
from sources.motion import Array, Motion, at, from_wxyz, specific_force
from sources.table_text import columns, rows_of
from sources.vehicle_file import fans, throttle, vehicle

COMMIT = "3489a2cc395a4de8937f38086d059a0a92354d3f"
LOG = "2_tutorial/examples/log_7_2022-5-12-16-22-12_{}_0.csv"
ATTITUDE = "q[0] q[1] q[2] q[3]"
PLACE = "x y z vx vy vz ax ay az"
OUTPUTS = "output[0] output[1] output[2] output[3]"
PARTS_S = {
    "loss_1": (30.0, 112.0),
    "loss_3": (145.0, 226.0),
    "loss_1_3": (30.0, 226.0),
}
"""From and to, on the autopilot's clock: after take-off, before the landing."""
RATE_HZ = 20.0
# 2_tutorial/examples/lossfactor.ipynb
MASS_KG = 1.4
INERTIA = (0.0211, 0.0219, 0.0366)
ARM_M = 0.225
THRUST_PER_SPEED2 = 1.105e-5
SPEED_PER_THROTTLE = 1148.0
SPEED_AT_ZERO = -141.4
FULL_N = THRUST_PER_SPEED2 * (SPEED_PER_THROTTLE + SPEED_AT_ZERO) ** 2
STILL_US = 1000.0 - 1000.0 * SPEED_AT_ZERO / SPEED_PER_THROTTLE
"""The authors' curve: thrust goes with the square of a speed that is linear in the throttle."""
RADIUS_M = 0.127
"""Guess: ten inches."""
PLACES = (
    (1, 1, "ccw"),
    (-1, -1, "ccw"),
    (1, -1, "cw"),
    (-1, 1, "cw"),
)
"""Forward, right and spin: PX4's quadrotor x, and the authors' allocation."""
CURVE = throttle(FULL_N, expo=1.0, voltage_v=12.6)
VEHICLES = {
    "loss": vehicle(
        name="quadrotor with two weak fans",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=round((MASS_KG * GRAVITY / 4.0 / FULL_N) ** 0.5, 3),
        radius_m=RADIUS_M,
        fan=fans(PLACES, ARM_M * 0.5**0.5, RADIUS_M),
        throttle=CURVE | {"pwm_min_us": STILL_US},
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    def logged(kind: str, names: str) -> Array:
        return columns(
            rows_of(read(clone, COMMIT, LOG.format(kind)).decode()), f"timestamp {names}"
        )

    attitude = logged("vehicle_attitude", ATTITUDE)
    place = logged("vehicle_local_position", PLACE)
    outputs = logged("actuator_outputs", OUTPUTS)
    for name, (start, end) in PARTS_S.items():
        time = np.arange(start, end, 1.0 / RATE_HZ)
        yield name, motion_of(time, *(sampled(time, t) for t in (attitude, place, outputs)))


def sampled(time: Array, table: Array) -> Array:
    """Columns behind the first, the clock [us], at ``time``."""
    return at(time, table[:, 0] * 1e-6, table[:, 1:])


def motion_of(time: Array, wxyz: Array, place: Array, outputs: Array) -> Motion:
    position, velocity, acceleration = np.split(place, 3, axis=1)
    attitude = from_wxyz(wxyz)
    steps = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * RATE_HZ
    return Motion(
        time_s=time,
        position=position,
        velocity=velocity,
        attitude=attitude,
        rates=np.vstack([steps[:1], steps]),
        force=specific_force(attitude, acceleration),
        outputs_us=outputs,
    )
