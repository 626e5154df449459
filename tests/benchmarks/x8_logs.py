"""Turn real flights of an X8-copter into .tlog and a vehicle file, to judge diagnosis on another new source.

``python tests/benchmarks/x8_logs.py CLONE OUT``: CLONE is a clone of
github.com/andrealaffly/ACSL-flightstack-accessories (Advanced Control Systems Lab, Virginia Tech), of which four
flights of commit f26552a are read; they stay the authors'. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/x8.toml --data OUT

Attitude, position, velocity and rates are those of the flight controller's filter on motion capture, as the log of the
controller holds them at 100 Hz; outputs are the thrust commands of the eight motors. There is no accelerometer and no
voltage: the specific force is the derivative of the velocity over five samples.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from field_motion import LIMITS, Motion, throttle, vehicle_toml, write_tlog
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "f26552a4ed7b6720d1df9c9d1c5617d555e31788"
LOGS = (
    "2024/06/20240613/PID/logs/log_20240613_115633.log",
    "2024/06/20240613/PID/logs/log_20240613_121802.log",
    "2024/06/20240621/PID/logs/log_20240621_103807.log",
    "2024/07/20240729/MRAC/logs/log_20240729_163817.log",
)
TIME, POSITION, QUATERNION, VELOCITY, RATES = (
    1,
    slice(15, 18),
    slice(18, 22),
    slice(22, 25),
    slice(25, 28),
)
OUTPUTS = slice(67, 75)
"""Columns: north-east-down, forward-right-down, quaternion w first; normalised thrust of the eight motors."""
RATE_HZ, GRAVITY = 100.0, 9.80665
# include/flightstack/control/vehicle_info.hpp of github.com/andrealaffly/ACSL-flightstack.
MASS_KG, INERTIA = 1.920, (2.271990e-2, 2.202047e-2, 1.614693e-2)
ARMS_M = (0.0881269, 0.1083450)
MAX_THRUST_N, EXPO = 12.05, 0.667
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


def main() -> int:
    clone, out = clone_and_out(__doc__)
    for path in LOGS:
        rows = _rows(git(clone, "show", f"{COMMIT}:Flight_Data/{path}").decode())
        write_tlog(out / f"{Path(path).stem.removeprefix('log_')}.tlog", _motion(rows))
    (out / "x8.toml").write_text(vehicle_toml(_vehicle()), encoding="utf-8")
    print(f"{len(LOGS)} logs and x8.toml in {out}")
    return 0


def _rows(text: str) -> NDArray[Any]:
    """Lines of numbers (n, columns), each behind five fields in brackets; the first line names them."""
    lines = [line.rpartition("] ")[2].rstrip(", ").split(",") for line in text.splitlines()[1:]]
    width = max(len(line) for line in lines)
    rows = np.array([[float(x) for x in line] for line in lines if len(line) == width])
    return rows[np.argmax(rows[:, OUTPUTS].any(axis=1)) :]


def _motion(rows: NDArray[Any]) -> Motion:
    # The log repeats a state until the next one comes.
    new = rows[np.append(True, np.diff(rows[:, POSITION], axis=0).any(axis=1))]
    time = np.arange(new[0, TIME], new[-1, TIME], 1.0 / RATE_HZ)
    state = np.stack([np.interp(time, new[:, TIME], column) for column in new[:, 15:28].T], axis=1)
    place, q, speed, rate = np.split(state, (3, 7, 10), axis=1)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    force = np.gradient(_smooth(speed), 1.0 / RATE_HZ, axis=0) - (0.0, 0.0, GRAVITY)
    outputs = [
        np.interp(time, rows[:, TIME], 1000.0 + 1000.0 * column) for column in rows[:, OUTPUTS].T
    ]
    return Motion(
        time_s=time,
        position=place,
        velocity=speed,
        quaternion=q,
        rates=rate,
        force=Rotation.from_quat(q[:, [1, 2, 3, 0]]).inv().apply(force),
        outputs_us=np.stack(outputs, axis=1),
    )


def _smooth(x: NDArray[Any]) -> NDArray[Any]:
    """Mean (n, 3) over five samples: states come up to a sample too early or too late."""
    padded = np.pad(x, ((2, 2), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, np.ones(5) / 5.0, "valid") for column in padded.T], axis=1)


def _vehicle() -> dict[str, Any]:
    x_m, y_m = ARMS_M
    fans = [
        {
            "position_m": [x * x_m, y * y_m, 0.0],
            "lip_radius_m": RADIUS_M,
            "rotors": [{"servo": a, "spin": upper}, {"servo": b, "spin": lower}],
        }
        for x, y, upper, lower, a, b in PLACES
    ]
    return {
        "name": "X8-copter",
        "mass_kg": MASS_KG,
        "inertia_kgm2": INERTIA,
        "hover_thrust": 0.39,
        "rotor_radius_m": RADIUS_M,
        "fan": fans,
        "throttle": throttle(MAX_THRUST_N, EXPO, voltage_v=14.8),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
