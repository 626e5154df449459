"""Turn real flights of a nano quadcopter, with a load on a cord or larger propellers, into .tlog and vehicle files.

``python tests/benchmarks/payload_logs.py CLONE OUT``: CLONE is a clone of github.com/IMRCLab/crazyswarm2-tools, of
which twenty logs of commit 847605a are read (format of the Crazyflie's memory card, which a log describes itself). Then
judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/payload.toml --data OUT
    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/propellers.toml --data OUT

Position, velocity, attitude and rates are the estimator's. The accelerometer is real in the flights with a load. The
others have none; there the specific force is the derivative of the velocity over nine samples. All are logged at 250 Hz
and written at 125 Hz. Outputs are the forces that the controller asks of the four motors, by the firmware's
distribution of thrust and torque.
"""

from __future__ import annotations

import struct
import sys
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, fans, throttle, vehicle_toml, write_tlog
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "847605ab2d2d7ed5040ab0c7d2c7116c047b4de5"
LOADED = (182, 183, 184, 201, 202, 203, 204, 205, 206)
PROPELLERS = ("08", 12, 16, 20, 24, 28, 32, 36, 40, 44, 48)
"""Every fourth of the flights with larger motors and propellers that are long enough to be judged."""
EVERY, SMOOTHED, GRAVITY = 2, 9, 9.80665
MASS_KG, INERTIA = 0.032, [16.6e-6, 16.6e-6, 29.3e-6]
"""Mass of the vehicle alone by the authors' model_payload.py; inertia of the firmware."""
ARM_M, RADIUS_M, TORQUE_M = 0.046 * 0.5**0.5, 0.0225, 0.005964552
"""By the firmware: arm along an axis, and torque over thrust."""
FULL_N = 0.25
"""Force of one motor that is written as full output; no command reaches it."""
VEHICLES = {
    "payload_1": (MASS_KG, 0.768),
    "payload_2": (MASS_KG, 0.911),
    "propellers": (0.037, 1.055),
}
"""Mass, and thrust over commanded thrust: with the load of 5 g flights 184 and 201 are in balance; standard motors and
propellers of the thirty flights before need 1.055."""
PLACES = ((1, 1, "ccw"), (-1, 1, "cw"), (-1, -1, "ccw"), (1, -1, "cw"))


def main() -> int:
    clone, out = clone_and_out(__doc__)
    names = [(k, f"payload_{k}") for k in LOADED] + [(k, f"propellers_{k}") for k in PROPELLERS]
    for k, name in names:
        columns = _columns(git(clone, "show", f"{COMMIT}:logs/log{k}"))
        write_tlog(out / f"{name}.tlog", _motion(columns))
    for name, (mass_kg, level) in VEHICLES.items():
        (out / f"{name}.toml").write_text(
            vehicle_toml(_vehicle(name, mass_kg, level)), encoding="utf-8"
        )
    print(f"{len(names)} logs and {len(VEHICLES)} vehicle files in {out}")
    return 0


def _columns(data: bytes) -> dict[str, Array]:
    """Columns of the one kind of record in a log: names with types, then rows of an id, a time and values."""
    end = data.index(b"\0", 7)
    count = struct.unpack_from("<H", data, end + 1)[0]
    at, kinds = end + 3, []
    for _ in range(count):
        stop = data.index(b"\0", at)
        name, kind = data[at:stop].decode()[:-1].split("(")
        kinds.append((name, f"<{kind.replace('h', 'i2').replace('f', 'f4')}"))
        at = stop + 1
    # An event's time is in milliseconds as a whole number of version 1, in microseconds of version 2.
    version = struct.unpack_from("<H", data, 1)[0]
    row = np.dtype([("id", "<u2"), ("time", "<u4" if version == 1 else "<u8"), *kinds])
    rows = np.frombuffer(data, row, (len(data) - 4 - at) // row.itemsize, at)
    return {name: rows[name].astype(float) for name in row.names or ()} | {
        "time": rows["time"] / (1e3 if version == 1 else 1e6)
    }


def _motion(columns: dict[str, Array]) -> Motion:
    def three(name: str) -> Array:
        return np.stack([columns[f"{name}{axis}"] for axis in "xyz"], axis=1)

    # The world is north-west-up, the body forward-left-up.
    flip = np.array([1.0, -1.0, -1.0])
    attitude = Rotation.from_euler("ZYX", (three("ctrlLee.rpy") * flip)[:, ::-1])
    roll, pitch, yaw = (three("ctrlLee.torque") / (4.0 * ARM_M, 4.0 * ARM_M, 4.0 * TORQUE_M)).T
    thrust = columns["ctrlLee.thrustSI" if "ctrlLee.thrustSI" in columns else "ctrlLee.thrustSi"]
    level = thrust / 4.0
    motors = [level - roll - pitch - yaw, level - roll + pitch + yaw, level + roll + pitch - yaw,
              level + roll - pitch + yaw]  # fmt: skip
    velocity = three("stateEstimateZ.v") * flip / 1e3
    if "acc.x" in columns:
        force = three("acc.") * flip * GRAVITY
    else:
        force = attitude.inv().apply(_derivative(velocity, columns["time"]) - (0.0, 0.0, GRAVITY))
    flying = np.flatnonzero(thrust > 0.5 * MASS_KG * GRAVITY)
    kept = slice(flying[0], flying[-1] + 1, EVERY)
    return Motion(
        time_s=columns["time"][kept],
        position=(three("stateEstimateZ.") * flip / 1e3)[kept],
        velocity=velocity[kept],
        quaternion=np.roll(attitude.as_quat(), 1, axis=1)[kept],
        rates=(three("ctrlLee.omega") * flip)[kept],
        force=force[kept],
        outputs_us=(1000.0 + 1000.0 * np.clip(np.stack(motors, axis=1) / FULL_N, 0.0, 1.0))[kept],
    )


def _derivative(x: Array, time_s: Array) -> Array:
    """Slope (n, 3) of ``x``: the mean over ``SMOOTHED`` samples of their differences."""
    kernel = np.ones(SMOOTHED) / SMOOTHED
    slope = np.gradient(x, time_s, axis=0)
    return np.stack([np.convolve(column, kernel, mode="same") for column in slope.T], axis=1)


def _vehicle(name: str, mass_kg: float, level: float) -> dict[str, Any]:
    return {
        "name": name,
        "mass_kg": mass_kg,
        "inertia_kgm2": INERTIA,
        "hover_thrust": 0.35,
        "rotor_radius_m": RADIUS_M,
        "fan": fans(PLACES, ARM_M, RADIUS_M),
        "throttle": throttle(FULL_N * level, expo=0.0, voltage_v=3.7),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
