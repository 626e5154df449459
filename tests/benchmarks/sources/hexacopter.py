"""Flights of a hexacopter.

A clone of github.com/wuwushrek/sde4mbrl, of which the training flights of commit f4f34bf are read (a pickle of numpy
arrays; nothing else in it is built).

States are those of the autopilot (PX4) as the authors keep them: east-north-up, forward-left-up. The six motor commands
are averaged by the authors over 40 samples. There is no time: one sample is 10.5 ms by rates against attitude and by
velocity against position. There is no accelerometer: the specific force is the derivative of the velocity, averaged as
the commands are.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sources.clone import read
from sources.motion import FLIP, Array, Motion, averaged, from_wxyz, specific_force
from sources.vehicle_file import HEXAROTOR_X_PLACES, fans, throttle, vehicle

COMMIT = "f4f34bfd4c05d0562bd546b0839622d5d2470183"
FLIGHTS = "sde4mbrlExamples/rotor_uav/hexa_ahg/my_data/trajs.pkl"
STEP_S = 0.0105
AVERAGE = 40
INERTIA = (0.008, 0.008, 0.011)
"""The authors' prior (prior_hexa.yaml), with the mass."""
ARM_M = 0.275
RADIUS_M = 0.127
"""Guesses: a frame of 550 mm with propellers of ten inches."""
MAX_THRUST_N = 11.3
"""As the three flights need it together; over them thrust goes with the command to the power of 0.95: linear."""
VEHICLES = {
    "hexacopter": vehicle(
        name="hexacopter",
        mass_kg=2.295,
        inertia=INERTIA,
        hover_thrust=0.33,
        radius_m=RADIUS_M,
        # The authors' mixer agrees with PX4's.
        fan=fans(HEXAROTOR_X_PLACES, ARM_M, RADIUS_M),
        throttle=throttle(MAX_THRUST_N, expo=0.0, voltage_v=14.8),
    )
}
ARRAYS = {
    ("numpy", "_reconstruct"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    flown = Arrays(io.BytesIO(read(clone, COMMIT, FLIGHTS))).load()["train"]
    for k, (states, commands) in enumerate(flown, 1):
        motion = motion_of(np.asarray(states, float), np.asarray(commands, float))
        yield f"hexacopter_{k}", motion


class Arrays(pickle.Unpickler):
    """Reads numpy arrays and refuses everything else."""

    def find_class(self, module: str, name: str) -> Any:
        if (module.removesuffix(".core.multiarray"), name) not in ARRAYS:
            raise pickle.UnpicklingError(f"{FLIGHTS} holds {module}.{name}, not only arrays")
        return super().find_class(module.replace("numpy.core", "numpy._core"), name)


def motion_of(states: Array, commands: Array) -> Motion:
    """``states`` (n, 13): position, velocity, quaternion w first, rates; ``commands`` (n, 6), 0 to 1."""
    position, velocity, wxyz, rates = np.split(states, (3, 6, 10), axis=1)
    # East-north-up to north-east-down.
    world = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    body = Rotation.from_euler("x", 180, degrees=True)
    attitude = world * from_wxyz(wxyz) * body
    speed = world.apply(velocity)
    force = specific_force(attitude, np.gradient(speed, STEP_S, axis=0))
    whole = Motion(
        time_s=np.arange(len(states)) * STEP_S,
        position=world.apply(position),
        velocity=speed,
        attitude=attitude,
        rates=FLIP * rates,
        force=averaged(force, AVERAGE),
        outputs_us=1000.0 + 1000.0 * commands,
    )
    return whole[AVERAGE : len(states) - AVERAGE]
