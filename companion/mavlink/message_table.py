"""The one place where wire units become SI: a table of messages, for flight (one at a time) and for logs (in columns).

``LAYOUTS`` says for every message used which fields make which quantity, their unit on the wire, which value means
"unknown" and what is too large to be true. ``decode`` applies it to one message, ``columns`` to an array of many.

Rules, for any byte content: nothing raises. An unknown, non-finite or absurd number becomes NaN; a sample whose
docstring (samples.py) does not allow NaN where it would be is not made (None). Messages not in the table give None.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from numpy.typing import NDArray

from companion.mavlink import sample_builders as build
from companion.mavlink import samples
from companion.mavlink.boot_clock import BootClock, Stamp
from companion.mavlink.wire_frames import Frame, unpacked
from companion.mavlink.wire_layout import SI, Layout, Raw

_ACC_LIMIT, _GYRO_LIMIT, _RPM_LIMIT = 2000.0, 200.0, 200_000.0
"""m/s^2, rad/s, rpm: ten times what sensors reach, and what no hobby motor does; a larger number is damage."""
_MS = Stamp.BOOT_MS
_US = Stamp.US64
_RATES = SI("rates", "rollspeed pitchspeed yawspeed", "rad/s", _GYRO_LIMIT)
_PLACE = (SI("position", "x y z", "m", 1e6), SI("velocity", "vx vy vz", "m/s", 1e3))
_SCALED = (
    SI("force", "xacc yacc zacc", "mG", _ACC_LIMIT),
    SI("gyro", "xgyro ygyro zgyro", "mrad/s", _GYRO_LIMIT),
)
_PRESSURE = (
    SI("pressure", "press_abs", "hPa", 1e6),
    SI("temperature", "temperature", "cdegC", 200.0),
)
_RPM = SI("rpm", "rpm", "rpm", _RPM_LIMIT, unknown=(2**16 - 1, -1))
_TARGET_Q = SI("q", "q", "", 2.0)
_THRUST = SI("thrust", "thrust", "", 10.0)
_TARGETS = (Raw("target_system"), Raw("target_component"))

_TABLE = (
    Layout("HEARTBEAT", None, build.heartbeat, Raw("base_mode"), Raw("custom_mode"), Raw("autopilot"), Raw("type")),
    Layout("ATTITUDE", _MS, build.attitude, SI("euler", "roll pitch yaw", "rad", 7.0), _RATES),
    Layout("ATTITUDE_QUATERNION", _MS, build.attitude_quaternion, SI("q", "q1 q2 q3 q4", "", 2.0), _RATES),
    Layout("LOCAL_POSITION_NED", _MS, build.position, *_PLACE),
    Layout(
        "HIGHRES_IMU", _US, build.highres_imu,
        SI("force", "xacc yacc zacc", "m/s/s", _ACC_LIMIT), SI("gyro", "xgyro ygyro zgyro", "rad/s", _GYRO_LIMIT),
        Raw("fields_updated"), Raw("id"),
    ),
    # ArduPilot's RAW_IMU is in the units of SCALED_IMU; PX4 sends none.
    Layout("RAW_IMU", _US, build.imu, *_SCALED, Raw("id")),
    *(Layout(name, _MS, build.imu, *_SCALED) for name in ("SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")),
    Layout(
        "DISTANCE_SENSOR", _MS, build.distance_sensor,
        SI("distance", "current_distance", "cm"), SI("limits", "min_distance max_distance", "cm"),
        SI("variance", "covariance", "cm^2", unknown=(0, 255)), SI("q", "quaternion", "", 2.0),
        Raw("orientation"), Raw("id"), Raw("signal_quality"),
    ),
    Layout("RANGEFINDER", None, build.rangefinder, SI("distance", "distance", "m", 1e4)),
    Layout(
        "OBSTACLE_DISTANCE", _US, build.obstacle_distance,
        SI("distances", "distances", "cm", unknown=(65535,)), SI("limits", "min_distance max_distance", "cm"),
        SI("steps", "increment increment_f", "deg", 7.0), SI("offset", "angle_offset", "deg", 100.0), Raw("frame"),
    ),
    *(
        Layout(
            f"ESC_TELEMETRY_{first}_TO_{first + 3}", None, partial(build.esc_telemetry, first), _RPM,
            SI("temperature", "temperature", "degC"), Raw("count"),
        )
        for first in range(1, 30, 4)
    ),
    Layout("ESC_STATUS", _US, build.esc_status, _RPM, Raw("index")),
    Layout(
        "ESC_INFO", _US, build.esc_info, SI("temperature", "temperature", "cdegC", unknown=(2**15 - 1,)), Raw("index")
    ),
    Layout("RPM", None, build.rpm, SI("rpm", "rpm1 rpm2", "rpm", _RPM_LIMIT)),
    Layout("RAW_RPM", None, build.raw_rpm, SI("rpm", "frequency", "rpm", _RPM_LIMIT), Raw("index")),
    Layout(
        "BATTERY_STATUS", None, build.battery,
        SI("cells", "voltages", "mV", unknown=(65535,)), SI("more_cells", "voltages_ext", "mV", unknown=(0, 65535)),
        SI("current", "current_battery", "cA", unknown=(-1,)), Raw("id"),
    ),
    Layout(
        "SYS_STATUS", None, build.sys_status,
        SI("voltage", "voltage_battery", "mV", unknown=(65535,)), SI("current", "current_battery", "cA", unknown=(-1,)),
    ),
    *(Layout(f"SCALED_PRESSURE{number}", _MS, build.pressure, *_PRESSURE) for number in ("", "2", "3")),
    Layout(
        "SERVO_OUTPUT_RAW", Stamp.BOOT_US32, build.as_it_is(samples.ServoOutput),
        SI("pwm", " ".join(f"servo{i}_raw" for i in range(1, 17)), "us", unknown=(65535,)), Raw("port"),
    ),
    Layout("ATTITUDE_TARGET", _MS, build.attitude_target, _TARGET_Q, _THRUST),
    # The stamps of commands are their sender's business: they count when they arrive.
    Layout(
        "SET_ATTITUDE_TARGET", None, build.as_it_is(samples.SetAttitudeTarget), Raw("type_mask"), _TARGET_Q,
        SI("rates", "body_roll_rate body_pitch_rate body_yaw_rate", "rad/s", _GYRO_LIMIT), _THRUST, *_TARGETS,
    ),
    Layout(
        "SET_POSITION_TARGET_LOCAL_NED", None, build.as_it_is(samples.SetPositionTarget),
        Raw("type_mask"), Raw("coordinate_frame"), *_PLACE, SI("acceleration", "afx afy afz", "m/s/s", _ACC_LIMIT),
        SI("yaw", "yaw", "", 1e3), *_TARGETS,
    ),
    Layout("PARAM_VALUE", None, build.parameter, SI("value", "param_value"), Raw("param_id"), Raw("param_type")),
    Layout("TIMESYNC", None, None, Raw("tc1"), Raw("ts1")),
    Layout("EXTENDED_SYS_STATE", None, build.as_it_is(samples.LandedState), Raw("landed_state")),
    Layout("WIND_COV", _US, None, SI("wind", "wind_x wind_y wind_z", "m/s", 200.0)),
    Layout("WIND", None, None, SI("direction", "direction", "deg", 100.0), SI("speed", "speed speed_z", "m/s", 200.0)),
    Layout(
        "VIBRATION", _US, None, SI("level", "vibration_x vibration_y vibration_z", "m/s/s", 1e6),
        Raw("clipping_0"), Raw("clipping_1"), Raw("clipping_2"),
    ),
    Layout(
        "EKF_STATUS_REPORT", None, build.estimator_status,
        SI("ratios", "velocity_variance pos_horiz_variance", "", 1e6), Raw("flags"),
    ),
    Layout(
        "ESTIMATOR_STATUS", _US, build.estimator_status, SI("ratios", "vel_ratio pos_horiz_ratio", "", 1e6),
        Raw("flags"), SI("accuracy", "pos_horiz_accuracy", "m", 1e6),
    ),
    Layout("GPS_RAW_INT", _US, None, Raw("fix_type")),
    Layout("STATUSTEXT", None, None, Raw("severity"), Raw("text")),
)  # fmt: skip

LAYOUTS: dict[int, Layout] = {layout.id: layout for layout in _TABLE}
"""Every message used, by id."""


def decode(frame: Frame, arrival_us: int, clock: BootClock) -> samples.Sample | None:
    """The sample in one frame, on the boot axis of ``clock`` (which it advances), or None.

    ``arrival_us``: the receiver's clock when the frame arrived, whole microseconds. MAVLink 2 cuts trailing zeros of a
    payload, and a later version of a message may append fields: the one is filled up, the other left out.
    """
    layout = LAYOUTS.get(frame.id)
    if layout is None:
        return None
    _, system, component, payload, _ = frame
    fields = unpacked(frame.id, payload)
    stamp = layout.stamp
    if stamp is None:
        t_s = clock.unstamped(arrival_us)
    else:
        t_s = clock.stamped(system, component, stamp, fields[layout.stamp_place], arrival_us)
    if layout.build is None:
        return None
    sample = layout.build(
        (t_s, system, component), layout.name, *[read(fields) for read in layout.readers]
    )
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
