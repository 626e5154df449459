"""Turn real flights of the nano-quadrotor benchmark into .tlog and a vehicle file, to judge diagnosis on a new source.

``python tests/benchmarks/nanodrone_logs.py CLONE OUT``: CLONE is a clone of
github.com/idsia-robotics/nanodrone-sysid-benchmark (Busetto et al. 2026, Control Engineering Practice 172, 106871), of
which the raw recordings of commit 6d78c23 are read; they stay the authors'. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/nanodrone.toml --data OUT

Every message carries what the source measured at its own time: attitude, position and rates when a state came, rotor
speeds (electrical over 6 pole pairs), outputs and voltage when a motor sample came, specific force when an acceleration
came (the source holds it turned into the world, z up; it is turned back into the body).
"""

from __future__ import annotations

import io
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from log_writers import record
from pymavlink.dialects.v20 import ardupilotmega as mav
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT, FOLDER = "6d78c2317753605f157931558d734198fc6f3ef1", "data/real/raw/parquets"
POLE_PAIRS = 6
BOOT_S, WALL_S = 10.0, 1.76e9
"""Boot clock and (nominal) wall clock at the start of a flight [s]."""
FLIP = np.diag([1.0, -1.0, -1.0])
"""Axes of the source (x forward, z up) to north-east-down and forward-right-down."""
# The authors' numbers: models/models.py and train/thurst_drag_coeff_identification.ipynb of their repository.
MASS_KG, ARM_M, INERTIA = 0.045, 0.0353, (2.3951e-5, 2.3951e-5, 3.2347e-5)
THRUST_NS2, TORQUE_NMS2 = 3.7177625e-8, 7.728e-11
RADIUS_M, DENSITY = 0.0275, 1.225
STATE = (
    "x",
    "y",
    "z",
    "qx",
    "qy",
    "qz",
    "qw",
    "vx",
    "vy",
    "vz",
    "wx",
    "wy",
    "wz",
    "ros_timestamp_x",
)
MOTORS = (
    *(f"m{k}_{what}" for what in ("erpm", "thrust") for k in (1, 2, 3, 4)),
    "Vbat",
    "ros_timestamp_y",
)
FORCE = ("ax", "ay", "az", "ros_timestamp")


@dataclass(frozen=True)
class Recording:
    """Columns of one flight, each (n,), and whether it flew."""

    columns: dict[str, np.ndarray[Any, Any]]
    flying: np.ndarray[Any, Any]

    def at(self, *names: str) -> np.ndarray[Any, Any]:
        """Columns side by side, (n, names)."""
        return np.stack([self.columns[name] for name in names], axis=1)


def main() -> int:
    clone, out = clone_and_out(__doc__)
    listed = git(clone, "ls-tree", "--name-only", COMMIT, f"{FOLDER}/").decode().split()
    for path in listed:
        recording = _read(git(clone, "show", f"{COMMIT}:{path}"))
        name = Path(path).stem.replace("_20251017", "")
        with (out / f"{name}.tlog").open("wb") as file:
            for time_s, message in _messages(recording):
                file.write(record(int((WALL_S + BOOT_S + time_s) * 1e6), message))
    (out / "nanodrone.toml").write_text(_vehicle(), encoding="utf-8")
    print(f"{len(listed)} logs and nanodrone.toml in {out}")
    return 0


def _read(data: bytes) -> Recording:
    table = pq.read_table(io.BytesIO(data))
    columns = {
        n: np.array(table[n].to_numpy(zero_copy_only=False), float)
        for n in ("t", *STATE, *MOTORS, *FORCE)
    }
    whole = np.all([np.isfinite(c) for c in columns.values()], axis=0)
    flying = np.array(table["is_flying"].to_numpy(zero_copy_only=False), bool)
    return Recording({n: c[whole] for n, c in columns.items()}, flying[whole])


def _messages(r: Recording) -> Iterator[tuple[float, bytes]]:
    """MAVLink 2 frames in order, with their time since the start [s]."""
    attitude = Rotation.from_quat(r.at("qx", "qy", "qz", "qw"))
    force = attitude.inv().apply(r.at("ax", "ay", "az")) @ FLIP
    q = Rotation.from_matrix(FLIP @ attitude.as_matrix() @ FLIP).as_quat()
    place, speed, rate = (r.at(*names) @ FLIP for names in (STATE[:3], STATE[7:10], STATE[10:13]))
    # Damaged samples of the source exceed what the message holds; they stay as implausible as they are.
    rpm = np.clip(r.at(*MOTORS[:4]) / POLE_PAIRS, 0.0, 65535.0).round().astype(int)
    outputs = (1000.0 + 1000.0 * r.at(*MOTORS[4:8])).astype(int)
    link = mav.MAVLink(None, 1, 1)
    start = r.columns["ros_timestamp_x"][0] - r.columns["t"][0]
    beat = battery = -math.inf
    for time_s, kind, i in _in_order(r, start):
        ms, us = round((BOOT_S + time_s) * 1e3), int((BOOT_S + time_s) * 1e6)
        volts = float(r.columns["Vbat"][i])
        out = []
        if time_s - beat >= 1.0:
            mode, status = (152, 4) if r.flying[i] else (24, 3)
            out.append(mav.MAVLink_heartbeat_message(2, 0, mode, 0, status, 3))
            beat = time_s
        if kind == "state":
            w, x, y, z = q[i][[3, 0, 1, 2]]
            out.append(mav.MAVLink_attitude_quaternion_message(ms, w, x, y, z, *rate[i]))
            out.append(mav.MAVLink_local_position_ned_message(ms, *place[i], *speed[i]))
        elif kind == "force":
            out.append(
                mav.MAVLink_highres_imu_message(us, *force[i], *rate[i], 0, 0, 0, 0, 0, 0, 0, 63)
            )
        else:
            centi = [int(volts * 100)] * 4
            speeds = [int(v) for v in rpm[i]]
            out.append(
                mav.MAVLink_esc_telemetry_1_to_4_message(
                    [0] * 4, centi, [0] * 4, [0] * 4, speeds, [1] * 4
                )
            )
            out.append(
                mav.MAVLink_servo_output_raw_message(
                    us, 0, *(int(v) for v in outputs[i]), 0, 0, 0, 0
                )
            )
            if time_s - battery >= 0.1:
                cells = [int(volts * 1000)] + [65535] * 9
                out.append(
                    mav.MAVLink_battery_status_message(0, 1, 1, 32767, cells, -1, -1, -1, -1)
                )
                battery = time_s
        for message in out:
            link.seq = (link.seq + 1) % 256
            yield time_s, message.pack(link)


def _in_order(r: Recording, start: float) -> list[tuple[float, str, int]]:
    """What came new, by its own time since ``start`` [s]: the source repeats a value until the next one."""
    rows: list[tuple[float, str, int]] = []
    for kind, clock in (("state", STATE[-1]), ("motors", MOTORS[-1]), ("force", FORCE[-1])):
        times = r.columns[clock]
        new = np.flatnonzero(np.diff(times, prepend=-math.inf) > 0.0)
        rows += [(float(times[i] - start), kind, int(i)) for i in new if times[i] >= start]
    return sorted(rows)


def _vehicle() -> str:
    ct = THRUST_NS2 / (DENSITY * math.pi * RADIUS_M**4)
    cq = TORQUE_NMS2 / (DENSITY * math.pi * RADIUS_M**5)
    places = ((1, 1, "ccw"), (-1, 1, "cw"), (-1, -1, "ccw"), (1, -1, "cw"))
    fans = [
        f"\n[[fan]]\nposition_m = [{x * ARM_M}, {y * ARM_M}, 0.0]\nlip_radius_m = {RADIUS_M}\n"
        f'ct = {ct:.6f}\ncq = {cq:.6f}\nrotors = [{{ esc = {k}, spin = "{spin}" }}]\n'
        for k, (x, y, spin) in enumerate(places, 1)
    ]
    head = (
        f'name = "Crazyflie 2.1 Brushless"\nmass_kg = {MASS_KG}\ninertia_kgm2 = {list(INERTIA)}\n'
        f"hover_thrust = 0.6\nrotor_radius_m = {RADIUS_M}\n"
    )
    limits = "\n[limits]\nthrust = 0.10\ntilt_deg = 8.0\nslew_thrust_per_s = 0.5\nslew_tilt_deg_per_s = 60.0\n"
    return head + "".join(fans) + limits


if __name__ == "__main__":
    sys.exit(main())
