"""Flights of a nano quadcopter along a figure eight in a vertical plane.

A clone of github.com/utiasDSL/mimo_fmpc_socp, of which four recordings of commit d764c4c are read.

Position, velocity, attitude and rates are the authors' estimate on motion capture at 50 Hz. Outputs are four copies of
the thrust that the controller asks for, so that no moment can be judged. There is no accelerometer and no voltage: the
specific force is the derivative of the velocity over five samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sources.clone import read
from sources.motion import FLIP, Array, Motion, at, smoothed, span, specific_force
from sources.table_text import Rows, columns, rows_of
from sources.vehicle_file import CRAZYFLIE_PLACES, fans, throttle, vehicle

COMMIT = "d764c4ced5ef8e00078175ce43a87506fe43949c"
FOLDER = "runs_paper/hardware_data"
LOGS = (
    "unconstrained/data_20250421_211307",
    "unconstrained/data_20250421_211350",
    "unconstrained/data_20250421_211431",
    "constrained/data_20250422_143652",
)
RATE_HZ = 50.0
SMOOTHED = 5
CLEAR_M = 0.4
MASS_KG = 0.033
"""Of gpmpc_acados_TP_quadrotor_2D_attitude_tracking.yaml."""
FULL_N = 0.16
LEVEL = 0.957
"""Force of a quarter of the command that is written as full output, and thrust over command in the first three."""
INERTIA = (16.6e-6, 16.6e-6, 29.3e-6)
ARM_M = 0.046 * 0.5**0.5
RADIUS_M = 0.0225
"""Of the standard vehicle, by its firmware."""
VEHICLES = {
    "planar": vehicle(
        name="planar",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=0.53,
        radius_m=RADIUS_M,
        fan=fans(CRAZYFLIE_PLACES, ARM_M, RADIUS_M),
        throttle=throttle(FULL_N * LEVEL, expo=0.0, voltage_v=3.8),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for path in LOGS:
        text = read(clone, COMMIT, f"{FOLDER}/{path}.csv").decode()
        name = path.rpartition("data_")[2]
        yield f"planar_{name}", motion_of(rows_of(text))


def motion_of(rows: Rows) -> Motion:
    """The flight from the first sample above ``CLEAR_M`` to the last. The world is north-west-up."""
    clock = columns(rows, "TIME")
    time = np.arange(clock[0], clock[-1], 1.0 / RATE_HZ)

    def three(names: str) -> Array:
        return FLIP * at(time, clock, columns(rows, names))

    attitude = Rotation.from_euler("ZYX", three("ROLL PITCH YAW")[:, ::-1])
    position = three("POS_X POS_Y POS_Z")
    velocity = three("VEL_X VEL_Y VEL_Z")
    acceleration = np.gradient(smoothed(velocity, SMOOTHED), 1.0 / RATE_HZ, axis=0)
    command = np.interp(time, clock, columns(rows, "CMD_FORCE")) / 4.0 / FULL_N
    outputs = 1000.0 + 1000.0 * command.clip(0.0, 1.0)
    whole = Motion(
        time_s=time,
        position=position,
        velocity=velocity,
        attitude=attitude,
        rates=three("ROLL_RATE PITCH_RATE YAW_RATE"),
        force=specific_force(attitude, acceleration),
        outputs_us=np.tile(outputs[:, None], 4),
    )
    return whole[span(position[:, 2] < -CLEAR_M)]
