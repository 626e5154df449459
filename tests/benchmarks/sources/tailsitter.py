"""Flights of a tail-sitter with four rotors.

A clone of github.com/RockyJBL/Tailsitter-hovering-dataset, of which six flights of commit 5bba36f are read.

Position, velocity and attitude are those of motion capture at 100 Hz, smoothed by the authors. Outputs are pulses of
the four motors. Pulses of the two elevons stand in the logs as outputs 5 and 6. There is no accelerometer and no
voltage: the specific force is the derivative of the velocity, rates are those of the attitude.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from sources.clone import read
from sources.motion import FLIP, Array, Motion, specific_force, turn_rates
from sources.vehicle_file import fans, throttle, vehicle

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
RATE_HZ = 100.0
ARM_M = 0.16
RADIUS_M = 0.0635
INERTIA = (0.012, 0.006, 0.016)
"""Guesses, from the picture and the motors; no moment is judged."""
MAX_THRUST_N = 7.44
"""What the six flights need together where thrust is in proportion to the pulse."""
PLACES = (
    (1, 1, "ccw"),
    (-1, -1, "ccw"),
    (1, -1, "cw"),
    (-1, 1, "cw"),
)
"""Belly, right and spin of the motors in the order of the autopilot."""
VEHICLES = {
    "tailsitter": vehicle(
        name="tail-sitter",
        mass_kg=0.83,
        inertia=INERTIA,
        hover_thrust=0.27,
        radius_m=RADIUS_M,
        fan=fans(PLACES, ARM_M, RADIUS_M),
        throttle=throttle(MAX_THRUST_N, expo=0.0, voltage_v=11.1),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for setup in SETUPS:
        name = f"{setup}_{REPEAT}"
        data = read(clone, COMMIT, f"dataset/{name}.mat")
        yield name, motion_of(loadmat(io.BytesIO(data), squeeze_me=True))


def motion_of(columns: dict[str, Array]) -> Motion:
    """The world is east-north-up, the body forward-left-up; yaw is small in all flights."""
    angles = FLIP * columns["vision_attitude"]
    attitude = Rotation.from_euler("ZYX", angles[:, ::-1])
    velocity = FLIP * columns["vision_velocity"]
    acceleration = np.gradient(velocity, 1.0 / RATE_HZ, axis=0)
    return Motion(
        time_s=columns["time"],
        position=FLIP * columns["vision_position"],
        velocity=velocity,
        attitude=attitude,
        rates=turn_rates(attitude, RATE_HZ),
        force=specific_force(attitude, acceleration),
        outputs_us=columns["actuator_outputs"],
    )
