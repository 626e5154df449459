"""A flight of a quadcopter of 0.48 kg (Parrot AR.Drone 2.0) into the wind of a fan, in motion capture.

A clone of github.com/tud-cor/ardrone2_dem_filter, of which one recording of commit 38764a8 is read.

Attitude and place are of the motion capture (120 Hz), specific force and rates of the vehicle (200 Hz), outputs the
motors' PWM from 0 to 255. World and body are forward-left-up.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation, Slerp

from sources.clone import read
from sources.motion import FLIP, Motion, at, smoothed, span
from sources.vehicle_file import PARROT_PLACES, fans, throttle, vehicle

COMMIT = "38764a826765958fe31154041ae5788e07dfdba3"
PATH = "matlab/getExpData10_29_25.mat"
RATE_HZ = 100.0
SMOOTHED = 7
CLEAR_M = 0.5
# getFilterInputs.m; thrust by cTEs and cA: rotor speed is linear in the PWM, thrust a parabola of the speed.
MASS_KG = 0.481
INERTIA = (3.4e-3, 4.0e-3, 6.9e-3)
ARM_M = 0.178 * 0.5**0.5
RADIUS_M = 0.1
FULL_SPEED = 3.7 * 100.0
SQUARE_N = 1.275e-5 * FULL_SPEED**2
LINEAR_N = (2.0 * 1.275e-5 * 130.9 - 1.670e-3) * FULL_SPEED
FULL_N = SQUARE_N + LINEAR_N
VEHICLES = {
    "ardrone": vehicle(
        name="ardrone",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=0.663,
        radius_m=RADIUS_M,
        # By the authors' input matrix.
        fan=fans(PARROT_PLACES, ARM_M, RADIUS_M),
        throttle=throttle(round(FULL_N, 3), expo=round(SQUARE_N / FULL_N, 3), voltage_v=11.1),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    file = loadmat(io.BytesIO(read(clone, COMMIT, PATH)), squeeze_me=True, struct_as_record=False)
    yield "ardrone_fan", motion_of(file["topicsOut"])


def motion_of(topics: Any) -> Motion:
    captured, felt, flown = topics.optitrack, topics.ardroneImu, topics.ardroneNav
    ends = min(captured.stampTime[-1], felt.stampTime[-1])
    time = np.arange(felt.stampTime[0], ends, 1.0 / RATE_HZ)
    position = FLIP * at(time, captured.stampTime, captured.pos.T)
    velocity = np.gradient(smoothed(position, SMOOTHED), 1.0 / RATE_HZ, axis=0)
    turns = Rotation.from_quat(captured.orient.T * [*FLIP, 1.0])
    motors = at(time, flown.stampTime, flown.motor.T.astype(float))
    whole = Motion(
        time_s=time,
        position=position,
        velocity=velocity,
        attitude=Slerp(captured.stampTime, turns)(time),
        rates=FLIP * at(time, felt.stampTime, felt.vAng.T),
        force=FLIP * at(time, felt.stampTime, felt.aLin.T),
        outputs_us=1000.0 + 1000.0 * motors / 255.0,
    )
    return whole[span(position[:, 2] < -CLEAR_M)]
