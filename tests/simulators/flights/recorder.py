"""Sensors and the tlog: what an autopilot would have sent of a flight, as MAVLink 2 with receive stamps.

Sensor errors: white accelerometer and gyro noise with a small offset, attitude that wanders by a few tenths of a degree
(heading: a degree), position and velocity noise, rpm that is old, rounded and noisy, ranges that are rounded to 1 cm,
late, irregular and drop out. Rates as autopilots send them: IMU, attitude, outputs and ESCs at 50 Hz, position at
25 Hz, ranges near 17 Hz, pressure 5 Hz, battery 2 Hz, heartbeat 1 Hz.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .craft import Array, Craft, Ranger
from .world import Tape

TICK_S = 0.02
BEAMS = {25: 0, 2: 1, 24: 2, 0: 3}  # wire orientation -> column of Tape.ranges


@dataclass(frozen=True)
class Logging:
    """How one flight is logged. Defaults are an ordinary log."""

    send_rpm: bool = True
    send_imu: bool = True
    clip_m_s2: float = np.inf
    """Where finite: six bursts of vibration for 3 s, clipped there (and so with a wrong mean)."""
    reboot_at_s: float = np.inf
    system: int = 1


@dataclass(frozen=True)
class Sensed:
    """One flight as the sensors saw it, at 50 Hz and already at the time of measurement (delays undone)."""

    time: Array  # (t,)
    accel: Array  # (t, 3)
    gyro: Array
    quaternion: Array  # (t, 4)
    position: Array  # (t, 3)
    velocity: Array
    rpm: Array  # (t, rotors)
    pwm: Array  # (t, outputs)
    ranges: Array  # (t, beams); NaN where nothing was sent, inf where nothing was hit
    volts: Array
    amperes: Array
    case_c: Array  # (t, fans)
    pressure: Array
    air_c: Array
    rpm_delay: int  # ticks
    range_delay: int
    boot_s: float


def sense(
    craft: Craft, tape: Tape, k: int, seed: int, sensors: tuple[Ranger, ...], log: Logging
) -> Sensed:
    """Flight ``k`` of a tape through its sensors."""
    rng = np.random.default_rng([seed, 11])
    n = len(tape.time)

    def white(size: float, *shape: int) -> Array:
        return size * rng.standard_normal((n, *shape))

    def wander(size: float, tau_s: float, columns: int) -> Array:
        keep = np.exp(-TICK_S / tau_s)
        out = np.empty((n, columns))
        state = size * rng.standard_normal(columns)
        kicks = size * np.sqrt(1.0 - keep * keep) * rng.standard_normal((n, columns))
        for i in range(n):
            state = keep * state + kicks[i]
            out[i] = state
        return out

    accel = tape.specific_force[:, :, k] + white(0.12, 3) + 0.008 * rng.standard_normal(3)
    if np.isfinite(log.clip_m_s2):
        shaken = np.zeros(n)
        for begin in rng.integers(0, max(n - 150, 1), 6):
            shaken[begin : begin + 150] = 1.0
        accel += (shaken * 1.2 * log.clip_m_s2)[:, None] * np.sin(2.0 * np.pi * rng.random((n, 3)))
        accel = np.clip(accel, -log.clip_m_s2, log.clip_m_s2)
    tilt = wander(1.0, 20.0, 3) * np.radians([0.25, 0.25, 0.8])
    per = craft.rotors_per_fan
    unequal = 1.0 + 0.0015 * np.tile([1.0, -1.0], len(craft.spin))[: len(craft.spin)] * (per == 2)
    return Sensed(
        time=tape.time,
        accel=accel,
        gyro=tape.rates[:, :, k] + white(0.0025, 3) + 0.0005 * rng.standard_normal(3),
        quaternion=_rotate(tape.quaternion[:, :, k], tilt),
        position=tape.position[:, :, k] + wander(0.01, 15.0, 3) + white(0.004, 3),
        velocity=tape.velocity[:, :, k] + wander(0.012, 5.0, 3) + white(0.014, 3),
        rpm=np.rint(
            np.repeat(tape.rpm[:, :, k], per, axis=1) * unequal + white(3.0, len(craft.spin))
        ),
        pwm=tape.pwm[:, :, k],
        ranges=_beams(rng, tape.ranges[:, :, k], sensors),
        volts=tape.volts[:, k] + white(0.01),
        amperes=tape.amperes[:, k] + white(0.6),
        case_c=tape.case_c[:, :, k] + white(0.3, tape.case_c.shape[1]),
        pressure=tape.pressure[:, k] + white(2.5),
        air_c=tape.air_c[:, k] + white(0.05),
        rpm_delay=int(rng.integers(0, 3)),
        range_delay=int(rng.integers(1, 3)),
        boot_s=float(np.round(rng.uniform(20.0, 60.0), 2)),
    )


def _beams(rng: np.random.Generator, true: Array, sensors: tuple[Ranger, ...]) -> Array:
    n = len(true)
    out = np.full((n, len(sensors)), np.nan)
    for column, sensor in enumerate(sensors):
        beam = true[:, BEAMS[sensor.orientation]]
        k = int(rng.integers(4))
        while k < n:
            noisy = beam[k] + 0.006 * rng.standard_normal()
            out[k, column] = np.inf if noisy > 6.0 else max(round(noisy, 2), 0.02)
            if rng.random() < 0.005:
                out[k, column] = 0.0  # a reading the sensor itself calls bad
            k += 20 if rng.random() < 0.002 else int(rng.choice([2, 3, 3, 4]))
    return out


def _rotate(q: Array, small: Array) -> Array:
    """Quaternions (t, 4) turned by small body angles (t, 3)."""
    w, x, y, z = q.T
    a, b, c = 0.5 * small.T
    out = np.stack(
        [
            w - x * a - y * b - z * c,
            x + w * a + y * c - z * b,
            y + w * b - x * c + z * a,
            z + w * c + x * b - y * a,
        ]
    )
    turned: Array = (out / np.sqrt((out * out).sum(axis=0))).T
    return turned


def write_tlog(
    craft: Craft, seen: Sensed, seed: int, sensors: tuple[Ranger, ...], log: Logging, path: Path
) -> None:
    """One flight as a tlog."""
    path.write_bytes(b"".join(frame for _, frame in frames(craft, seen, seed, sensors, log)))


def write_mixed(streams: list[list[tuple[float, bytes]]], path: Path) -> None:
    """Several vehicles heard by one station: frames in the order of their receive stamps."""
    merged = sorted((item for stream in streams for item in stream), key=lambda item: item[0])
    path.write_bytes(b"".join(frame for _, frame in merged))


def frames(
    craft: Craft, seen: Sensed, seed: int, sensors: tuple[Ranger, ...], log: Logging
) -> list[tuple[float, bytes]]:
    """(receive time, 8-byte stamp + MAVLink 2 frame) in receive order."""
    m, mav = _mavlink(log.system)
    rng = np.random.default_rng([seed, 13])
    epoch = 1767225600.0 + 1000.0 * (seed % 10000)
    out: list[tuple[float, bytes]] = []
    rotors = len(craft.spin)
    per = craft.rotors_per_fan
    euler = _euler(seen.quaternion)
    pad = [0] * 16

    def send(at_s: float, message: Any, late: float) -> None:
        when = epoch + at_s + late + float(rng.exponential(0.0006))
        out.append((when, struct.pack(">Q", int(when * 1e6)) + message.pack(mav)))

    kinds = ("imu", "att", "quat", "pos", "servo", "esc", "range", "slow")
    late = dict(zip(kinds, rng.uniform(0.0003, 0.004, len(kinds)), strict=True))
    for k, t in enumerate(seen.time):
        real = seen.boot_s + float(t)
        boot = float(t) - log.reboot_at_s + 3.0 if t >= log.reboot_at_s else real
        if log.reboot_at_s <= t < log.reboot_at_s + 6.0 or boot < 0.0:
            continue  # silent while it starts again
        ms, us = round(boot * 1e3) % 2**32, round(boot * 1e6)
        ax, ay, az = seen.accel[k]
        p, q, r = seen.gyro[k]
        if log.send_imu:
            send(real, m.MAVLink_highres_imu_message(
                us, ax, ay, az, p, q, r, 0.21, 0.02, 0.42, seen.pressure[k] / 100.0, 0.0, 0.0, 31.0, 0x1FFF, 0
            ), late["imu"])  # fmt: skip
        send(real, m.MAVLink_attitude_message(ms, *euler[k], p, q, r), late["att"])
        send(
            real,
            m.MAVLink_attitude_quaternion_message(ms, *seen.quaternion[k], p, q, r, [0.0] * 4),
            late["quat"],
        )
        pwm = [*np.repeat(seen.pwm[k, : rotors // per], per).astype(int).tolist()]
        pwm += [0] * (4 - len(pwm)) + seen.pwm[k, rotors // per :].astype(int).tolist()
        pwm = (pwm + pad)[:16]
        send(
            real,
            m.MAVLink_servo_output_raw_message(us % 2**32, 0, *pwm[:8], *pwm[8:]),
            late["servo"],
        )
        if log.send_rpm and k >= seen.rpm_delay:
            old = k - seen.rpm_delay
            ampere = max(seen.amperes[k], 0.0) / rotors
            send(real, m.MAVLink_esc_telemetry_1_to_4_message(
                [max(round(float(c)), 0) for c in np.repeat(seen.case_c[k], per)],
                [round(seen.volts[k] * 100)] * 4, [round(ampere * 100)] * 4, [round(ampere * float(t) / 3.6)] * 4,
                [int(v) for v in seen.rpm[old]], [k % 65536] * 4,
            ), late["esc"])  # fmt: skip
        if k % 2 == 0:
            send(
                real,
                m.MAVLink_local_position_ned_message(ms, *seen.position[k], *seen.velocity[k]),
                late["pos"],
            )
        if k >= seen.range_delay:
            for number, sensor in enumerate(sensors):
                reading = seen.ranges[k - seen.range_delay, number]
                if not np.isnan(reading):
                    good = 0.0 < reading < np.inf
                    cm = 610 if reading == np.inf else round(reading * 100)
                    send(real, m.MAVLink_distance_sensor_message(
                        ms, 2, 600, cm, 0, number, sensor.orientation, 1, 0.0, 0.0, [0.0] * 4, 100 if good else 1
                    ), late["range"])  # fmt: skip
        if k % 10 == 0:
            send(real, m.MAVLink_scaled_pressure_message(
                ms, seen.pressure[k] / 100.0, 0.0, round(seen.air_c[k] * 100), 0
            ), late["slow"])  # fmt: skip
        if k % 25 == 0:
            cells = round(craft.voltage_v / 4.0)
            cell = round(seen.volts[k] / cells * 1000)
            send(real, m.MAVLink_battery_status_message(
                0, 1, 1, 2900, [cell] * cells + [65535] * (10 - cells), round(seen.amperes[k] * 100), -1, -1, 80
            ), late["slow"])  # fmt: skip
        if k % 50 == 0:
            send(real, m.MAVLink_heartbeat_message(2, 3, 137, 4, 4, 3), late["slow"])
    return sorted(out, key=lambda item: item[0])


def _euler(q: Array) -> Array:
    w, x, y, z = q.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    return np.stack(
        [roll, pitch, np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))], axis=-1
    )


def _mavlink(system: int) -> tuple[Any, Any]:
    """The dialect module and a sender."""
    os.environ["MAVLINK20"] = "1"
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega, ardupilotmega.MAVLink(None, srcSystem=system, srcComponent=1)
