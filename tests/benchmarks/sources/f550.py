"""Two flights of a hexarotor of 1.9 kg (F550), with good propellers and with one that was cut by 10 mm on one side.

A clone of github.com/udesa-ai/prop-damage-adapt, of which two pairs of recordings of commit 4b97703 are read.

Specific force and rates are the sensors' (200 Hz), outputs those of PX4's mixer for a hexarotor in X from the
recorded roll, pitch, yaw and thrust. Neither attitude nor motion is recorded: roll and pitch are the integral of the
rates, drawn to the specific force over ``FOLLOWED_S``, as a filter of an autopilot has them. Velocity and place are
left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mav
from scipy.spatial.transform import Rotation

from models.common.frames import GRAVITY
from sources.clone import read
from sources.motion import Array, Message, at, boot_clock, imu, means, records, servos, span
from sources.table_text import columns, rows_of
from sources.vehicle_file import HEXAROTOR_X_PLACES, fans, throttle, vehicle

COMMIT = "4b97703fed3b8c7c2124a1ae3d5c718b740093ee"
PATH = "data/hexaF550/M1_{}_{}.csv"
LOGS = {"f550_good": "Hnominal", "f550_cut": "Hasymm10"}
EVERY = 2
RATE_HZ = 100.0
FOLLOWED_S = 10.0
FLIES = 0.35
# data/hexaF550/README.MD gives the mass; arm and propeller are those of the frame.
MASS_KG = 1.892
ARM_M = 0.275
RADIUS_M = 0.127
HOVER = 0.4862
WEIGHT_ARM = MASS_KG * ARM_M**2 / 3.0
MIXER = np.array(
    [
        (-1.0, 0.0, -1.0, 1.0),
        (1.0, 0.0, 1.0, 1.0),
        (0.5, 0.866, -1.0, 1.0),
        (-0.5, -0.866, 1.0, 1.0),
        (-0.5, 0.866, 1.0, 1.0),
        (0.5, -0.866, -1.0, 1.0),
    ]
)
"""Of roll, pitch, yaw and thrust to the motors: to the right, left, front left, rear right, front right, rear left."""
VEHICLES = {
    "f550": vehicle(
        name="f550",
        mass_kg=MASS_KG,
        inertia=(WEIGHT_ARM, WEIGHT_ARM, 2.0 * WEIGHT_ARM),
        hover_thrust=HOVER,
        radius_m=RADIUS_M,
        fan=fans(HEXAROTOR_X_PLACES, ARM_M, RADIUS_M),
        throttle=throttle(round(MASS_KG * GRAVITY / 6.0 / HOVER, 3), expo=0.0, voltage_v=11.1),
    )
}


@dataclass(frozen=True)
class Felt:
    """What the sensors of a flight say at ``RATE_HZ``, forward-right-down, and its outputs."""

    force: Array
    rates: Array
    outputs_us: Array

    def records(self) -> Iterator[bytes]:
        """The .tlog of an armed hexarotor without a position."""
        return records(self._messages())

    def _messages(self) -> Iterator[tuple[float, Message]]:
        wxyz = np.roll(attitude_of(self.rates, self.force).as_quat(), 1, axis=1)
        for i, outputs in enumerate(np.rint(self.outputs_us).astype(int).tolist()):
            time_s = i / RATE_HZ
            ms, us = boot_clock(time_s)
            if i % int(RATE_HZ) == 0:
                yield time_s, mav.MAVLink_heartbeat_message(13, 12, 157, 6 << 16, 4, 3)
            yield time_s, mav.MAVLink_attitude_quaternion_message(ms, *wxyz[i], *self.rates[i])
            yield time_s, imu(us, self.force[i], self.rates[i])
            yield time_s, servos(us, outputs)


def flights(clone: Path) -> Iterator[tuple[str, Felt]]:
    for name, recording in LOGS.items():
        controls = read(clone, COMMIT, PATH.format(recording, "cont")).decode()
        sensors = read(clone, COMMIT, PATH.format(recording, "inertial")).decode()
        yield name, felt(controls, sensors)


def felt(controls: str, sensors: str) -> Felt:
    """The flight from the first to the last moment with thrust; both tables have one clock."""
    rows = rows_of(controls)
    clock = np.array([_seconds(row["Time"]) for row in rows])
    time = np.arange(clock[0], clock[-1], 0.5 / RATE_HZ)
    asked = at(time, clock, columns(rows, "control_1 control_2 control_3 control_4"))
    names = [f"{kind}_{k}" for kind in ("accelerometer_m_s2", "gyro_rad") for k in (1, 2, 3)]
    turned = at(time, clock, columns(rows_of(sensors), " ".join(names)))
    flown = span(asked[:, 3] > FLIES)
    shares = means((asked @ MIXER.T)[flown], EVERY).clip(0.0, 1.0)
    sensed = means(turned[flown], EVERY)
    return Felt(force=sensed[:, :3], rates=sensed[:, 3:], outputs_us=1000.0 + 1000.0 * shares)


def _seconds(clock: str) -> float:
    hours, minutes, seconds = map(float, clock.split(":"))
    return 3600.0 * hours + 60.0 * minutes + seconds


def attitude_of(rates: Array, force: Array) -> Rotation:
    """Body to world: the integral of the rates, and roll and pitch drawn to where the specific force is up."""
    turn = Rotation.identity()
    found = []
    for rate, felt_here in zip(rates, force, strict=True):
        up = turn.apply(felt_here / -GRAVITY)
        lean = np.cross(up, (0.0, 0.0, 1.0)) / (FOLLOWED_S * RATE_HZ)
        turn = Rotation.from_rotvec(lean) * turn * Rotation.from_rotvec(rate / RATE_HZ)
        found.append(turn.as_quat())
    return Rotation.from_quat(found)
