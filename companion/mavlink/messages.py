"""The one place where wire units become SI: a table of messages, for flight (one at a time) and for logs (in columns).

``LAYOUTS`` says for every message used which fields make which quantity, their unit on the wire, which value means
"unknown" and what is too large to be true. ``decode`` applies it to one message, ``columns`` to an array of many.

Rules, for any byte content: nothing raises. An unknown, non-finite or absurd number becomes NaN; a sample whose
docstring (samples.py) does not allow NaN where it would be is not made (None). Messages not in the table give None.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.boot_clock import BootClock, Stamp
from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import BY_ID as ESC_BY_ID
from companion.mavlink.esc_messages import parse_frame
from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    Battery,
    CommandAck,
    EscHealth,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Parameter,
    Pressure,
    Quaternion,
    Range,
    RangeVerdict,
    RotorSpeeds,
    Sample,
    ServoOutput,
    SetAttitudeTarget,
    SetPositionTarget,
    Statustext,
    Timesync,
    Vector3,
    Vibration,
    Wind,
)
from models.frames import GRAVITY

__all__ = [
    "LAYOUTS", "Attitude", "AttitudeTarget", "Battery", "CommandAck", "EscHealth", "Heartbeat", "Imu", "LandedState",
    "Layout", "LocalPosition", "Parameter", "Pressure", "Range", "RangeVerdict", "RotorSpeeds", "Sample", "ServoOutput",
    "SetAttitudeTarget", "SetPositionTarget", "Statustext", "Timesync", "Vibration", "Wind", "beam_direction",
    "columns", "decode", "id_of", "orientation_direction", "parameter_value", "range_verdict", "source_of",
    "wire_dtype",
]  # fmt: skip

NAN = math.nan
PER_SI = {
    "": 1.0, "rad": 1.0, "rad/s": 1.0, "m": 1.0, "m/s": 1.0, "m/s/s": 1.0, "V": 1.0, "A": 1.0, "degC": 1.0, "us": 1.0,
    "rpm": 1.0, "deg": math.degrees(1.0), "cm": 100.0, "cm^2": 1e4, "mV": 1000.0, "cV": 100.0, "cA": 100.0,
    "cdegC": 100.0, "hPa": 0.01, "mrad/s": 1000.0, "mG": 1000.0 / GRAVITY,
}  # fmt: skip
"""Wire units in one unit used inside: SI, but for rpm, us of a servo pulse and deg C."""

_ACC_LIMIT, _GYRO_LIMIT, _RPM_LIMIT = 2000.0, 200.0, 200_000.0


# --- What the table is made of ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Quantity:
    """Wire fields that make one quantity of ``len`` numbers, converted to ``PER_SI`` units; |value| > limit is NaN."""

    name: str
    fields: tuple[str, ...]
    unit: str = ""
    limit: float = math.inf
    unknown: tuple[int, ...] = ()
    array: bool = False
    """True where the one field is an array on the wire."""
    read: Callable[[Any], Any] = field(init=False, repr=False, compare=False)
    per: float = field(init=False)

    def __post_init__(self) -> None:
        # Looked up once: this runs for every number of every message.
        object.__setattr__(self, "read", attrgetter(*self.fields))
        object.__setattr__(self, "per", PER_SI[self.unit])
        # The largest float, so that one comparison also turns inf into NaN.
        object.__setattr__(self, "limit", min(self.limit, sys.float_info.max))

    def scalar(self, message: Any) -> tuple[float, ...]:
        """The numbers of one message."""
        per, limit, unknown = self.per, self.limit, self.unknown
        raw = self.read(message)
        if len(self.fields) == 1 and not self.array:
            raw = (raw,)
        # A comparison with NaN is false, so NaN stays NaN.
        if unknown:
            return tuple([v if x not in unknown and -limit <= (v := x / per) <= limit else NAN for x in raw])
        return tuple([v if -limit <= (v := x / per) <= limit else NAN for x in raw])

    def column(self, records: NDArray[Any]) -> NDArray[np.float64]:
        """The numbers of many messages, shape (n, k)."""
        raw = records[self.fields[0]] if self.array else np.stack([records[f] for f in self.fields], axis=-1)
        with np.errstate(over="ignore", invalid="ignore"):
            out: NDArray[np.float64] = raw.astype(np.float64) / self.per
            bad = ~(np.abs(out) <= self.limit)
        if self.unknown:
            bad |= np.isin(raw, self.unknown)
        out[bad] = NAN
        return out


@dataclass(frozen=True, slots=True)
class Raw:
    """Whole numbers or text taken as they are."""

    field: str

    @property
    def name(self) -> str:
        """The quantity is called as on the wire."""
        return self.field

    def scalar(self, message: Any) -> Any:
        """The value of one message."""
        return getattr(message, self.field)

    def column(self, records: NDArray[Any]) -> NDArray[Any]:
        """The values of many messages, shape (n,) or (n, k)."""
        out: NDArray[Any] = records[self.field]
        return out


Head = tuple[float, int, int]


@dataclass(frozen=True, slots=True)
class Layout:
    """One message: its id and name, what stamps it, its quantities in the builder's order, and the builder."""

    id: int
    name: str
    stamp: Stamp | None
    quantities: tuple[Quantity | Raw, ...]
    build: Callable[..., Sample | None]

    @property
    def stamp_field(self) -> str:
        """Name of the time field on the wire."""
        return "time_boot_ms" if self.stamp is Stamp.BOOT_MS else "time_usec"


# --- Builders: quantities of one message to a sample ------------------------------------------------------------------


def _finite(*groups: tuple[float, ...]) -> bool:
    """True where there is no NaN (inf never gets this far, and the limits keep the sum from reaching it)."""
    total = sum([sum(group) for group in groups])
    return total == total


def _unit(q: tuple[float, ...]) -> Quaternion | None:
    """A quaternion of length 1, or None where it is none: NaN, or a length more than 10 % off."""
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 <= norm <= 1.1:
        return None
    return (w / norm, x / norm, y / norm, z / norm)


def _heartbeat(head: Head, _: str, base: int, custom: int, autopilot: int, kind: int, status: int) -> Heartbeat:
    return Heartbeat(*head, bool(base & 128), custom, base, autopilot, kind, status)


def _attitude(head: Head, name: str, euler: Vector3, rates: Vector3) -> Attitude | None:
    if not _finite(euler, rates):
        return None
    roll, pitch, yaw = euler[0] / 2.0, euler[1] / 2.0, euler[2] / 2.0
    cr, cp, cy = math.cos(roll), math.cos(pitch), math.cos(yaw)
    sr, sp, sy = math.sin(roll), math.sin(pitch), math.sin(yaw)
    q = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return Attitude(*head, q, rates, name)


def _attitude_quaternion(head: Head, name: str, q: Quaternion, rates: Vector3) -> Attitude | None:
    unit = _unit(q)
    return Attitude(*head, unit, rates, name) if unit is not None and _finite(rates) else None


def _position(head: Head, _: str, position: Vector3, velocity: Vector3) -> LocalPosition | None:
    return LocalPosition(*head, position, velocity) if _finite(position, velocity) else None


def _imu_source(name: str, sensor: int) -> str:
    return f"{name}:{sensor}" if sensor else name


def _highres_imu(head: Head, name: str, force: Vector3, gyro: Vector3, updated: int, sensor: int) -> Imu | None:
    if updated & 63 == 63:
        return Imu(*head, force, gyro, _imu_source(name, sensor))
    if not updated & 63:
        return None
    flags = [bool(updated >> bit & 1) for bit in range(6)]
    fx, fy, fz, gx, gy, gz = (v if on else NAN for v, on in zip((*force, *gyro), flags, strict=True))
    return Imu(*head, (fx, fy, fz), (gx, gy, gz), _imu_source(name, sensor))


def _raw_imu(head: Head, name: str, force: Vector3, gyro: Vector3, sensor: int) -> Imu:
    return Imu(*head, force, gyro, _imu_source(name, sensor))


def _scaled_imu(head: Head, name: str, force: Vector3, gyro: Vector3) -> Imu:
    return Imu(*head, force, gyro, name)


def _distance_sensor(
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


def _rangefinder(head: Head, name: str, distance: tuple[float]) -> Range | None:
    if distance[0] != distance[0]:
        return None
    verdict = range_verdict(distance[0], NAN, NAN, 0, True)
    return Range(*head, DOWN, 25, 0, distance[0], NAN, NAN, None, None, verdict, name)


def _esc_telemetry(first_esc: int) -> Callable[..., RotorSpeeds]:
    def build(head: Head, name: str, rpm: Any, temperature: Any, voltage: Any, current: Any, count: Any) -> RotorSpeeds:
        health = EscHealth(*head, first_esc, temperature, voltage, current)
        return RotorSpeeds(*head, first_esc, rpm, name, tuple(count), health)

    return build


def _esc_status(head: Head, name: str, rpm: Any, voltage: Any, current: Any, index: int) -> RotorSpeeds:
    health = EscHealth(*head, index + 1, (NAN,) * 4, voltage, current)
    return RotorSpeeds(*head, index + 1, rpm, name, None, health)


def _esc_info(head: Head, _: str, temperature: Any, index: int, info: int) -> EscHealth:
    online = tuple(bool(info >> i & 1) for i in range(4))
    return EscHealth(*head, index + 1, temperature, (NAN,) * 4, (NAN,) * 4, online)


def _rpm(head: Head, name: str, rpm: tuple[float, float]) -> RotorSpeeds | None:
    # ArduPilot says -1 for a sensor that is absent or unhealthy.
    known = tuple(v if v >= 0.0 else NAN for v in rpm)
    return RotorSpeeds(*head, 1, known, name) if any(v == v for v in known) else None


def _raw_rpm(head: Head, name: str, rpm: tuple[float], index: int) -> RotorSpeeds | None:
    return RotorSpeeds(*head, index + 1, rpm, name) if rpm[0] >= 0.0 else None


def _battery(head: Head, name: str, cells: Any, more: Any, current: tuple[float], battery: int) -> Battery | None:
    # Pack voltage in the first place and cells one by one add up alike; above 65 V ArduPilot spreads the pack over two.
    known = [v for v in (*cells, *more) if v == v]
    voltage = math.fsum(known)
    return _battery_sample(head, name, voltage if voltage > 0.0 else NAN, current[0], battery)


def _sys_status(head: Head, name: str, voltage: tuple[float], current: tuple[float]) -> Battery | None:
    return _battery_sample(head, name, voltage[0] if voltage[0] > 0.0 else NAN, current[0], 0)


def _battery_sample(head: Head, name: str, voltage: float, current: float, battery: int) -> Battery | None:
    return Battery(*head, voltage, current, battery, name) if voltage == voltage or current == current else None


def _pressure(head: Head, name: str, pressure: tuple[float], temperature: tuple[float]) -> Pressure | None:
    return Pressure(*head, pressure[0], temperature[0], name) if pressure[0] > 0.0 else None


def _servo(head: Head, _: str, pwm: tuple[float, ...], port: int) -> ServoOutput:
    return ServoOutput(*head, pwm, port)


def _attitude_target(head: Head, _: str, q: Quaternion, thrust: tuple[float]) -> AttitudeTarget | None:
    return AttitudeTarget(*head, _unit(q) or (NAN,) * 4, thrust[0]) if _finite(thrust) else None


def _set_attitude(
    head: Head, _: str, q: Quaternion, rates: Vector3, thrust: tuple[float], mask: int, system: int, component: int
) -> SetAttitudeTarget:
    return SetAttitudeTarget(*head, mask, q, rates, thrust[0], system, component)


def _set_position(
    head: Head, _: str, position: Vector3, velocity: Vector3, acceleration: Vector3, yaw: tuple[float, float],
    mask: int, frame: int, system: int, component: int,
) -> SetPositionTarget:  # fmt: skip
    return SetPositionTarget(*head, mask, frame, position, velocity, acceleration, yaw[0], yaw[1], system, component)


def _parameter(
    head: Head, _: str, value: tuple[float], name: Any, kind: int, index: int, count: int
) -> Parameter | None:
    number = parameter_value(value[0], kind)
    text = name if isinstance(name, str) else bytes(name).split(b"\0")[0].decode("ascii", "replace")
    return Parameter(*head, text, number, index, count) if text and number == number else None


def _landed(head: Head, _: str, state: int) -> LandedState:
    return LandedState(*head, state)


def _wind_cov(head: Head, name: str, wind: Vector3) -> Wind | None:
    return Wind(*head, wind, name) if _finite(wind[:2]) else None


def _wind(head: Head, name: str, direction: tuple[float], speed: tuple[float, float]) -> Wind | None:
    # The direction is where the wind comes from.
    north, east = -speed[0] * math.cos(direction[0]), -speed[0] * math.sin(direction[0])
    return Wind(*head, (north, east, speed[1]), name) if _finite((north, east)) else None


def _command_ack(head: Head, _: str, command: int, result: int, system: int, component: int) -> CommandAck:
    return CommandAck(*head, command, result, system, component)


def _timesync(head: Head, _: str, tc1: int, ts1: int) -> Timesync:
    return Timesync(*head, tc1, ts1)


def _statustext(head: Head, _: str, severity: int, text: str) -> Statustext:
    return Statustext(*head, severity, text)


def _vibration(head: Head, _: str, level: Vector3, first: int, second: int, third: int) -> Vibration | None:
    return Vibration(*head, level, (first, second, third)) if _finite(level) else None


# --- Rangefinders -----------------------------------------------------------------------------------------------------

DOWN = (0.0, 0.0, 1.0)
CUSTOM_ORIENTATION = 100
LOW_QUALITY_BELOW = 10
"""signal_quality is 1 (invalid) to 100 (best); 0 is "not given"."""


def _pitch_yaw() -> dict[int, tuple[int, int]]:
    """Pitch and yaw [deg] of every MAV_SENSOR_ORIENTATION, from the dialect's names; roll does not turn the beam."""
    out = {}
    for value, entry in mavlink.enums["MAV_SENSOR_ORIENTATION"].items():
        words = entry.name.removeprefix("MAV_SENSOR_ROTATION_").split("_")
        if not entry.name.startswith("MAV_SENSOR_ROTATION_") or words == ["CUSTOM"]:
            continue
        angles = dict(zip(words[::2], words[1::2], strict=False))
        out[value] = (int(angles.get("PITCH", 0)), int(angles.get("YAW", 0)))
    return out


def _beam(pitch_deg: float, yaw_deg: float) -> Vector3:
    pitch, yaw = math.radians(pitch_deg), math.radians(yaw_deg)
    # + 0.0 turns -0.0 into 0.0; rounding takes the 1e-17 out of cos 90 deg.
    x, y, z = math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch)
    return (round(x, 15) + 0.0, round(y, 15) + 0.0, round(z, 15) + 0.0)


_BEAMS = {value: _beam(*angles) for value, angles in _pitch_yaw().items()}


def orientation_direction(orientation: int) -> Vector3 | None:
    """Unit beam (FRD) of a MAV_SENSOR_ORIENTATION: Rz(yaw) Ry(pitch) (1, 0, 0). None for CUSTOM and unknown values."""
    return _BEAMS.get(orientation)


def beam_direction(orientation: int, quaternion: Quaternion) -> Vector3 | None:
    """Unit beam (FRD) of a DISTANCE_SENSOR; a CUSTOM one by its quaternion. None where it cannot be told."""
    if orientation != CUSTOM_ORIENTATION:
        return _BEAMS.get(orientation)
    q = _unit(quaternion)
    if q is None:
        return None
    w, x, y, z = q
    return (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))


def range_verdict(distance_m: float, min_m: float, max_m: float, quality: int, mapped: bool) -> RangeVerdict:
    """What a reading is worth by itself. Sensors say "nothing" with 0, their minimum, their maximum or more."""
    if not mapped:
        return RangeVerdict.UNMAPPED
    if distance_m <= 0.0 or distance_m <= min_m:
        return RangeVerdict.BELOW_MIN
    if distance_m >= max_m:
        return RangeVerdict.ABOVE_MAX
    if 0 < quality < LOW_QUALITY_BELOW:
        return RangeVerdict.LOW_QUALITY
    return RangeVerdict.OK


def parameter_value(value: float, kind: int) -> float:
    """A parameter's number: ArduPilot sends whole numbers as floats, PX4 an integer's bytes in the float's place.

    The bytes of PX4's negative integers near 0 are those of a NaN; they stay unknown.
    """
    if not 1 <= kind <= 8 or not math.isfinite(value) or value == 0.0 or (abs(value) >= 1.0 and value.is_integer()):
        return value
    (number,) = struct.unpack("<i" if kind in (2, 4, 6, 8) else "<I", struct.pack("<f", value))
    return float(number)


# --- The table --------------------------------------------------------------------------------------------------------


def _q(
    name: str,
    fields: str,
    unit: str = "",
    limit: float = math.inf,
    *,
    unknown: tuple[int, ...] = (),
    array: bool = False,
) -> Quantity:
    return Quantity(name, tuple(fields.split()), unit, limit, unknown, array)


def _layout(name: str, stamp: Stamp | None, build: Callable[..., Sample | None], *quantities: Quantity | Raw) -> Layout:
    known = {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}
    return Layout(known[name], name, stamp, quantities, build)


def _esc(message_id: int, build: Callable[..., Sample | None], *quantities: Quantity | Raw) -> Layout:
    return Layout(message_id, ESC_BY_ID[message_id].NAME, Stamp.US64, quantities, build)


_RATES = _q("rates", "rollspeed pitchspeed yawspeed", "rad/s", _GYRO_LIMIT)
_FORCE, _GYRO = _q("force", "xacc yacc zacc", "mG", _ACC_LIMIT), _q("gyro", "xgyro ygyro zgyro", "mrad/s", _GYRO_LIMIT)
_TARGET_Q, _THRUST = _q("q", "q", "", 2.0, array=True), _q("thrust", "thrust", "", 10.0)
_TARGETS = (Raw("target_system"), Raw("target_component"))
_PRESSURE = (_q("pressure", "press_abs", "hPa", 1e6), _q("temperature", "temperature", "cdegC", 200.0))
_MS = Stamp.BOOT_MS


def _esc_telemetry_layouts() -> list[Layout]:
    return [
        _layout(
            f"ESC_TELEMETRY_{first}_TO_{first + 3}", None, _esc_telemetry(first),
            _q("rpm", "rpm", "rpm", _RPM_LIMIT, array=True),
            _q("temperature", "temperature", "degC", array=True),
            _q("voltage", "voltage", "cV", array=True),
            _q("current", "current", "cA", array=True),
            Raw("count"),
        )
        for first in range(1, 30, 4)
    ]  # fmt: skip


_TABLE = (
    _layout(
        "HEARTBEAT", None, _heartbeat,
        Raw("base_mode"), Raw("custom_mode"), Raw("autopilot"), Raw("type"), Raw("system_status"),
    ),
    _layout("ATTITUDE", _MS, _attitude, _q("euler", "roll pitch yaw", "rad", 7.0), _RATES),
    _layout("ATTITUDE_QUATERNION", _MS, _attitude_quaternion, _q("q", "q1 q2 q3 q4", "", 2.0), _RATES),
    _layout(
        "LOCAL_POSITION_NED", _MS, _position,
        _q("position", "x y z", "m", 1e6), _q("velocity", "vx vy vz", "m/s", 1e3),
    ),
    _layout(
        "HIGHRES_IMU", Stamp.US64, _highres_imu,
        _q("force", "xacc yacc zacc", "m/s/s", _ACC_LIMIT), _q("gyro", "xgyro ygyro zgyro", "rad/s", _GYRO_LIMIT),
        Raw("fields_updated"), Raw("id"),
    ),
    # ArduPilot's RAW_IMU is in the units of SCALED_IMU; PX4 sends none.
    _layout("RAW_IMU", Stamp.US64, _raw_imu, _FORCE, _GYRO, Raw("id")),
    _layout("SCALED_IMU", _MS, _scaled_imu, _FORCE, _GYRO),
    _layout("SCALED_IMU2", _MS, _scaled_imu, _FORCE, _GYRO),
    _layout("SCALED_IMU3", _MS, _scaled_imu, _FORCE, _GYRO),
    _layout(
        "DISTANCE_SENSOR", _MS, _distance_sensor,
        _q("distance", "current_distance", "cm"), _q("limits", "min_distance max_distance", "cm"),
        _q("variance", "covariance", "cm^2", unknown=(0, 255)), _q("q", "quaternion", "", 2.0, array=True),
        Raw("orientation"), Raw("id"), Raw("signal_quality"),
    ),
    _layout("RANGEFINDER", None, _rangefinder, _q("distance", "distance", "m", 1e4)),
    *_esc_telemetry_layouts(),
    _esc(
        291, _esc_status,
        _q("rpm", "rpm", "rpm", _RPM_LIMIT, array=True), _q("voltage", "voltage", "V", 1e4, array=True),
        _q("current", "current", "A", 1e5, array=True), Raw("index"),
    ),
    _esc(
        290, _esc_info,
        _q("temperature", "temperature", "cdegC", unknown=(2**15 - 1,), array=True), Raw("index"), Raw("info"),
    ),
    _layout("RPM", None, _rpm, _q("rpm", "rpm1 rpm2", "rpm", _RPM_LIMIT)),
    _layout("RAW_RPM", None, _raw_rpm, _q("rpm", "frequency", "rpm", _RPM_LIMIT), Raw("index")),
    _layout(
        "BATTERY_STATUS", None, _battery,
        _q("cells", "voltages", "mV", unknown=(65535,), array=True),
        _q("more_cells", "voltages_ext", "mV", unknown=(0, 65535), array=True),
        _q("current", "current_battery", "cA", unknown=(-1,)), Raw("id"),
    ),
    _layout(
        "SYS_STATUS", None, _sys_status,
        _q("voltage", "voltage_battery", "mV", unknown=(65535,)), _q("current", "current_battery", "cA", unknown=(-1,)),
    ),
    _layout("SCALED_PRESSURE", _MS, _pressure, *_PRESSURE),
    _layout("SCALED_PRESSURE2", _MS, _pressure, *_PRESSURE),
    _layout("SCALED_PRESSURE3", _MS, _pressure, *_PRESSURE),
    _layout(
        "SERVO_OUTPUT_RAW", Stamp.BOOT_US32, _servo,
        _q("pwm", " ".join(f"servo{i}_raw" for i in range(1, 17)), "us", unknown=(65535,)), Raw("port"),
    ),
    _layout("ATTITUDE_TARGET", _MS, _attitude_target, _TARGET_Q, _THRUST),
    # The stamps of commands are their sender's business: they count when they arrive.
    _layout(
        "SET_ATTITUDE_TARGET", None, _set_attitude,
        _TARGET_Q, _q("rates", "body_roll_rate body_pitch_rate body_yaw_rate", "rad/s", _GYRO_LIMIT), _THRUST,
        Raw("type_mask"), *_TARGETS,
    ),
    _layout(
        "SET_POSITION_TARGET_LOCAL_NED", None, _set_position,
        _q("position", "x y z", "m", 1e6), _q("velocity", "vx vy vz", "m/s", 1e3),
        _q("acceleration", "afx afy afz", "m/s/s", _ACC_LIMIT), _q("yaw", "yaw yaw_rate", "", 1e3),
        Raw("type_mask"), Raw("coordinate_frame"), *_TARGETS,
    ),
    _layout(
        "PARAM_VALUE", None, _parameter,
        _q("value", "param_value"), Raw("param_id"), Raw("param_type"), Raw("param_index"), Raw("param_count"),
    ),
    _layout("EXTENDED_SYS_STATE", None, _landed, Raw("landed_state")),
    _layout("WIND_COV", Stamp.US64, _wind_cov, _q("wind", "wind_x wind_y wind_z", "m/s", 200.0)),
    _layout(
        "WIND", None, _wind, _q("direction", "direction", "deg", 100.0), _q("speed", "speed speed_z", "m/s", 200.0)
    ),
    _layout(
        "VIBRATION", Stamp.US64, _vibration,
        _q("level", "vibration_x vibration_y vibration_z", "m/s/s", 1e6),
        Raw("clipping_0"), Raw("clipping_1"), Raw("clipping_2"),
    ),
    _layout("COMMAND_ACK", None, _command_ack, Raw("command"), Raw("result"), *_TARGETS),
    _layout("TIMESYNC", None, _timesync, Raw("tc1"), Raw("ts1")),
    _layout("STATUSTEXT", None, _statustext, Raw("severity"), Raw("text")),
)  # fmt: skip

LAYOUTS: dict[int, Layout] = {layout.id: layout for layout in _TABLE}
"""Every message used, by id."""
_BY_NAME = {layout.name: layout for layout in _TABLE}


# --- One message, and many --------------------------------------------------------------------------------------------


def decode(message: Any, arrival_us: int, clock: BootClock) -> Sample | None:
    """The sample in one message, on the boot axis of ``clock`` (which it advances), or None.

    ``message``: a pymavlink message of the dialect, or what pymavlink makes of a frame it does not know
    (``UNKNOWN_291``). ``arrival_us``: the receiver's clock when the frame arrived, whole microseconds.
    """
    layout = _BY_NAME.get(message.get_type())
    if layout is None:
        if not isinstance(message, mavlink.MAVLink_unknown):
            return None
        message = parse_frame(message.get_msgbuf())
        if message is None:
            return None
        layout = LAYOUTS[message.ID]
        system, component = message.system, message.component
    else:
        system, component = message.get_srcSystem(), message.get_srcComponent()
    if layout.stamp is None:
        t_s = clock.unstamped(arrival_us)
    else:
        t_s = clock.stamped(system, component, layout.stamp, getattr(message, layout.stamp_field), arrival_us)
    return layout.build((t_s, system, component), layout.name, *[q.scalar(message) for q in layout.quantities])


def source_of(message: Any) -> tuple[int, int]:
    """System and component that sent a message. pymavlink does not read the header of a frame it does not know."""
    if not isinstance(message, mavlink.MAVLink_unknown):
        return message.get_srcSystem(), message.get_srcComponent()
    frame = message.get_msgbuf()
    return (frame[5], frame[6]) if frame[0] == mavlink.PROTOCOL_MARKER_V2 else (frame[3], frame[4])


def id_of(message: Any) -> int:
    """Message id, also of a frame that pymavlink does not know (which it numbers -2)."""
    if not isinstance(message, mavlink.MAVLink_unknown):
        return int(message.get_msgId())
    return int(message.get_type().removeprefix("UNKNOWN_"))


def columns(layout: Layout, records: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Quantities of many messages of one kind, by name: shape (n, k) in SI, or as on the wire where taken raw.

    ``records``: structured array (n,) of ``wire_dtype(layout.id)``.
    """
    return {q.name: q.column(records) for q in layout.quantities}


_SCALARS = {
    "b": "i1",
    "B": "u1",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "q": "<i8",
    "Q": "<u8",
    "f": "<f4",
    "d": "<f8",
}


def wire_dtype(message_id: int) -> np.dtype[Any]:
    """Packed structured dtype of a message's payload, fields in wire order under their own names; text is bytes."""
    if message_id in mavlink.mavlink_map:
        kind = mavlink.mavlink_map[message_id]
        names, formats = kind.ordered_fieldnames, _formats(kind.unpacker.format)
    else:
        names, formats = _ESC_FIELDS[message_id], _formats(ESC_BY_ID[message_id].PAYLOAD.format)
    return np.dtype(list(zip(names, formats, strict=True)))


_ESC_FIELDS = {
    290: (
        "time_usec",
        "error_count",
        "counter",
        "failure_flags",
        "temperature",
        "index",
        "count",
        "connection_type",
        "info",
    ),
    291: ("time_usec", "rpm", "voltage", "current", "index"),
}


def _formats(text: str) -> list[Any]:
    """numpy formats of a struct format string such as ``<IHH4f16sB``: one per field, repeats as sub-arrays."""
    out: list[Any] = []
    i = 1
    while i < len(text):
        j = i
        while text[j].isdigit():
            j += 1
        repeat, code, i = text[i:j], text[j], j + 1
        if code == "s":
            out.append(f"S{repeat or 1}")
        else:
            out.append((_SCALARS[code], (int(repeat),)) if repeat else _SCALARS[code])
    return out
