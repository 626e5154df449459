"""A flight as a ``.tlog``: MAVLink 2 messages of the contract's section 5 with receive stamps, by pymavlink."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .airframes import Airframe, Array, Beam, G
from .flight import DT, Track
from .sensors import Seen

os.environ.setdefault("MAVLINK20", "1")
from pymavlink.dialects.v20 import ardupilotmega as dialect

EPOCH_S = 1767225600.0


def write(
    frame: Airframe, track: Track, seen: Seen, beams: tuple[Beam, ...], seed: int, path: Path
) -> None:
    """Write one flight. Messages leave at their own rates, some late, with jitter on the way."""
    rng = np.random.default_rng([seed, 4])
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    boot = float(rng.uniform(15.0, 90.0))
    stamped = []
    for at_s, message in _messages(frame, track, seen, beams, rng, boot):
        when = EPOCH_S + boot + at_s + 0.001 + float(rng.exponential(0.0015))
        stamped.append((when, message))
    stamped.sort(key=lambda item: item[0])
    with path.open("wb") as file:
        for when, message in stamped:
            file.write(struct.pack(">Q", int(when * 1e6)) + message.pack(link))


def _messages(
    frame: Airframe,
    track: Track,
    s: Seen,
    beams: tuple[Beam, ...],
    rng: np.random.Generator,
    boot: float,
) -> Iterator[tuple[float, Any]]:
    """(time sent since the log's begin, message)."""
    px4 = frame.autopilot == 12
    n = len(track.time)
    euler = _euler(s.quaternion)
    pwm = np.rint(1000.0 + 1000.0 * track.output).astype(int)
    for k in range(0, n, 5):
        t = float(track.time[k])
        ms, us = round((boot + t) * 1e3), round((boot + t) * 1e6)
        yield t, _imu(px4, us, s.accel[:, k], s.gyro[:, k], float(s.pascal[k]))
        yield t, dialect.MAVLink_attitude_message(ms, *euler[:, k].tolist(), *s.gyro[:, k].tolist())
        outputs = [*pwm[:, k].tolist(), *[0] * (16 - frame.count)]
        yield t, dialect.MAVLink_servo_output_raw_message(us % 2**32, 0, *outputs[:8], *outputs[8:])
        if k % 15 == 0:
            place, speed = s.position[:, k].tolist(), s.velocity[:, k].tolist()
            yield t, dialect.MAVLink_local_position_ned_message(ms, *place, *speed)
        if k % 25 == 0:
            q = s.quaternion[:, k].tolist()
            share = float(track.output[:, k].mean())
            yield t, dialect.MAVLink_attitude_target_message(ms, 7, q, 0.0, 0.0, 0.0, share)
        if k % 50 == 0:
            yield (
                t,
                dialect.MAVLink_scaled_pressure_message(
                    ms, s.pascal[k] / 100.0, 0.0, round(s.celsius[k] * 100), 0
                ),
            )
            yield t, _battery(frame, float(s.volts[k]), float(s.amperes[k]))
            if px4:
                yield t, EscInfo(us, k // 50, frame.count, float(s.esc_celsius[k]))
        if k % 250 == 0:
            yield (
                t,
                dialect.MAVLink_heartbeat_message(
                    13 if frame.count == 6 else 2, frame.autopilot, 128 + 81, 4, 4, 3
                ),
            )
    if frame.declares == "esc":
        yield from _escs(frame, track, s, float(rng.uniform(0.005, 0.025)))
    for number, beam in enumerate(beams):
        yield from _beam(track.time, s.ranges[number], beam, number, rng, boot)


def _imu(px4: bool, us: int, accel: Array, gyro: Array, pascal: float) -> Any:
    if px4:
        return dialect.MAVLink_highres_imu_message(
            us,
            *accel.tolist(),
            *gyro.tolist(),
            0.2,
            0.0,
            0.45,
            pascal / 100.0,
            0.0,
            0.0,
            38.0,
            0x1FFF,
            0,
        )
    whole = [round(float(v) / G * 1000.0) for v in accel] + [round(float(v) * 1000.0) for v in gyro]
    return dialect.MAVLink_raw_imu_message(us, *whole, 200, 0, 450, 0, 3800)


def _battery(frame: Airframe, volts: float, amperes: float) -> Any:
    cells = [round(volts / frame.cells * 1000.0)] * frame.cells + [65535] * (10 - frame.cells)
    return dialect.MAVLink_battery_status_message(
        0, 1, 1, 32767, cells, round(amperes * 100.0), -1, -1, 70
    )


class EscInfo(dialect.MAVLink_message):
    """ESC_INFO (290), which pymavlink's dialects lack: temperatures of ESCs that report no rotor speed."""

    CRC_EXTRA = 251
    WIRE = struct.Struct("<Q4IH4H4h4B")

    def __init__(self, us: int, count: int, rotors: int, celsius: float) -> None:
        super().__init__(290, "ESC_INFO")
        warm = [round(celsius * 100.0)] * rotors + [32767] * (4 - rotors)
        self.content = self.WIRE.pack(
            us, *[0] * 4, count % 65536, *[0] * 4, *warm, 0, rotors, 4, 2**rotors - 1
        )

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """The frame."""
        return self._pack(mav, self.CRC_EXTRA, self.content, force_mavlink1=force_mavlink1)


def _escs(frame: Airframe, track: Track, s: Seen, late: float) -> Iterator[tuple[float, Any]]:
    """ESC telemetry at 25 Hz, in groups of four."""
    groups = (
        dialect.MAVLink_esc_telemetry_1_to_4_message,
        dialect.MAVLink_esc_telemetry_5_to_8_message,
    )
    for count, k in enumerate(range(0, len(track.time), 10)):
        volts, amperes = (
            round(float(s.volts[k]) * 100),
            round(float(s.amperes[k]) / frame.count * 100),
        )
        warm = round(float(s.esc_celsius[k]))
        for g in range((frame.count + 3) // 4):
            here = min(4, frame.count - 4 * g)
            pad = [0] * (4 - here)
            rpm = [round(float(v)) for v in s.rpm[4 * g : 4 * g + here, k]]
            yield (
                float(track.time[k]) + late,
                groups[g](
                    [warm] * here + pad, [volts] * here + pad, [amperes] * here + pad, [count % 60000] * here + pad,
                    rpm + pad, [count % 65536] * here + pad,
                ),
            )  # fmt: skip


def _beam(
    time: Array, reading: Array, beam: Beam, number: int, rng: np.random.Generator, boot: float
) -> Iterator[tuple[float, Any]]:
    """DISTANCE_SENSOR at about 18 Hz; stamped when sent, measured 20 to 60 ms before."""
    latency = float(rng.uniform(0.02, 0.06))
    t = float(rng.uniform(0.06, 0.12))
    while t < time[-1]:
        value = reading[int((t - latency) / DT)]
        if value == value:
            cm = 810 if value == np.inf else round(float(value) * 100)
            yield (
                t,
                dialect.MAVLink_distance_sensor_message(
                    round((boot + t) * 1e3),
                    5,
                    800,
                    cm,
                    0,
                    number,
                    beam.orientation,
                    255,
                    0.0,
                    0.0,
                    [0.0] * 4,
                    0,
                ),
            )
        t += 0.055 + float(rng.normal(0.0, 0.006))


def _euler(q: Array) -> Array:
    w, x, y, z = q
    return np.stack(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ]
    )
