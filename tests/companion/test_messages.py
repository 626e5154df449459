"""Wire to SI, message by message; the same numbers one at a time and in columns; no bytes raise."""

import dataclasses
import enum
import math
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from companion.mavlink.boot_clock import BootClock, Stamp
from companion.mavlink.dialect import MESSAGES, mavlink
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS, columns, decode
from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import Attitude, LocalPosition, RangeVerdict
from companion.mavlink.wire_frames import cut, pack
from companion.mavlink.wire_layout import SI
from models.common.frames import quaternion_from_euler, rotation_from_quaternion

ARRIVAL = 1_767_225_642_203_386


def sent(message, system=1, component=1):
    """The message as a frame."""
    return cut(
        bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component))), 0
    )


def sample(message, clock=None, **ids):
    return decode(sent(message, **ids), ARRIVAL, clock or BootClock())


def distance(
    current=83, orientation=25, low=2, high=800, covariance=1, quality=100, q=(0, 0, 0, 0), number=1
):
    return mavlink.MAVLink_distance_sensor_message(
        42_440, low, high, current, 0, number, orientation, covariance, 0, 0, q, quality
    )


def test_heartbeat():
    beat = sample(mavlink.MAVLink_heartbeat_message(2, 3, 137, 4, 4, 3))
    assert (beat.armed, beat.custom_mode, beat.autopilot, beat.vehicle_type) == (True, 4, 3, 2)
    assert not sample(mavlink.MAVLink_heartbeat_message(2, 3, 9, 4, 4, 3)).armed


def test_both_attitudes_agree():
    q = quaternion_from_euler(0.3, -0.2, 2.0)
    euler = sample(mavlink.MAVLink_attitude_message(42_200, 0.3, -0.2, 2.0, 0.1, 0.2, 0.3))
    direct = sample(mavlink.MAVLink_attitude_quaternion_message(42_200, *q, 0.1, 0.2, 0.3))
    assert euler.q_ned_frd == pytest.approx(q, abs=1e-7)
    assert direct.q_ned_frd == pytest.approx(q, abs=1e-7)
    angles = Rotation.from_quat(euler.q_ned_frd, scalar_first=True).as_euler("ZYX")
    assert np.allclose(angles, (2.0, -0.2, 0.3), atol=1e-6)
    assert euler.t_s == direct.t_s == 42.2
    assert (euler.source, direct.source) == ("ATTITUDE", "ATTITUDE_QUATERNION")


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e30])
def test_what_is_not_a_number_is_not_a_sample(bad):
    assert sample(mavlink.MAVLink_attitude_message(1, bad, 0, 0, 0, 0, 0)) is None
    assert sample(mavlink.MAVLink_attitude_quaternion_message(1, bad, 0, 0, 0, 0, 0, 0)) is None
    assert sample(mavlink.MAVLink_attitude_quaternion_message(1, 0, 0, 0, 0, 0, 0, 0)) is None
    assert sample(mavlink.MAVLink_local_position_ned_message(1, 0, 0, 0, bad, 0, 0)) is None
    assert sample(mavlink.MAVLink_rangefinder_message(bad, 0)) is None


def test_imu_units():
    # 1 mG in each message is a thousandth of standard gravity; HIGHRES_IMU is SI already.
    raw = sample(mavlink.MAVLink_raw_imu_message(42_200_000, 100, -50, -1000, 1, 2, -1000, 0, 0, 0))
    assert raw.specific_force_frd == pytest.approx((0.980665, -0.4903325, -9.80665))
    assert raw.gyro_frd == pytest.approx((0.001, 0.002, -1.0))
    scaled = sample(
        mavlink.MAVLink_scaled_imu2_message(42_200, 100, -50, -1000, 1, 2, -1000, 0, 0, 0)
    )
    assert scaled.specific_force_frd == raw.specific_force_frd
    high = sample(
        mavlink.MAVLink_highres_imu_message(
            42_200_000, 1, 2, -9.8, 0.1, 0.2, 0.3, *[0] * 7, 0b111111
        )
    )
    assert high.specific_force_frd == pytest.approx((1, 2, -9.8))
    assert (raw.source, scaled.source, high.source) == ("RAW_IMU", "SCALED_IMU2", "HIGHRES_IMU")
    second = sample(mavlink.MAVLink_raw_imu_message(42_200_000, 0, 0, -1000, 0, 0, 0, 0, 0, 0, 1))
    assert second.source == "RAW_IMU:1"


def test_highres_imu_fields_not_updated_mean_nothing():
    gyro_only = sample(
        mavlink.MAVLink_highres_imu_message(1000, 0, 0, 0, 0.1, 0.2, 0.3, *[0] * 7, 0b111000)
    )
    assert all(math.isnan(v) for v in gyro_only.specific_force_frd)
    assert gyro_only.gyro_frd == pytest.approx((0.1, 0.2, 0.3))
    assert sample(mavlink.MAVLink_highres_imu_message(1000, *[0] * 13, 0b1000000)) is None


def axis_rotation(axis, degrees):
    a = math.radians(degrees) / 2
    q = [math.cos(a), 0.0, 0.0, 0.0]
    q[1 + axis] = math.sin(a)
    return rotation_from_quaternion(q)


@pytest.mark.parametrize("value", sorted(set(mavlink.enums["MAV_SENSOR_ORIENTATION"]) - {100, 101}))
def test_every_orientation_turns_the_beam_as_the_enum_describes(value):
    """Against the angles of the enum's description: roll, then pitch, then yaw."""
    text = mavlink.enums["MAV_SENSOR_ORIENTATION"][value].description
    angles = {w.split(":")[0].strip(): float(w.split(":")[1]) for w in text.split(",")}
    rotation = (
        axis_rotation(2, angles.get("Yaw", 0))
        @ axis_rotation(1, angles.get("Pitch", 0))
        @ axis_rotation(0, angles.get("Roll", 0))
    )
    assert orientation_direction(value) == pytest.approx(rotation @ (1.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("orientation", "direction"),
    [
        (25, (0, 0, 1)),
        (24, (0, 0, -1)),
        (0, (1, 0, 0)),
        (2, (0, 1, 0)),
        (6, (0, -1, 0)),
        (4, (-1, 0, 0)),
        (12, (-1, 0, 0)),
    ],
)
def test_the_directions_in_use(orientation, direction):
    assert sample(distance(orientation=orientation)).direction_frd == direction


def test_custom_orientation_by_quaternion_and_never_down_by_default():
    q = quaternion_from_euler(0.0, math.pi / 2, 0.0)  # nose up
    assert sample(distance(orientation=100, q=q)).direction_frd == pytest.approx(
        (0, 0, -1), abs=1e-6
    )
    for nothing in (distance(orientation=100), distance(orientation=77), distance(orientation=101)):
        reading = sample(nothing)
        assert reading.direction_frd is None
        assert reading.verdict is RangeVerdict.UNMAPPED


@pytest.mark.parametrize(
    ("message", "verdict"),
    [
        (distance(83), RangeVerdict.OK),
        (distance(0), RangeVerdict.BELOW_MIN),
        (distance(2), RangeVerdict.BELOW_MIN),
        (distance(800), RangeVerdict.ABOVE_MAX),
        (distance(6000), RangeVerdict.ABOVE_MAX),
        (distance(83, quality=0), RangeVerdict.OK),
        (distance(83, quality=1), RangeVerdict.LOW_QUALITY),
        (distance(83, low=0, high=0), RangeVerdict.OK),
    ],
)
def test_verdicts(message, verdict):
    assert sample(message).verdict is verdict


def test_range_fields():
    reading = sample(distance(83, covariance=4), component=158)
    assert (reading.distance_m, reading.min_m, reading.max_m, reading.sigma_m) == (
        0.83,
        0.02,
        8.0,
        0.02,
    )
    assert (reading.sensor_id, reading.quality, reading.component) == (1, 100, 158)
    for unknown in (0, 255):
        assert sample(distance(covariance=unknown)).sigma_m is None
    assert sample(distance(quality=0)).quality is None
    old = sample(mavlink.MAVLink_rangefinder_message(0.25, 0))
    assert (old.distance_m, old.direction_frd, old.source) == (0.25, (0.0, 0.0, 1.0), "RANGEFINDER")


@pytest.mark.parametrize("first", range(1, 30, 4))
def test_esc_telemetry_of_every_group(first):
    kind = getattr(mavlink, f"MAVLink_esc_telemetry_{first}_to_{first + 3}_message")
    speeds = sample(
        kind(
            [37, 38, 36, 255],
            [2466] * 4,
            [720, 708, 655, 0],
            [7] * 4,
            [4046, 4028, 0, 65535],
            [49, 50, 51, 0],
        )
    )
    assert speeds.first_esc == first
    assert speeds.rpm[:3] == (4046.0, 4028.0, 0.0)
    assert math.isnan(speeds.rpm[3])  # 65535 says that nothing is known
    assert speeds.count == (49, 50, 51, 0)
    assert speeds.temperature_c == (37.0, 38.0, 36.0, 255.0)


def test_rpm_and_raw_rpm():
    assert sample(mavlink.MAVLink_raw_rpm_message(2, 4100.0)).first_esc == 3
    speeds = sample(mavlink.MAVLink_rpm_message(4100.0, -1.0))
    assert speeds.rpm[0] == 4100.0
    assert math.isnan(speeds.rpm[1])
    assert sample(mavlink.MAVLink_rpm_message(-1.0, -1.0)) is None


def battery(voltages, current=3000, ext=(0, 0, 0, 0)):
    return mavlink.MAVLink_battery_status_message(
        0,
        0,
        0,
        32767,
        [*voltages, *[65535] * (10 - len(voltages))],
        current,
        -1,
        -1,
        -1,
        0,
        0,
        list(ext),
    )


def test_battery():
    assert sample(battery([16774])).voltage_v == 16.774
    assert sample(battery([4097] * 6)).voltage_v == pytest.approx(24.582)
    assert sample(battery([4000] * 10, ext=(4000, 4000, 0, 0))).voltage_v == pytest.approx(48.0)
    assert sample(battery([16774])).current_a == 30.0
    assert math.isnan(sample(battery([3784], current=-1)).current_a)
    assert sample(battery([], current=-1)) is None
    status = sample(
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 16245, 1173, 98, 0, 0, 0, 0, 0, 0)
    )
    assert (status.voltage_v, status.current_a) == (16.245, 11.73)
    assert (
        sample(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, 98, 0, 0, 0, 0, 0, 0))
        is None
    )


def test_pressure_and_servo():
    pressure = sample(mavlink.MAVLink_scaled_pressure_message(100, 1020.25, 0, 1708))
    assert (pressure.pressure_pa, pressure.temperature_c) == (102025.0, 17.08)
    servo = sample(
        mavlink.MAVLink_servo_output_raw_message(42_200_000, 0, *range(1001, 1009), *[0] * 7, 65535)
    )
    assert servo.pwm_us[:9] == (1001, 1002, 1003, 1004, 1005, 1006, 1007, 1008, 0)
    assert math.isnan(servo.pwm_us[15])


def test_targets():
    q = quaternion_from_euler(0.1, 0.0, 0.0)
    echo = sample(mavlink.MAVLink_attitude_target_message(100, 0, q, 0, 0, 0, 0.4))
    assert echo.thrust == pytest.approx(0.4)
    upstream = sample(
        mavlink.MAVLink_set_attitude_target_message(0, 1, 0, 7, q, 0, 0, 0, 0.4),
        system=255,
        component=190,
    )
    assert (
        upstream.type_mask,
        upstream.target_system,
        upstream.target_component,
        upstream.system,
    ) == (7, 1, 0, 255)
    goal = sample(
        mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 3576, *range(9), 0.5, 0.1)
    )
    assert goal.position == (0, 1, 2)
    assert goal.acceleration == (6, 7, 8)
    assert (goal.type_mask, goal.frame) == (3576, 1)


def px4_bytes(number):
    return struct.unpack("<f", struct.pack("<i", number))[0]


@pytest.mark.parametrize(
    ("wire", "kind", "value"),
    [
        (8.0, 6, 8.0),
        (0.0, 6, 0.0),
        (px4_bytes(1), 6, 1.0),
        (px4_bytes(-1_000_000_001), 6, -1_000_000_001.0),
        (0.39, 9, 0.39),
        (-20.0, 2, -20.0),
    ],
)
def test_parameters_of_both_firmwares(wire, kind, value):
    parameter = sample(mavlink.MAVLink_param_value_message(b"GUID_OPTIONS", wire, kind, 900, 12))
    assert parameter.name == "GUID_OPTIONS"
    assert parameter.value == pytest.approx(value)


def test_the_rest():
    landed = sample(mavlink.MAVLink_extended_sys_state_message(0, 1))
    assert landed.landed_state == 1


def test_messages_that_nobody_reads_in_flight_give_no_sample():
    assert sample(mavlink.MAVLink_statustext_message(4, b"hello")) is None
    assert sample(mavlink.MAVLink_wind_message(90.0, 5.0, 0.5)) is None
    assert sample(mavlink.MAVLink_vfr_hud_message(0, 0, 0, 0, 0, 0)) is None


def test_units_are_those_of_the_dialect():
    """Where the dialect states a unit, the table states the same."""
    same = {"m/s/s": "m/s/s", "rpm": "rpm"}
    for layout in LAYOUTS.values():
        stated = getattr(mavlink.mavlink_map.get(layout.id), "fieldunits_by_name", {})
        for quantity in layout.quantities:
            for field in getattr(quantity, "fields", "").split():
                unit = stated.get(field, "")
                if unit and quantity.unit and not layout.name.startswith("RAW_IMU"):
                    assert quantity.unit == same.get(unit, unit), (layout.name, field)


def flat(value):
    """A sample as plain numbers, so that NaN compares equal to NaN."""
    if dataclasses.is_dataclass(value):
        return [flat(getattr(value, f.name)) for f in dataclasses.fields(value)]
    if isinstance(value, tuple | list):
        return [flat(v) for v in value]
    return repr(value)


def numbers(value):
    """All floats in a sample."""
    if isinstance(value, float):
        return [value]
    if isinstance(value, tuple):
        return [x for v in value for x in numbers(v)]
    if dataclasses.is_dataclass(value) and not isinstance(value, enum.Enum):
        return [x for f in dataclasses.fields(value) for x in numbers(getattr(value, f.name))]
    return []


def frame_of(layout, payload):
    return cut(pack(layout.id, payload, 1, 1, 7), 0)


def fields_of(layout, payload):
    """The unpacked fields of a payload of any length."""
    unpacker = MESSAGES[layout.id].unpacker
    return unpacker.unpack(payload[: unpacker.size].ljust(unpacker.size, b"\0"))


layouts = st.sampled_from(sorted(LAYOUTS.values(), key=lambda layout: layout.id))


@settings(max_examples=600, suppress_health_check=[HealthCheck.too_slow])
@given(layouts, st.binary(max_size=255), st.integers(0, 2**63))
def test_no_payload_raises_and_nothing_infinite_comes_out(layout, payload, arrival):
    clock = BootClock()
    out = decode(frame_of(layout, payload), arrival, clock)
    if out is None:
        return
    assert not any(math.isinf(x) for x in numbers(out))
    assert out.t_s >= 0.0
    if isinstance(out, Attitude | LocalPosition):
        assert not any(math.isnan(x) for x in numbers(out))
    assert flat(out) == flat(decode(frame_of(layout, payload), arrival, BootClock()))


@settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])
@given(layouts, st.lists(st.binary(max_size=255), min_size=1, max_size=4))
def test_columns_hold_the_same_numbers(layout, payloads):
    dtype = layout.wire.dtype
    records = np.concatenate(
        [np.frombuffer(p[: dtype.itemsize].ljust(dtype.itemsize, b"\0"), dtype) for p in payloads]
    )
    table = columns(layout, records)
    for k, payload in enumerate(payloads):
        fields = fields_of(layout, payload)
        for quantity, read in zip(layout.quantities, layout.readers, strict=True):
            one = read(fields)
            if isinstance(quantity, SI):
                assert np.array_equal(
                    np.atleast_1d(one), table[quantity.name][k], equal_nan=True
                ), quantity.name
            elif isinstance(one, int):
                assert one == table[quantity.name][k]


def test_samples_advance_the_clock():
    clock = BootClock()
    assert sample(mavlink.MAVLink_heartbeat_message(2, 3, 137, 4, 4, 3), clock).t_s == 0.0
    sample(mavlink.MAVLink_attitude_message(42_200, 0, 0, 0, 0, 0, 0), clock)
    assert sample(mavlink.MAVLink_heartbeat_message(2, 3, 137, 4, 4, 3), clock).t_s == 42.2
    assert LAYOUTS[30].stamp is Stamp.BOOT_MS


def test_rangefinder_gives_way_to_a_downward_distance_sensor():
    intake = Intake()
    old, up, down = (
        mavlink.MAVLink_rangefinder_message(60.0, 0),
        distance(orientation=24),
        distance(orientation=25),
    )
    intake.sample(sent(mavlink.MAVLink_heartbeat_message(2, 3, 137, 4, 4, 3)), ARRIVAL)
    heard = [intake.sample(sent(message), ARRIVAL) for message in (old, up, old, down, old)]
    assert [s is not None for s in heard] == [True, True, True, True, False]


def test_attitudes_and_positions_of_other_components_are_left_out_and_named():
    """A camera of the vehicle's own system id means its own frame; its ranges are welcome."""
    intake, arrival = Intake(), 10**15

    def heard(message, component):
        raw = bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=component)))
        return intake.sample(cut(raw, 0), arrival)

    heard(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3), 1)
    place = mavlink.MAVLink_local_position_ned_message(1000, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    turned = mavlink.MAVLink_attitude_message(1000, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert heard(place, 197) is None
    assert heard(turned, 154) is None
    assert intake.not_the_autopilots == {(32, 197), (30, 154)}
    assert heard(place, 1) is not None
    assert heard(turned, 1) is not None
    assert (
        heard(mavlink.MAVLink_distance_sensor_message(1000, 5, 800, 50, 0, 1, 25, 0), 197)
        is not None
    )
