"""From the quantities of one message to its sample; None where they are not finite."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from companion.mavlink import samples
from companion.mavlink.range_beams import DOWN, beam_direction, range_verdict
from companion.mavlink.samples import Quaternion
from companion.mavlink.wire_layout import NAN, Head, finite, unit_quaternion
from models.common.frames import quaternion_from_euler
from models.vehicle import Vector3


def as_it_is(kind: type[samples.Sample]) -> Callable[..., samples.Sample]:
    """A sample whose fields are the quantities, in their order."""
    return lambda head, _name, *values: kind(*head, *values)


def heartbeat(
    head: Head, _: str, base: int, custom: int, autopilot: int, kind: int
) -> samples.Heartbeat:
    # 128: MAV_MODE_FLAG_SAFETY_ARMED.
    return samples.Heartbeat(*head, bool(base & 128), custom, autopilot, kind)


def attitude(head: Head, name: str, euler: Vector3, rates: Vector3) -> samples.Attitude | None:
    if not finite(euler, rates):
        return None
    return samples.Attitude(*head, quaternion_from_euler(*euler), rates, name)


def attitude_quaternion(
    head: Head, name: str, q: Quaternion, rates: Vector3
) -> samples.Attitude | None:
    unit = unit_quaternion(q)
    if unit is not None and finite(rates):
        return samples.Attitude(*head, unit, rates, name)
    return None


def position(
    head: Head, _: str, position: Vector3, velocity: Vector3
) -> samples.LocalPosition | None:
    if finite(position, velocity):
        return samples.LocalPosition(*head, position, velocity)
    return None


def imu(head: Head, name: str, force: Vector3, gyro: Vector3, sensor: int = 0) -> samples.Imu:
    return samples.Imu(*head, force, gyro, f"{name}:{sensor}" if sensor else name)


def highres_imu(
    head: Head, name: str, force: Vector3, gyro: Vector3, updated: int, sensor: int
) -> samples.Imu | None:
    if not updated & 63:
        return None
    fx, fy, fz, gx, gy, gz = (
        v if updated >> bit & 1 else NAN for bit, v in enumerate((*force, *gyro))
    )
    return imu(head, name, (fx, fy, fz), (gx, gy, gz), sensor)


def distance_sensor(
    head: Head,
    name: str,
    distance: float,
    limits: tuple[float, float],
    variance: float,
    q: Quaternion,
    orientation: int,
    sensor: int,
    quality: int,
) -> samples.Range:
    low, high = limits if limits[1] > 0.0 else (NAN, NAN)
    direction = beam_direction(orientation, q)
    verdict = range_verdict(distance, low, high, quality, direction is not None)
    if not math.isnan(variance):
        sigma = math.sqrt(variance)
    else:
        sigma = None
    return samples.Range(
        *head,
        direction_frd=direction,
        orientation=orientation,
        sensor_id=sensor,
        distance_m=distance,
        min_m=low,
        max_m=high,
        sigma_m=sigma,
        quality=quality or None,
        verdict=verdict,
        source=name,
    )


def rangefinder(head: Head, name: str, distance: float) -> samples.Range | None:
    if math.isnan(distance):
        return None
    verdict = range_verdict(distance, NAN, NAN, 0, True)
    return samples.Range(
        *head,
        direction_frd=DOWN,
        orientation=25,
        sensor_id=0,
        distance_m=distance,
        min_m=NAN,
        max_m=NAN,
        sigma_m=None,
        quality=None,
        verdict=verdict,
        source=name,
    )


_NORTHWARD_FRAMES = (0, 1)
_BODY_FRAMES = (8, 12)
"""MAV_FRAME_GLOBAL and LOCAL_NED; MAV_FRAME_BODY_NED and BODY_FRD."""


def obstacle_distance(
    head: Head,
    _: str,
    distances: tuple[float, ...],
    limits: tuple[float, float],
    steps: tuple[float, float],
    offset: float,
    frame: int,
) -> samples.Ring | None:
    low, high = limits
    whole, fine = steps
    if fine > 0.0:
        step = fine
    else:
        step = whole
    if not (step > 0.0 and not math.isnan(offset)) or frame not in (
        *_NORTHWARD_FRAMES,
        *_BODY_FRAMES,
    ):
        return None
    used = distances[: int(2.0 * math.pi / step + 1e-3)]
    if high > 0.0:
        beyond = high
    else:
        beyond = math.inf
    # NaN where nothing is known; at its least distance or nearer a sensor says nothing either.
    known = tuple([NAN if not d > low else math.inf if d >= beyond else d for d in used])
    bearings = tuple([offset + k * step for k in range(len(used))])
    return samples.Ring(*head, bearings, known, frame in _NORTHWARD_FRAMES)


def esc_telemetry(
    first_esc: int, head: Head, name: str, rpm: Any, temperature: Any, count: Any
) -> samples.RotorSpeeds:
    return samples.RotorSpeeds(*head, first_esc, rpm, name, tuple(count), temperature)


def esc_status(head: Head, name: str, rpm: Any, index: int) -> samples.RotorSpeeds:
    return samples.RotorSpeeds(*head, index + 1, rpm, name)


def esc_info(head: Head, _: str, temperature: Any, _index: int) -> samples.EscTemperatures:
    return samples.EscTemperatures(*head, temperature)


def rpm(head: Head, name: str, rpm: tuple[float, float]) -> samples.RotorSpeeds | None:
    # ArduPilot says -1 for a sensor that is absent or unhealthy.
    known = tuple(v if v >= 0.0 else NAN for v in rpm)
    if any(not math.isnan(v) for v in known):
        return samples.RotorSpeeds(*head, 1, known, name)
    return None


def raw_rpm(head: Head, name: str, rpm: float, index: int) -> samples.RotorSpeeds | None:
    if rpm >= 0.0:
        return samples.RotorSpeeds(*head, index + 1, (rpm,), name)
    return None


def battery(
    head: Head, name: str, cells: Any, more: Any, current: float, _id: int = 0
) -> samples.Battery | None:
    # Pack voltage in the first place and cells one by one add up alike; above 65 V ArduPilot spreads the pack over two.
    volts = math.fsum(v for v in (*cells, *more) if not math.isnan(v))
    if not volts > 0.0 and math.isnan(current):
        return None
    return samples.Battery(*head, volts if volts > 0.0 else NAN, current, name)


def sys_status(head: Head, name: str, voltage: float, current: float) -> samples.Battery | None:
    return battery(head, name, (voltage,), (), current)


def pressure(head: Head, name: str, pressure: float, temperature: float) -> samples.Pressure | None:
    if pressure > 0.0:
        return samples.Pressure(*head, pressure, temperature, name)
    return None


def attitude_target(
    head: Head, _: str, q: Quaternion, thrust: float
) -> samples.AttitudeTarget | None:
    if not math.isnan(thrust):
        return samples.AttitudeTarget(*head, unit_quaternion(q) or (NAN,) * 4, thrust)
    return None


def parameter(head: Head, _: str, value: float, name: str, kind: int) -> samples.Parameter | None:
    number = parameter_value(value, kind)
    if name and not math.isnan(number):
        return samples.Parameter(*head, name, number)
    return None


def estimator_status(
    head: Head, name: str, ratios: tuple[float, ...], flags: int, accuracy: float = NAN
) -> samples.EstimatorStatus:
    largest = max((r for r in ratios if not math.isnan(r)), default=NAN)
    return samples.EstimatorStatus(*head, flags, accuracy, largest, name)


_SMALLEST_NORMAL = 2.0**-126
"""Smallest float of 32 bits with a full mantissa."""


def parameter_value(value: float, kind: int) -> float:
    """A parameter's number: ArduPilot sends whole numbers as floats, PX4 an integer's bytes in the float's place.

    The bytes of PX4's negative integers near 0 are those of a NaN; they stay unknown. A float below the smallest normal
    one is an integer's bytes whatever ``kind`` says: no parameter is so small.
    """
    if not math.isfinite(value) or value == 0.0:
        return value
    declared = 1 <= kind <= 8 and not (abs(value) >= 1.0 and value.is_integer())
    if not declared and abs(value) >= _SMALLEST_NORMAL:
        return value
    (number,) = struct.unpack("<i" if kind in (2, 4, 6, 8) else "<I", struct.pack("<f", value))
    return float(number)
