"""A flight of a toy quadcopter (Parrot Mambo) that hovers and is thrown once.

A clone of github.com/ouafi98/stability-recovery-after-been-thrown-maneuver-Parrot-mambo, of which one recording of
commit 954169e is read. The vehicle file is that of ``sources/mambo.py``: the same model of the same maker.

Attitude, position, velocity and rates are the vehicle's own estimate, recorded at 200 Hz with gaps; outputs the motor
commands. There is no accelerometer: the specific force is the derivative of the velocity.
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
from sources.mambo import CLEAR_M, FULL_COMMAND
from sources.mambo import VEHICLES as MAMBO
from sources.motion import Motion, smoothed, span, specific_force

COMMIT = "954169e147293e085f832fe42752d1c954eb95e2"
PATH = "matlab.mat"
SMOOTHED = 9
VEHICLES = {"thrown": MAMBO["mambo"]}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    file = loadmat(io.BytesIO(read(clone, COMMIT, PATH)), squeeze_me=True, struct_as_record=False)
    yield "thrown", motion_of(file)


def motion_of(file: dict[str, Any]) -> Motion:
    time = np.asarray(file["estimatedStates"].time, dtype=float)
    state = np.asarray(file["estimatedStates"].signals.values, dtype=float)
    motors = np.asarray(file["motorCmd"].signals.values, dtype=float)
    attitude = Rotation.from_euler("ZYX", state[:, 3:6])
    velocity = state[:, 6:9]
    acceleration = np.gradient(smoothed(velocity, SMOOTHED), time, axis=0)
    whole = Motion(
        time_s=time,
        position=state[:, :3],
        velocity=velocity,
        attitude=attitude,
        rates=state[:, 9:12],
        force=specific_force(attitude, acceleration),
        outputs_us=1000.0 + 1000.0 * np.abs(motors) / FULL_COMMAND,
    )
    return whole[span(state[:, 2] < -CLEAR_M)]
