"""Flights of the nano-quadrotor benchmark.

A clone of github.com/idsia-robotics/nanodrone-sysid-benchmark (Busetto et al. 2026, Control Engineering Practice 172,
106871), of which the raw recordings of commit 6d78c23 are read.

Every message carries what the source measured at its own time: attitude, position and rates when a state came, rotor
speeds (electrical over 6 pole pairs), outputs and voltage when a motor sample came, specific force when an acceleration
came (the source holds it turned into the world, z up; it is turned back into the body).
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mav
from scipy.spatial.transform import Rotation

from sources.clone import git, read
from sources.motion import FLIP, Array, Message, boot_clock, imu, records, servos
from sources.vehicle_file import CRAZYFLIE_PLACES, fans, vehicle

COMMIT = "6d78c2317753605f157931558d734198fc6f3ef1"
FOLDER = "data/real/raw/parquets"
WALL_S = 1.76e9
EVERY = slice(None)
Messages = Callable[[int, int, int], Iterator[Message]]
"""Of sample i, at a time since boot in ms and in us."""
POLE_PAIRS = 6
# The authors' numbers: models/models.py and train/thurst_drag_coeff_identification.ipynb of their repository.
MASS_KG = 0.045
ARM_M = 0.0353
INERTIA = (2.3951e-5, 2.3951e-5, 3.2347e-5)
THRUST_NS2 = 3.7177625e-8
TORQUE_NMS2 = 7.728e-11
RADIUS_M = 0.0275
DENSITY = 1.225
COEFFICIENTS = {
    "ct": round(THRUST_NS2 / (DENSITY * math.pi * RADIUS_M**4), 6),
    "cq": round(TORQUE_NMS2 / (DENSITY * math.pi * RADIUS_M**5), 6),
}
VEHICLES = {
    "nanodrone": vehicle(
        name="Crazyflie 2.1 Brushless",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=0.6,
        radius_m=RADIUS_M,
        fan=[fan | COEFFICIENTS for fan in fans(CRAZYFLIE_PLACES, ARM_M, RADIUS_M, output="esc")],
    )
}
CLOCKS = {
    "state": "ros_timestamp_x",
    "motors": "ros_timestamp_y",
    "force": "ros_timestamp",
}
"""When a state, a motor sample, an acceleration came."""
QUATERNION = "qx qy qz qw"
POSITION = "x y z"
VELOCITY = "vx vy vz"
RATES = "wx wy wz"
SPEEDS = "m1_erpm m2_erpm m3_erpm m4_erpm"
THRUSTS = "m1_thrust m2_thrust m3_thrust m4_thrust"
ACCELERATION = "ax ay az"
SINGLE = ("t", "Vbat", *CLOCKS.values())
GROUPS = (QUATERNION, POSITION, VELOCITY, RATES, SPEEDS, THRUSTS, ACCELERATION)
NAMES = (*SINGLE, *" ".join(GROUPS).split())


def flights(clone: Path) -> Iterator[tuple[str, Recording]]:
    listed = git(clone, "ls-tree", "--name-only", COMMIT, f"{FOLDER}/").decode()
    for path in listed.split():
        name = Path(path).stem.replace("_20251017", "")
        yield name, recording_of(read(clone, COMMIT, path))


def recording_of(data: bytes, rows: slice = EVERY) -> Recording:
    """What the bytes of a parquet file hold in these rows."""
    table = pq.read_table(io.BytesIO(data))

    def column(name: str, kind: type) -> NDArray[Any]:
        return np.array(table[name].to_numpy(zero_copy_only=False), kind)[rows]

    columns = {name: column(name, float) for name in NAMES}
    whole = np.all([np.isfinite(values) for values in columns.values()], axis=0)
    kept = {name: values[whole] for name, values in columns.items()}
    return Recording(kept, column("is_flying", bool)[whole])


@dataclass(frozen=True)
class Recording:
    """Columns of one flight, each (n,), and whether it flew."""

    columns: dict[str, Array]
    flying: NDArray[np.bool_]
    held: bool = False
    """Whether every row says everything at its own time, what is repeated in place of a lost sample included."""

    def records(self) -> Iterator[bytes]:
        """The .tlog."""
        return records(self.messages(), WALL_S)

    def at(self, names: str) -> Array:
        """Columns side by side, (n, names)."""
        return np.stack([self.columns[name] for name in names.split()], axis=1)

    def messages(self) -> Iterator[tuple[float, Message]]:
        """In order, with their time since the start [s]."""
        said = {
            "state": self.states(),
            "motors": self.motors(),
            "force": self.forces(),
        }
        beat = battery = -math.inf
        for time_s, kind, i in self.news():
            if time_s - beat >= 1.0:
                mode, status = (152, 4) if self.flying[i] else (24, 3)
                yield time_s, mav.MAVLink_heartbeat_message(2, 0, mode, 0, status, 3)
                beat = time_s
            for message in said[kind](i, *boot_clock(time_s)):
                yield time_s, message
            if kind == "motors" and time_s - battery >= 0.1:
                yield time_s, self.battery(i)
                battery = time_s

    def news(self) -> list[tuple[float, str, int]]:
        """What came new, by its own time since the start [s]: the source repeats a value until the next one."""
        if self.held:
            times = self.columns["t"] - self.columns["t"][0]
            return [(now, kind, i) for i, now in enumerate(times.tolist()) for kind in CLOCKS]
        start = self.columns[CLOCKS["state"]][0] - self.columns["t"][0]
        rows: list[tuple[float, str, int]] = []
        for kind, clock in CLOCKS.items():
            times = self.columns[clock]
            new = np.diff(times, prepend=-math.inf) > 0.0
            for i in np.flatnonzero(new & (times >= start)):
                rows.append((float(times[i] - start), kind, int(i)))
        return sorted(rows)

    def states(self) -> Messages:
        flip = np.diag(FLIP)
        pose = Rotation.from_quat(self.at(QUATERNION))
        turned = Rotation.from_matrix(flip @ pose.as_matrix() @ flip)
        wxyz = np.roll(turned.as_quat(), 1, axis=1)
        place, speed, rates = (FLIP * self.at(names) for names in (POSITION, VELOCITY, RATES))

        def said(i: int, ms: int, us: int) -> Iterator[Message]:
            yield mav.MAVLink_attitude_quaternion_message(ms, *wxyz[i], *rates[i])
            yield mav.MAVLink_local_position_ned_message(ms, *place[i], *speed[i])

        return said

    def forces(self) -> Messages:
        pose = Rotation.from_quat(self.at(QUATERNION))
        force = FLIP * pose.inv().apply(self.at(ACCELERATION))
        rates = FLIP * self.at(RATES)

        def said(i: int, ms: int, us: int) -> Iterator[Message]:
            yield imu(us, force[i], rates[i])

        return said

    def motors(self) -> Messages:
        # Damaged samples of the source exceed what the message holds; they stay as implausible as they are.
        rpm = np.clip(self.at(SPEEDS) / POLE_PAIRS, 0.0, 65535.0).round().astype(int)
        outputs = (1000.0 + 1000.0 * self.at(THRUSTS)).astype(int)
        volts = self.columns["Vbat"]
        none = [0] * 4
        one = [1] * 4

        def said(i: int, ms: int, us: int) -> Iterator[Message]:
            centivolts = [int(volts[i] * 100)] * 4
            speeds = rpm[i].tolist()
            yield mav.MAVLink_esc_telemetry_1_to_4_message(
                none,
                centivolts,
                none,
                none,
                speeds,
                one,
            )
            yield servos(us, outputs[i].tolist())

        return said

    def battery(self, i: int) -> Message:
        volts = self.columns["Vbat"][i]
        cells = [int(volts * 1000)] + [65535] * 9
        return mav.MAVLink_battery_status_message(0, 1, 1, 32767, cells, -1, -1, -1, -1)
