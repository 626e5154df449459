"""Flights of a toy quadcopter, whose author corrected its mass by them.

A clone of github.com/David-davidlxl/modeling-controlling-and-flight-testing-of-a-small-quadcopter, of which four
recordings (RSdata.mat) of commit fb94ca0 are read.

Attitude, position, velocity and rates are the vehicle's own estimate; the specific force is its accelerometer less the
offset that the recording holds beside it. All are means of two samples of 200 Hz. Outputs are the motor commands.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from models.common.frames import GRAVITY
from sources.clone import read
from sources.motion import Array, Motion, means, span
from sources.vehicle_file import PARROT_PLACES, fans, throttle, vehicle

COMMIT = "fb94ca0012a7e0171ee8f0cd78d8b466bc613cc5"
PATH = "Simulink models/asbQuadcopterRealFlight (version {})/RSdata.mat"
VERSIONS = (1, 2, 3, 4)
CLEAR_M = 0.3
EVERY = 2
FULL_COMMAND = 500.0
# tasks/vehicleVars.m: mass before the correction; thrust is linear in the command.
MASS_KG = 0.063
INERTIA = (5.82857e-5, 7.16914e-5, 1.0e-4)
ARM_M = 0.0624 * 0.5**0.5
HEIGHT_M = -0.015876
RADIUS_M = 0.033
CT = 0.0107
COMMAND_TO_SPEED2 = 13840.8
DENSITY = 1.225
MAX_THRUST_N = CT * DENSITY * np.pi * RADIUS_M**4 * COMMAND_TO_SPEED2 * FULL_COMMAND
VEHICLES = {
    "mambo": vehicle(
        name="mambo",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=0.61,
        radius_m=RADIUS_M,
        # By the author's mixer, and as the rates answer the commands.
        fan=fans(PARROT_PLACES, ARM_M, RADIUS_M, height_m=HEIGHT_M),
        throttle=throttle(round(MAX_THRUST_N, 4), expo=0.0, voltage_v=3.95),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for version in VERSIONS:
        data = read(clone, COMMIT, PATH.format(version))
        file = loadmat(io.BytesIO(data), squeeze_me=True, struct_as_record=False)
        yield f"mambo_{version}", motion_of(file)


def motion_of(file: dict[str, Any]) -> Motion:
    estimate = values(file, "rt_estim")
    kept = span(estimate[:, 2] < -CLEAR_M)

    def part(recorded: Array) -> Array:
        return means(recorded[kept], EVERY)

    state = part(estimate)
    felt = part(values(file, "rt_sensor")[:, :3])
    motors = part(values(file, "rt_motor"))
    at_rest = values(file, "rt_calib")[0, :3]
    return Motion(
        time_s=part(file["rt_estim"].time[:, None])[:, 0],
        position=state[:, :3],
        velocity=state[:, 6:9],
        attitude=Rotation.from_euler("ZYX", state[:, 3:6]),
        rates=state[:, 9:12],
        force=felt - at_rest - (0.0, 0.0, GRAVITY),
        outputs_us=1000.0 + 1000.0 * np.abs(motors) / FULL_COMMAND,
    )


def values(file: dict[str, Any], name: str) -> Array:
    """Values (n, columns) of a recorded signal."""
    return np.asarray(file[name].signals.values, dtype=float)
