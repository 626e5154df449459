"""A hover of a toy quadcopter (Parrot Mambo) with students' own filters and controller.

A clone of github.com/TomGoon/ESE4481, of which one recording of commit 09a96ee is read.

Roll and pitch are the students' filters', the heading is the integral of its rate. Height is the sonar's, its rate the
derivative; the rest of the velocity is what the optical flow says in the body. Specific force and rates are the
sensors'. Outputs are the rotor speeds that the controller asks for [1/s], so thrust is their square.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from sources.clone import read
from sources.mambo import values
from sources.motion import Array, Motion, means, smoothed
from sources.vehicle_file import PARROT_PLACES, fans, throttle, vehicle

COMMIT = "09a96eef91d61f8a7a797c501ef4731e9beaead5"
PATH = "Hws/RSdata.mat"
EVERY = 2
RATE_HZ = 200.0 / EVERY
SMOOTHED = 11
# The sonar reads 0.44 m at least, so that the vehicle may stand before; the last second is a fall.
FLOWN = slice(int(11.0 * RATE_HZ), int(25.8 * RATE_HZ))
# RSdata_Kalman.mat: the mass, and the speed of a rotor at which four carry it.
MASS_KG = 0.068
INERTIA = (6.86e-5, 9.2e-5, 1.366e-4)
ARM_M = 0.047625
RADIUS_M = 0.033
HOVER_SPEED = 286.14
FULL_SPEED = 500.0
FULL_N = MASS_KG * 9.81 / 4.0 * (FULL_SPEED / HOVER_SPEED) ** 2
VEHICLES = {
    "course": vehicle(
        name="course",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=round(HOVER_SPEED / FULL_SPEED, 3),
        radius_m=RADIUS_M,
        fan=fans(PARROT_PLACES, ARM_M, RADIUS_M),
        throttle=throttle(round(FULL_N, 4), expo=1.0, voltage_v=3.7),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    file = loadmat(io.BytesIO(read(clone, COMMIT, PATH)), squeeze_me=True, struct_as_record=False)
    yield "course", motion_of(file)


def motion_of(file: dict[str, Any]) -> Motion:
    def three(names: str) -> Array:
        columns = [values(file, f"rt_{name}").reshape(-1) for name in names.split()]
        return means(np.stack(columns, axis=1), EVERY)[FLOWN]

    rates = three("p q r")
    roll, pitch, height = three("phi_drone theta_drone z_ultrasonic").T
    yaw = np.cumsum(rates[:, 2]) / RATE_HZ
    attitude = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))
    level = attitude.apply(three("u v w") * (1.0, 1.0, 0.0))
    down = smoothed(height[:, None], SMOOTHED)[:, 0]
    velocity = np.column_stack([level[:, :2], np.gradient(down, 1.0 / RATE_HZ)])
    position = np.column_stack([np.cumsum(level[:, :2], axis=0) / RATE_HZ, height])
    speeds = means(values(file, "rt_motor_speeds_2"), EVERY)[FLOWN]
    return Motion(
        time_s=np.arange(len(height)) / RATE_HZ,
        position=position,
        velocity=velocity,
        attitude=attitude,
        rates=rates,
        force=three("a_x a_y a_z"),
        outputs_us=1000.0 + 1000.0 * speeds / FULL_SPEED,
    )
