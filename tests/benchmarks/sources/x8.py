"""Flights of an X8-copter.

A clone of github.com/andrealaffly/ACSL-flightstack-accessories (Advanced Control Systems Lab, Virginia Tech), of which
four flights of commit f26552a are read.

Attitude, position, velocity and rates are those of the flight controller's filter on motion capture, as the log of the
controller holds them at 100 Hz; outputs are the thrust commands of the eight motors. There is no accelerometer and no
voltage: the specific force is the derivative of the velocity over five samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sources.clone import read
from sources.motion import Array, Motion, at, from_wxyz, smoothed, specific_force
from sources.vehicle_file import throttle, vehicle

COMMIT = "f26552a4ed7b6720d1df9c9d1c5617d555e31788"
FOLDER = "Flight_Data"
LOGS = (
    "2024/06/20240613/PID/logs/log_20240613_115633.log",
    "2024/06/20240613/PID/logs/log_20240613_121802.log",
    "2024/06/20240621/PID/logs/log_20240621_103807.log",
    "2024/07/20240729/MRAC/logs/log_20240729_163817.log",
)
TIME = 1
STATE = slice(15, 28)
OUTPUTS = slice(67, 75)
"""Columns: north-east-down, forward-right-down, quaternion w first; normalised thrust of the eight motors."""
RATE_HZ = 100.0
SMOOTHED = 5
"""States come up to a sample too early or too late."""
# include/flightstack/control/vehicle_info.hpp of github.com/andrealaffly/ACSL-flightstack.
MASS_KG = 1.920
INERTIA = (2.271990e-2, 2.202047e-2, 1.614693e-2)
FORWARD_M = 0.0881269
RIGHT_M = 0.1083450
MAX_THRUST_N = 12.05
EXPO = 0.667
"""Of the authors' polynomial from thrust to command (a thrust stand's), within 0.05 N from 1.5 to 5 N a motor."""
RADIUS_M = 0.0635
"""Guess: five inches, which the motors (2550 rpm/V) and the arms allow."""
PLACES = (
    (1, 1, "ccw", "cw", 1, 6),
    (1, -1, "cw", "ccw", 2, 5),
    (-1, -1, "ccw", "cw", 3, 8),
    (-1, 1, "cw", "ccw", 4, 7),
)
"""Forward, right, spins of the upper and the lower motor and their numbers, by the authors' mixer matrix."""
FANS = [
    {
        "position_m": [x * FORWARD_M, y * RIGHT_M, 0.0],
        "lip_radius_m": RADIUS_M,
        "rotors": [
            {"servo": a, "spin": upper},
            {"servo": b, "spin": lower},
        ],
    }
    for x, y, upper, lower, a, b in PLACES
]
VEHICLES = {
    "x8": vehicle(
        name="X8-copter",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=0.39,
        radius_m=RADIUS_M,
        fan=FANS,
        throttle=throttle(MAX_THRUST_N, EXPO, voltage_v=14.8),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for path in LOGS:
        text = read(clone, COMMIT, f"{FOLDER}/{path}").decode()
        yield Path(path).stem.removeprefix("log_"), motion_of(rows_of(text))


def rows_of(text: str) -> Array:
    """Lines of numbers (n, columns), each behind five fields in brackets; the first line names them."""
    lines = [line.rpartition("] ")[2].rstrip(", ").split(",") for line in text.splitlines()[1:]]
    width = max(map(len, lines))
    whole = [line for line in lines if len(line) == width]
    rows = np.array(whole, float)
    first = np.argmax(rows[:, OUTPUTS].any(axis=1))
    return rows[first:]


def motion_of(rows: Array) -> Motion:
    clock = rows[:, TIME]
    states = rows[:, STATE]
    # The log repeats a state until the next one comes.
    new = np.append(True, np.diff(states[:, :3], axis=0).any(axis=1))
    time = np.arange(clock[new][0], clock[new][-1], 1.0 / RATE_HZ)
    state = at(time, clock[new], states[new])
    place, wxyz, velocity, rates = np.split(state, (3, 7, 10), axis=1)
    attitude = from_wxyz(wxyz)
    acceleration = np.gradient(smoothed(velocity, SMOOTHED), 1.0 / RATE_HZ, axis=0)
    return Motion(
        time_s=time,
        position=place,
        velocity=velocity,
        attitude=attitude,
        rates=rates,
        force=specific_force(attitude, acceleration),
        outputs_us=at(time, clock, 1000.0 + 1000.0 * rows[:, OUTPUTS]),
    )
