"""Sensors and the tlog: what an autopilot would have sent of a flight, as MAVLink 2 with receive stamps.

Sensor errors: white accelerometer and gyro noise with a small offset, attitude that wanders by a few tenths of a degree
(heading: a degree), position and velocity noise, rpm that is old, rounded and noisy, ranges that are rounded to 1 cm,
late, irregular and drop out. Rates as autopilots send them: IMU, attitude, outputs and ESCs at 50 Hz, position at
25 Hz, ranges near 17 Hz, pressure 5 Hz, battery 2 Hz, heartbeat 1 Hz.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
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
    euler = _euler(seen.quaternion)

    kinds = ("imu", "att", "quat", "pos", "servo", "esc", "range", "slow")
    late = dict(zip(kinds, rng.uniform(0.0003, 0.004, len(kinds)), strict=True))

    def send(at_s: float, message: Any, kind: str) -> None:
        when = epoch + at_s + late[kind] + float(rng.exponential(0.0006))
        out.append((when, struct.pack(">Q", int(when * 1e6)) + message.pack(mav)))

    for k, t in enumerate(seen.time):
        real = seen.boot_s + float(t)
        boot = float(t) - log.reboot_at_s + 3.0 if t >= log.reboot_at_s else real
        if log.reboot_at_s <= t < log.reboot_at_s + 6.0 or boot < 0.0:
            continue  # silent while it starts again
        ms = round(boot * 1e3) % 2**32
        us = round(boot * 1e6)
        rates = seen.gyro[k]
        if log.send_imu:
            send(real, _imu(m, seen, k, us), "imu")
        send(real, m.MAVLink_attitude_message(ms, *euler[k], *rates), "att")
        rotation = (*seen.quaternion[k], *rates)
        send(real, m.MAVLink_attitude_quaternion_message(ms, *rotation, [0.0] * 4), "quat")
        outputs = _outputs(craft, seen, k)
        send(real, m.MAVLink_servo_output_raw_message(us % 2**32, 0, *outputs), "servo")
        if log.send_rpm and k >= seen.rpm_delay:
            send(real, _esc(m, craft, seen, k), "esc")
        if k % 2 == 0:
            motion = (*seen.position[k], *seen.velocity[k])
            send(real, m.MAVLink_local_position_ned_message(ms, *motion), "pos")
        if k >= seen.range_delay:
            for message in _ranges(m, sensors, seen, k, ms):
                send(real, message, "range")
        if k % 10 == 0:
            air = (seen.pressure[k] / 100.0, 0.0, round(seen.air_c[k] * 100))
            send(real, m.MAVLink_scaled_pressure_message(ms, *air, 0), "slow")
        if k % 25 == 0:
            send(real, _battery(m, craft, seen, k), "slow")
        if k % 50 == 0:
            send(real, m.MAVLink_heartbeat_message(2, 3, 137, 4, 4, 3), "slow")
    return sorted(out, key=lambda item: item[0])


def _imu(m: Any, seen: Sensed, k: int, us: int) -> Any:
    felt = (*seen.accel[k], *seen.gyro[k])
    magnetic = (0.21, 0.02, 0.42)
    air = (seen.pressure[k] / 100.0, 0.0, 0.0, 31.0)
    return m.MAVLink_highres_imu_message(us, *felt, *magnetic, *air, 0x1FFF, 0)


def _outputs(craft: Craft, seen: Sensed, k: int) -> list[int]:
    """Sixteen pulses: a motor for every rotor, then the vanes, from output 5 on."""
    per = craft.rotors_per_fan
    fans = len(craft.spin) // per
    motors = np.repeat(seen.pwm[k, :fans], per).astype(int).tolist()
    unused = [0] * (4 - len(motors))
    vanes = seen.pwm[k, fans:].astype(int).tolist()
    outputs = [*motors, *unused, *vanes]
    return [*outputs, *[0] * 16][:16]


def _esc(m: Any, craft: Craft, seen: Sensed, k: int) -> Any:
    cases = np.repeat(seen.case_c[k], craft.rotors_per_fan)
    ampere = max(seen.amperes[k], 0.0) / len(craft.spin)
    return m.MAVLink_esc_telemetry_1_to_4_message(
        temperature=[max(round(float(c)), 0) for c in cases],
        voltage=[round(seen.volts[k] * 100)] * 4,
        current=[round(ampere * 100)] * 4,
        totalcurrent=[round(ampere * float(seen.time[k]) / 3.6)] * 4,
        rpm=[int(v) for v in seen.rpm[k - seen.rpm_delay]],
        count=[k % 65536] * 4,
    )


def _ranges(m: Any, sensors: tuple[Ranger, ...], seen: Sensed, k: int, ms: int) -> Iterator[Any]:
    """What the rangefinders read, as late as they are."""
    for number, sensor in enumerate(sensors):
        reading = seen.ranges[k - seen.range_delay, number]
        if np.isnan(reading):
            continue
        yield m.MAVLink_distance_sensor_message(
            time_boot_ms=ms,
            min_distance=2,
            max_distance=600,
            current_distance=610 if reading == np.inf else round(reading * 100),
            type=0,
            id=number,
            orientation=sensor.orientation,
            covariance=1,
            horizontal_fov=0.0,
            vertical_fov=0.0,
            quaternion=[0.0] * 4,
            signal_quality=100 if 0.0 < reading < np.inf else 1,
        )


def _battery(m: Any, craft: Craft, seen: Sensed, k: int) -> Any:
    cells = round(craft.voltage_v / 4.0)
    cell_mv = round(seen.volts[k] / cells * 1000)
    return m.MAVLink_battery_status_message(
        id=0,
        battery_function=1,
        type=1,
        temperature=2900,
        voltages=[cell_mv] * cells + [65535] * (10 - cells),
        current_battery=round(seen.amperes[k] * 100),
        current_consumed=-1,
        energy_consumed=-1,
        battery_remaining=80,
    )


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
