"""One flight as a ``.tlog``: MAVLink 2 by pymavlink, with receive stamps, errors of sensors, and parameters."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .cases import Case
from .craft import FRAME_CLASS, MAV_TYPE, Array, Craft, G
from .world import Tape

os.environ.setdefault("MAVLINK20", "1")
from pymavlink.dialects.v20 import ardupilotmega as dialect

_EPOCH_S = 1767225600.0


@dataclass(frozen=True)
class Rates:
    """Samples at 50 Hz between two that are sent."""

    imu: int = 1
    servo: int = 2
    esc: int = 2


def write(
    path: Path,
    craft: Craft,
    case: Case,
    tape: Tape,
    i: int,
    seed: int,
    *,
    speeds: bool,
    rates: Rates,
) -> None:
    """Flight ``i`` of the tape, to its own end. ``speeds``: with ESC telemetry."""
    rng = np.random.default_rng([seed, 3])
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    stamped = [
        (_EPOCH_S + 30.0 + at_s + float(rng.exponential(0.0015)), message)
        for at_s, message in _messages(craft, case, tape, i, rng, speeds=speeds, rates=rates)
    ]
    stamped.sort(key=lambda item: item[0])
    with path.open("wb") as file:
        for when, message in stamped:
            file.write(struct.pack(">Q", int(when * 1e6)) + message.pack(link))


def _messages(
    craft: Craft,
    case: Case,
    tape: Tape,
    i: int,
    rng: np.random.Generator,
    *,
    speeds: bool,
    rates: Rates,
) -> Iterator[tuple[float, Any]]:
    for name, value in _parameters(craft).items():
        yield 0.0, dialect.MAVLink_param_value_message(name.encode(), value, 9, 40, 0)
    if case.kind == "commanded":
        name = f"SERVO{case.motors[0]}_FUNCTION".encode()
        yield case.since_s, dialect.MAVLink_param_value_message(name, 1.0, 9, 40, 0)
    seen = tape.time_s <= case.end_s
    count = int(seen.sum())
    noise = 0.15 + G * np.sqrt(2.0) * tape.shaken[:count, i]
    accel = tape.force[:count, i] + noise[:, None] * rng.standard_normal((count, 3))
    accel += rng.normal(0.0, 0.08, 3)
    gyro = tape.rates[:count, i] + 0.01 * (
        1.0 + 5.0 * tape.shaken[:count, i, None]
    ) * rng.standard_normal((count, 3))
    accel = np.clip(accel, -16.0 * G, 16.0 * G)
    euler = _euler(tape.quaternion[:count, i]) + rng.normal(0.0, 0.004, (count, 3))
    for k in range(count):
        t = float(tape.time_s[k])
        ms = round((30.0 + t) * 1e3)
        us = round((30.0 + t) * 1e6)
        if k % rates.imu == 0:
            whole = [round(float(v) / G * 1e3) for v in accel[k]] + [
                round(float(v) * 1e3) for v in gyro[k]
            ]
            whole = [min(max(v, -32767), 32767) for v in whole]
            yield t, dialect.MAVLink_raw_imu_message(us, *whole, 200, 0, 450, 0, 3800)
            yield t, dialect.MAVLink_attitude_message(ms, *euler[k].tolist(), *gyro[k].tolist())
        if k % rates.servo == 0:
            pulses = np.rint(1000.0 + 1000.0 * tape.command[k, i]).astype(int).tolist()
            pulses += [0] * (16 - len(pulses))
            yield (
                t,
                dialect.MAVLink_servo_output_raw_message(us % 2**32, 0, *pulses[:8], *pulses[8:]),
            )
        if speeds and k % rates.esc == 0:
            yield from _escs(t, craft, tape.speed[k, i], tape.volts[k, i], rng)
        if k % 5 == 0:
            place = tape.position[k, i] + rng.normal(0.0, 0.02, 3)
            speed = tape.velocity[k, i] + rng.normal(0.0, 0.03, 3)
            yield (
                t,
                dialect.MAVLink_local_position_ned_message(ms, *place.tolist(), *speed.tolist()),
            )
        if k % 25 == 0:
            millivolts = round(float(tape.volts[k, i]) * 1e3 / 3.0)
            cells = [millivolts] * 3 + [65535] * 7
            yield t, dialect.MAVLink_battery_status_message(0, 1, 1, 32767, cells, -1, -1, -1, 70)
        if k % 50 == 0:
            yield t, dialect.MAVLink_heartbeat_message(MAV_TYPE[craft.frame], 3, 128 + 81, 5, 4, 3)


def _escs(
    t: float, craft: Craft, speed: Array, volts: float, rng: np.random.Generator
) -> Iterator[tuple[float, Any]]:
    groups = (
        dialect.MAVLink_esc_telemetry_1_to_4_message,
        dialect.MAVLink_esc_telemetry_5_to_8_message,
    )
    rpm = speed * 60.0 / (2.0 * np.pi)
    noisy = np.maximum(rpm + 0.003 * rpm.mean() * rng.standard_normal(len(rpm)), 0.0)
    volts_c = [round(float(volts) * 100.0)] * 4
    for g in range((craft.count + 3) // 4):
        four = [round(float(v)) for v in noisy[4 * g : 4 * g + 4]]
        four += [0] * (4 - len(four))
        number = round(t * 25.0) % 65536
        yield t + 0.01, groups[g]([35] * 4, volts_c, [200] * 4, [0] * 4, four, [number] * 4)


def _parameters(craft: Craft) -> dict[str, float]:
    out = {
        "FRAME_CLASS": float(FRAME_CLASS[craft.frame]),
        "FRAME_TYPE": 1.0,
        "MOT_PWM_MIN": 1000.0,
        "MOT_PWM_MAX": 2000.0,
        "MOT_THST_EXPO": round(craft.expo, 3),
        "MOT_SPIN_MIN": 0.15,
        "MOT_SPIN_MAX": 1.0,
    }
    out |= {f"SERVO{k}_FUNCTION": 32.0 + k for k in range(1, craft.count + 1)}
    return out


def _euler(q: Array) -> Array:
    w, x, y, z = q.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch, np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))], axis=1)
