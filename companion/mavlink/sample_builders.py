"""From the quantities of one message to its sample; None where they are not finite."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from companion.mavlink.range_beams import DOWN, beam_direction, range_verdict
from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    Battery,
    EscHealth,
    EstimatorStatus,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Parameter,
    Pressure,
    Quaternion,
    Range,
    Ring,
    RotorSpeeds,
    ServoOutput,
    SetAttitudeTarget,
    SetPositionTarget,
)
from companion.mavlink.wire_layout import NAN, Head, finite, unit_quaternion
from models.frames import quaternion_from_euler
from models.vehicle import Vector3


def heartbeat(head: Head, _: str, base: int, custom: int, autopilot: int, kind: int, status: int) -> Heartbeat:
    return Heartbeat(*head, bool(base & 128), custom, base, autopilot, kind, status)


def attitude(head: Head, name: str, euler: Vector3, rates: Vector3) -> Attitude | None:
    if not finite(euler, rates):
        return None
    return Attitude(*head, quaternion_from_euler(*euler), rates, name)


def attitude_quaternion(head: Head, name: str, q: Quaternion, rates: Vector3) -> Attitude | None:
    unit = unit_quaternion(q)
    return Attitude(*head, unit, rates, name) if unit is not None and finite(rates) else None


def position(head: Head, _: str, position: Vector3, velocity: Vector3) -> LocalPosition | None:
    return LocalPosition(*head, position, velocity) if finite(position, velocity) else None


def _imu_source(name: str, sensor: int) -> str:
    return f"{name}:{sensor}" if sensor else name


def highres_imu(head: Head, name: str, force: Vector3, gyro: Vector3, updated: int, sensor: int) -> Imu | None:
    if updated & 63 == 63:
        return Imu(*head, force, gyro, _imu_source(name, sensor))
    if not updated & 63:
        return None
    flags = [bool(updated >> bit & 1) for bit in range(6)]
    fx, fy, fz, gx, gy, gz = (v if on else NAN for v, on in zip((*force, *gyro), flags, strict=True))
    return Imu(*head, (fx, fy, fz), (gx, gy, gz), _imu_source(name, sensor))


def raw_imu(head: Head, name: str, force: Vector3, gyro: Vector3, sensor: int) -> Imu:
    return Imu(*head, force, gyro, _imu_source(name, sensor))


def scaled_imu(head: Head, name: str, force: Vector3, gyro: Vector3) -> Imu:
    return Imu(*head, force, gyro, name)


def distance_sensor(
    head: Head, name: str, distance: tuple[float], limits: tuple[float, float], variance: tuple[float], q: Quaternion,
    orientation: int, sensor: int, quality: int,
) -> Range:  # fmt: skip
    low, high = limits if limits[1] > 0.0 else (NAN, NAN)
    direction = beam_direction(orientation, q)
    verdict = range_verdict(distance[0], low, high, quality, direction is not None)
    sigma = math.sqrt(variance[0]) if variance[0] == variance[0] else None
    return Range(
        *head, direction, orientation, sensor, distance[0], low, high, sigma, quality or None, verdict, name
    )  # fmt: skip


def rangefinder(head: Head, name: str, distance: tuple[float]) -> Range | None:
    if distance[0] != distance[0]:
        return None
    verdict = range_verdict(distance[0], NAN, NAN, 0, True)
    return Range(*head, DOWN, 25, 0, distance[0], NAN, NAN, None, None, verdict, name)


_NORTHWARD_FRAMES, _BODY_FRAMES = (0, 1), (8, 12)
"""MAV_FRAME_GLOBAL and LOCAL_NED; MAV_FRAME_BODY_NED and BODY_FRD."""


def obstacle_distance(
    head: Head, _: str, distances: tuple[float, ...], limits: tuple[float, float], steps: tuple[float, float],
    offset: tuple[float], frame: int,
) -> Ring | None:  # fmt: skip
    low, high = limits
    whole, fine = steps
    step = fine if fine > 0.0 else whole
    if not (step > 0.0 and finite(offset)) or frame not in (*_NORTHWARD_FRAMES, *_BODY_FRAMES):
        return None
    used = distances[: int(2.0 * math.pi / step + 1e-3)]
    beyond = high if high > 0.0 else math.inf
    # NaN where nothing is known; at its least distance or nearer a sensor says nothing either.
    known = tuple([NAN if not d > low else math.inf if d >= beyond else d for d in used])
    bearings = tuple([offset[0] + k * step for k in range(len(used))])
    return Ring(*head, bearings, known, frame in _NORTHWARD_FRAMES)


def esc_telemetry(first_esc: int) -> Callable[..., RotorSpeeds]:
    def build(head: Head, name: str, rpm: Any, temperature: Any, voltage: Any, current: Any, count: Any) -> RotorSpeeds:
        health = EscHealth(*head, first_esc, temperature, voltage, current)
        return RotorSpeeds(*head, first_esc, rpm, name, tuple(count), health)

    return build


def esc_status(head: Head, name: str, rpm: Any, voltage: Any, current: Any, index: int) -> RotorSpeeds:
    health = EscHealth(*head, index + 1, (NAN,) * 4, voltage, current)
    return RotorSpeeds(*head, index + 1, rpm, name, None, health)


def esc_info(head: Head, _: str, temperature: Any, index: int, info: int) -> EscHealth:
    online = tuple(bool(info >> i & 1) for i in range(4))
    return EscHealth(*head, index + 1, temperature, (NAN,) * 4, (NAN,) * 4, online)


def rpm(head: Head, name: str, rpm: tuple[float, float]) -> RotorSpeeds | None:
    # ArduPilot says -1 for a sensor that is absent or unhealthy.
    known = tuple(v if v >= 0.0 else NAN for v in rpm)
    return RotorSpeeds(*head, 1, known, name) if any(v == v for v in known) else None


def raw_rpm(head: Head, name: str, rpm: tuple[float], index: int) -> RotorSpeeds | None:
    return RotorSpeeds(*head, index + 1, rpm, name) if rpm[0] >= 0.0 else None


def battery(head: Head, name: str, cells: Any, more: Any, current: tuple[float], battery: int) -> Battery | None:
    # Pack voltage in the first place and cells one by one add up alike; above 65 V ArduPilot spreads the pack over two.
    known = [v for v in (*cells, *more) if v == v]
    voltage = math.fsum(known)
    return _battery_sample(head, name, voltage if voltage > 0.0 else NAN, current[0], battery)


def sys_status(head: Head, name: str, voltage: tuple[float], current: tuple[float]) -> Battery | None:
    return _battery_sample(head, name, voltage[0] if voltage[0] > 0.0 else NAN, current[0], 0)


def _battery_sample(head: Head, name: str, voltage: float, current: float, battery: int) -> Battery | None:
    return Battery(*head, voltage, current, battery, name) if voltage == voltage or current == current else None


def pressure(head: Head, name: str, pressure: tuple[float], temperature: tuple[float]) -> Pressure | None:
    return Pressure(*head, pressure[0], temperature[0], name) if pressure[0] > 0.0 else None


def servo(head: Head, _: str, pwm: tuple[float, ...], port: int) -> ServoOutput:
    return ServoOutput(*head, pwm, port)


def attitude_target(head: Head, _: str, q: Quaternion, thrust: tuple[float]) -> AttitudeTarget | None:
    return AttitudeTarget(*head, unit_quaternion(q) or (NAN,) * 4, thrust[0]) if finite(thrust) else None


def set_attitude(
    head: Head, _: str, q: Quaternion, rates: Vector3, thrust: tuple[float], mask: int, system: int, component: int
) -> SetAttitudeTarget:
    return SetAttitudeTarget(*head, mask, q, rates, thrust[0], system, component)


def set_position(
    head: Head, _: str, position: Vector3, velocity: Vector3, acceleration: Vector3, yaw: tuple[float, float],
    mask: int, frame: int, system: int, component: int,
) -> SetPositionTarget:  # fmt: skip
    return SetPositionTarget(*head, mask, frame, position, velocity, acceleration, yaw[0], yaw[1], system, component)


def parameter(
    head: Head, _: str, value: tuple[float], name: str, kind: int, index: int, count: int
) -> Parameter | None:
    number = parameter_value(value[0], kind)
    return Parameter(*head, name, number, index, count) if name and number == number else None


def landed(head: Head, _: str, state: int) -> LandedState:
    return LandedState(*head, state)


def ekf_status(head: Head, name: str, ratios: tuple[float, float], flags: int) -> EstimatorStatus:
    return EstimatorStatus(*head, flags, NAN, _largest(ratios), name)


def estimator_status(
    head: Head, name: str, ratios: tuple[float, float], accuracy: tuple[float], flags: int
) -> EstimatorStatus:
    return EstimatorStatus(*head, flags, accuracy[0], _largest(ratios), name)


def _largest(ratios: tuple[float, ...]) -> float:
    return max((r for r in ratios if r == r), default=NAN)


def parameter_value(value: float, kind: int) -> float:
    """A parameter's number: ArduPilot sends whole numbers as floats, PX4 an integer's bytes in the float's place.

    The bytes of PX4's negative integers near 0 are those of a NaN; they stay unknown.
    """
    if not 1 <= kind <= 8 or not math.isfinite(value) or value == 0.0 or (abs(value) >= 1.0 and value.is_integer()):
        return value
    (number,) = struct.unpack("<i" if kind in (2, 4, 6, 8) else "<I", struct.pack("<f", value))
    return float(number)
