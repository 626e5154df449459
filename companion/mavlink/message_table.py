"""The one place where wire units become SI: a table of messages, for flight (one at a time) and for logs (in columns).

``LAYOUTS`` says for every message used which fields make which quantity, their unit on the wire, which value means
"unknown" and what is too large to be true. ``decode`` applies it to one message, ``columns`` to an array of many.

Rules, for any byte content: nothing raises. An unknown, non-finite or absurd number becomes NaN; a sample whose
docstring (samples.py) does not allow NaN where it would be is not made (None). Messages not in the table give None.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from companion.mavlink import sample_builders as build
from companion.mavlink.boot_clock import BootClock, Stamp
from companion.mavlink.dialect import ID_OF
from companion.mavlink.frames import Frame, unpacked
from companion.mavlink.samples import Sample
from companion.mavlink.wire_layout import Layout, Quantity, Raw

_ACC_LIMIT, _GYRO_LIMIT, _RPM_LIMIT = 2000.0, 200.0, 200_000.0
"""m/s^2, rad/s, rpm: ten times what sensors reach, and what no hobby motor does; a larger number is damage."""


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


def _layout(
    name: str, stamp: Stamp | None, made: Callable[..., Sample | None] | None, *quantities: Quantity | Raw
) -> Layout:
    """``made`` None: read in logs only."""
    return Layout(ID_OF[name], name, stamp, quantities, made)


_RATES = _q("rates", "rollspeed pitchspeed yawspeed", "rad/s", _GYRO_LIMIT)
_FORCE, _GYRO = _q("force", "xacc yacc zacc", "mG", _ACC_LIMIT), _q("gyro", "xgyro ygyro zgyro", "mrad/s", _GYRO_LIMIT)
_TARGET_Q, _THRUST = _q("q", "q", "", 2.0, array=True), _q("thrust", "thrust", "", 10.0)
_TARGETS = (Raw("target_system"), Raw("target_component"))
_PRESSURE = (_q("pressure", "press_abs", "hPa", 1e6), _q("temperature", "temperature", "cdegC", 200.0))
_MS = Stamp.BOOT_MS


def _esc_telemetry_layouts() -> list[Layout]:
    return [
        _layout(
            f"ESC_TELEMETRY_{first}_TO_{first + 3}", None, build.esc_telemetry(first),
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
        "HEARTBEAT", None, build.heartbeat,
        Raw("base_mode"), Raw("custom_mode"), Raw("autopilot"), Raw("type"), Raw("system_status"),
    ),
    _layout("ATTITUDE", _MS, build.attitude, _q("euler", "roll pitch yaw", "rad", 7.0), _RATES),
    _layout("ATTITUDE_QUATERNION", _MS, build.attitude_quaternion, _q("q", "q1 q2 q3 q4", "", 2.0), _RATES),
    _layout(
        "LOCAL_POSITION_NED", _MS, build.position,
        _q("position", "x y z", "m", 1e6), _q("velocity", "vx vy vz", "m/s", 1e3),
    ),
    _layout(
        "HIGHRES_IMU", Stamp.US64, build.highres_imu,
        _q("force", "xacc yacc zacc", "m/s/s", _ACC_LIMIT), _q("gyro", "xgyro ygyro zgyro", "rad/s", _GYRO_LIMIT),
        Raw("fields_updated"), Raw("id"),
    ),
    # ArduPilot's RAW_IMU is in the units of SCALED_IMU; PX4 sends none.
    _layout("RAW_IMU", Stamp.US64, build.raw_imu, _FORCE, _GYRO, Raw("id")),
    _layout("SCALED_IMU", _MS, build.scaled_imu, _FORCE, _GYRO),
    _layout("SCALED_IMU2", _MS, build.scaled_imu, _FORCE, _GYRO),
    _layout("SCALED_IMU3", _MS, build.scaled_imu, _FORCE, _GYRO),
    _layout(
        "DISTANCE_SENSOR", _MS, build.distance_sensor,
        _q("distance", "current_distance", "cm"), _q("limits", "min_distance max_distance", "cm"),
        _q("variance", "covariance", "cm^2", unknown=(0, 255)), _q("q", "quaternion", "", 2.0, array=True),
        Raw("orientation"), Raw("id"), Raw("signal_quality"),
    ),
    _layout("RANGEFINDER", None, build.rangefinder, _q("distance", "distance", "m", 1e4)),
    _layout(
        "OBSTACLE_DISTANCE", Stamp.US64, build.obstacle_distance,
        _q("distances", "distances", "cm", unknown=(65535,), array=True),
        _q("limits", "min_distance max_distance", "cm"), _q("steps", "increment increment_f", "deg", 7.0),
        _q("offset", "angle_offset", "deg", 100.0), Raw("frame"),
    ),
    *_esc_telemetry_layouts(),
    _layout(
        "ESC_STATUS", Stamp.US64, build.esc_status,
        _q("rpm", "rpm", "rpm", _RPM_LIMIT, array=True), _q("voltage", "voltage", "V", 1e4, array=True),
        _q("current", "current", "A", 1e5, array=True), Raw("index"),
    ),
    _layout(
        "ESC_INFO", Stamp.US64, build.esc_info,
        _q("temperature", "temperature", "cdegC", unknown=(2**15 - 1,), array=True), Raw("index"), Raw("info"),
    ),
    _layout("RPM", None, build.rpm, _q("rpm", "rpm1 rpm2", "rpm", _RPM_LIMIT)),
    _layout("RAW_RPM", None, build.raw_rpm, _q("rpm", "frequency", "rpm", _RPM_LIMIT), Raw("index")),
    _layout(
        "BATTERY_STATUS", None, build.battery,
        _q("cells", "voltages", "mV", unknown=(65535,), array=True),
        _q("more_cells", "voltages_ext", "mV", unknown=(0, 65535), array=True),
        _q("current", "current_battery", "cA", unknown=(-1,)), Raw("id"),
    ),
    _layout(
        "SYS_STATUS", None, build.sys_status,
        _q("voltage", "voltage_battery", "mV", unknown=(65535,)), _q("current", "current_battery", "cA", unknown=(-1,)),
    ),
    _layout("SCALED_PRESSURE", _MS, build.pressure, *_PRESSURE),
    _layout("SCALED_PRESSURE2", _MS, build.pressure, *_PRESSURE),
    _layout("SCALED_PRESSURE3", _MS, build.pressure, *_PRESSURE),
    _layout(
        "SERVO_OUTPUT_RAW", Stamp.BOOT_US32, build.servo,
        _q("pwm", " ".join(f"servo{i}_raw" for i in range(1, 17)), "us", unknown=(65535,)), Raw("port"),
    ),
    _layout("ATTITUDE_TARGET", _MS, build.attitude_target, _TARGET_Q, _THRUST),
    # The stamps of commands are their sender's business: they count when they arrive.
    _layout(
        "SET_ATTITUDE_TARGET", None, build.set_attitude,
        _TARGET_Q, _q("rates", "body_roll_rate body_pitch_rate body_yaw_rate", "rad/s", _GYRO_LIMIT), _THRUST,
        Raw("type_mask"), *_TARGETS,
    ),
    _layout(
        "SET_POSITION_TARGET_LOCAL_NED", None, build.set_position,
        _q("position", "x y z", "m", 1e6), _q("velocity", "vx vy vz", "m/s", 1e3),
        _q("acceleration", "afx afy afz", "m/s/s", _ACC_LIMIT), _q("yaw", "yaw yaw_rate", "", 1e3),
        Raw("type_mask"), Raw("coordinate_frame"), *_TARGETS,
    ),
    _layout(
        "PARAM_VALUE", None, build.parameter,
        _q("value", "param_value"), Raw("param_id"), Raw("param_type"), Raw("param_index"), Raw("param_count"),
    ),
    _layout("TIMESYNC", None, None, Raw("tc1"), Raw("ts1")),
    _layout("EXTENDED_SYS_STATE", None, build.landed, Raw("landed_state")),
    _layout("WIND_COV", Stamp.US64, None, _q("wind", "wind_x wind_y wind_z", "m/s", 200.0)),
    _layout(
        "WIND", None, None, _q("direction", "direction", "deg", 100.0), _q("speed", "speed speed_z", "m/s", 200.0)
    ),
    _layout(
        "VIBRATION", Stamp.US64, None,
        _q("level", "vibration_x vibration_y vibration_z", "m/s/s", 1e6),
        Raw("clipping_0"), Raw("clipping_1"), Raw("clipping_2"),
    ),
    _layout(
        "EKF_STATUS_REPORT", None, build.ekf_status,
        _q("ratios", "velocity_variance pos_horiz_variance", "", 1e6), Raw("flags"),
    ),
    _layout(
        "ESTIMATOR_STATUS", Stamp.US64, build.estimator_status,
        _q("ratios", "vel_ratio pos_horiz_ratio", "", 1e6), _q("accuracy", "pos_horiz_accuracy", "m", 1e6),
        Raw("flags"),
    ),
    _layout("STATUSTEXT", None, None, Raw("severity"), Raw("text")),
)  # fmt: skip

LAYOUTS: dict[int, Layout] = {layout.id: layout for layout in _TABLE}
"""Every message used, by id."""


def decode(frame: Frame, arrival_us: int, clock: BootClock) -> Sample | None:
    """The sample in one frame, on the boot axis of ``clock`` (which it advances), or None.

    ``arrival_us``: the receiver's clock when the frame arrived, whole microseconds. MAVLink 2 cuts trailing zeros of a
    payload, and a later version of a message may append fields: the one is filled up, the other left out.
    """
    layout = LAYOUTS.get(frame.id)
    if layout is None:
        return None
    _, system, component, payload, _ = frame
    fields, stamp = unpacked(frame.id, payload), layout.stamp
    if stamp is None:
        t_s = clock.unstamped(arrival_us)
    else:
        t_s = clock.stamped(system, component, stamp, fields[layout.stamp_place], arrival_us)
    if layout.build is None:
        return None
    sample = layout.build((t_s, system, component), layout.name, *[read(fields) for read in layout.readers])
    if sample is not None and stamp is not None:
        # Nobody else has seen the sample yet; a copy of it costs more than all the rest of its decoding.
        object.__setattr__(sample, "late_s", clock.late(t_s, arrival_us))
    return sample


def stamp_of(frame: Frame, arrival_us: int, clock: BootClock) -> None:
    """Advance ``clock`` by the stamp of a frame whose content is not wanted, as ``decode`` would."""
    layout = LAYOUTS[frame.id]
    if layout.stamp is not None:
        stamp = unpacked(frame.id, frame.payload)[layout.stamp_place]
        clock.stamped(frame.system, frame.component, layout.stamp, stamp, arrival_us)


def columns(layout: Layout, records: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Quantities of many messages of one kind, by name: shape (n, k) in SI, or as on the wire where taken raw.

    ``records``: structured array (n,) of ``layout.wire.dtype``.
    """
    return {q.name: q.column(records) for q in layout.quantities}
