"""Turn real flights of a hexarotor of 12 kg into .tlog and vehicle files.

``python tests/benchmarks/hexarotor_logs.py CLONE OUT``: CLONE is a clone of
github.com/DevangPatwardhan/Wind-Estimation-Disturbance-Observer, of which three recordings of commit d6fa484 are read;
they stay their author's. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/hexarotor.toml --data OUT

Attitude, rates, velocity (north-east-down), position and rotor speeds are recorded at 10 Hz. There is no accelerometer:
the specific force is the derivative of the velocity. In two recordings angles are in degrees, the third position is
the altitude, and the horizontal position counts against the velocity. An output is a rotor speed as a share of
FULL_RAD_S, so thrust is its square.
"""

from __future__ import annotations

import csv
import io
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, throttle, vehicle_toml, write_tlog
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "d6fa484897dfc0b99e9436db3c2a509faeb10897"
GRAVITY = 9.80665
# RunMeFirst.m
MASS_KG, INERTIA = 12.0, (0.643, 0.682, 0.832)
ARM_M, RADIUS_M = 0.6, 0.2286
FULL_RAD_S, TURNING_RAD_S = 700.0, 200.0


@dataclass(frozen=True)
class Recording:
    """One file, whether its angles are degrees and its places are up, and its vehicle."""

    name: str
    path: str
    degrees: bool
    vehicle: str


RECORDINGS = (
    Recording("hexarotor_line", "Data/Data2025-12-13 16-36-44.csv", degrees=False, vehicle="line"),
    Recording("hexarotor_hover", "Data/hover.csv", degrees=True, vehicle="hover"),
    Recording("hexarotor_descent", "Data/climb.csv", degrees=True, vehicle="hover"),
)
THRUST_PER_SPEED2 = {"line": 1.833e-4, "hover": 1.225e-4}
"""In N s2, as the flight's own level flight needs it at 12 kg; for the second below 300 m."""


def main() -> int:
    clone, out = clone_and_out(__doc__)
    for recording in RECORDINGS:
        text = git(clone, "show", f"{COMMIT}:{recording.path}").decode()
        motion = _motion(_columns(text), recording.degrees)
        write_tlog(out / f"{recording.name}.tlog", motion)
    for name, thrust in THRUST_PER_SPEED2.items():
        vehicle = vehicle_toml(_vehicle(thrust))
        (out / f"hexarotor_{name}.toml").write_text(vehicle, encoding="utf-8")
    print(f"{len(RECORDINGS)} logs and two vehicle files in {out}")
    return 0


def _columns(text: str) -> dict[str, Array]:
    """Columns by name, from the first to the last moment when all rotors turn."""
    rows = list(csv.reader(io.StringIO(text)))
    names = rows[0][:19]
    kept = [row[:19] for row in rows[1:] if row]
    values = np.array([list(map(float, row)) for row in kept])
    turning = np.flatnonzero(values[:, 13:19].min(axis=1) > TURNING_RAD_S)
    flown = values[turning[0] : turning[-1] + 1]
    return dict(zip(names, flown.T, strict=True))


def _motion(columns: dict[str, Array], degrees: bool) -> Motion:
    def stack(names: str) -> Array:
        return np.stack([columns[n] for n in names.split()], axis=1)

    time = columns["t"]
    velocity = stack("u v w")
    attitude = Rotation.from_euler("ZYX", stack("psi theta phi"), degrees=degrees)
    rates, place = stack("p q r"), stack("x y z")
    force = np.gradient(velocity, time, axis=0) - (0.0, 0.0, GRAVITY)
    speeds = stack("u1 u2 u3 u4 u5 u6") / FULL_RAD_S
    return Motion(
        time_s=time,
        position=-place if degrees else place,
        velocity=velocity,
        quaternion=np.roll(attitude.as_quat(), 1, axis=1),
        rates=np.radians(rates) if degrees else rates,
        force=attitude.inv().apply(force),
        outputs_us=1000.0 + 1000.0 * speeds,
    )


def _vehicle(thrust: float) -> dict[str, Any]:
    """Places and spins of the author's model: every 60 degrees from the front."""
    fans = []
    for k in range(6):
        angle = np.radians(60.0 * k)
        forward = round(ARM_M * float(np.cos(angle)), 4)
        right = round(ARM_M * float(np.sin(angle)), 4)
        spin = "cw" if k % 2 else "ccw"
        rotor = {"servo": k + 1, "spin": spin}
        fans.append(
            {"position_m": [forward, right, 0.0], "lip_radius_m": RADIUS_M, "rotors": [rotor]}
        )
    full_n = thrust * FULL_RAD_S**2
    share = MASS_KG * GRAVITY / 6.0 / full_n
    return {
        "name": "hexarotor of 12 kg",
        "mass_kg": MASS_KG,
        "inertia_kgm2": list(INERTIA),
        "hover_thrust": round(share**0.5, 3),
        "rotor_radius_m": RADIUS_M,
        "fan": fans,
        "throttle": throttle(full_n, expo=1.0, voltage_v=44.4),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
