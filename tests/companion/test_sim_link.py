from __future__ import annotations

import itertools
import math
import struct

import pytest
from px4_link import PX4_MODES
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc
from simflight import HEIGHT_M, Peer, hovering, vehicle
from simulated import simulated

from companion.sim.autopilot import Guided, Mode
from companion.sim.pilot import ScriptedPilot
from companion.sim.scenario import build
from companion.sim.sensors import RangeFault

ESC_INFO, ESC_STATUS = 290, 291
ESC_INFO_CRC, ESC_STATUS_CRC = 251, 10
"""Ids and extra CRC bytes in MAVLink's development.xml."""
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
STREAMS = {
    "ATTITUDE": mavlink.MAVLINK_MSG_ID_ATTITUDE,
    "ATTITUDE_QUATERNION": mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    "HIGHRES_IMU": mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
    "LOCAL_POSITION_NED": mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    "SERVO_OUTPUT_RAW": mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
    "ATTITUDE_TARGET": mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    "BATTERY_STATUS": mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
    "EXTENDED_SYS_STATE": mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    "SCALED_PRESSURE": mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE,
    "ESC_TELEMETRY_1_TO_4": mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4,
}


def test_only_heartbeats_come_unasked():
    peer = hovering()
    peer.run(3.0)
    kinds = [m.get_type() for m in peer.messages()]
    assert set(kinds) == {"HEARTBEAT"}


@pytest.mark.parametrize("kind", sorted(STREAMS))
def test_a_requested_stream_comes_at_its_rate(kind):
    peer = hovering()
    assert peer.interval(STREAMS[kind], 50.0) == ACCEPTED
    peer.run(1.0)
    assert len(peer.messages(kind)) == pytest.approx(50, abs=1)
    assert peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, STREAMS[kind], -1.0) == ACCEPTED
    peer.run(0.5)
    assert peer.messages(kind) == []


@pytest.mark.parametrize(("px4", "hz"), [(False, 4), (True, 50)])
def test_a_rate_for_whole_groups_replaces_what_was_asked_for_on_ardupilot(px4, hz):
    peer = hovering(px4=px4)
    for number in (
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    ):
        assert peer.interval(number, 50.0) == mavlink.MAV_RESULT_ACCEPTED
    peer.say(
        mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_ALL, 4, 1),
        255,
        230,
    )
    peer.messages()
    peer.run(1.0)
    heard = [m.get_type() for m in peer.messages()]
    assert heard.count("LOCAL_POSITION_NED") == pytest.approx(hz, abs=1)
    assert heard.count("ATTITUDE_QUATERNION") == pytest.approx(50, abs=1)


def test_rates_beyond_the_real_ones_are_denied():
    peer = hovering()
    assert peer.interval(STREAMS["ATTITUDE"], 400.0) == DENIED
    assert peer.interval(STREAMS["ATTITUDE"], 300.0) == ACCEPTED
    for number in (ESC_STATUS, ESC_INFO, mavlink.MAVLINK_MSG_ID_RANGEFINDER):
        assert peer.interval(number, 10.0) == DENIED


def test_a_link_asked_for_too_much_serves_everyone_less():
    peer = hovering()
    wanted = sorted(STREAMS)[:11]
    for kind in wanted:
        peer.interval(STREAMS[kind], 200.0)
    peer.run(1.0)
    peer.messages()
    peer.run(1.0)
    kinds = [m.get_type() for m in peer.messages()]
    assert len(kinds) == pytest.approx(1290, rel=0.03)
    assert all(90 < kinds.count(kind) < 150 for kind in wanted)


def test_every_rangefinder_speaks_for_itself():
    peer = hovering(scenario="corner")
    peer.interval(mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR, 20.0)
    peer.run(2.0)
    by_id: dict[tuple[int, int], list[int]] = {}
    for m in peer.messages("DISTANCE_SENSOR"):
        by_id.setdefault((m.id, m.orientation), []).append(m.current_distance)
    assert set(by_id) == {(0, 25), (1, 2)}
    down = [v for v in by_id[0, 25] if v != 6000]
    assert sum(down) / len(down) == pytest.approx(100.0 * (HEIGHT_M - 0.05), abs=4.0)
    assert by_id[1, 2][-1] == pytest.approx(160, abs=6) or by_id[1, 2][-1] == 6000


def test_without_a_wall_its_rangefinder_reads_out_of_range():
    peer = hovering(scenario="hover")
    peer.interval(mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR, 20.0)
    peer.run(0.5)
    walls = [m for m in peer.messages("DISTANCE_SENSOR") if m.orientation == 2]
    assert {m.current_distance for m in walls} == {6000}
    assert walls[0].max_distance == 4000


def test_rotor_speeds_are_telemetered_per_esc():
    peer = hovering()
    peer.interval(STREAMS["ESC_TELEMETRY_1_TO_4"], 20.0)
    peer.run(0.5)
    last = peer.messages("ESC_TELEMETRY_1_TO_4")[-1]
    for reported, true in zip(last.rpm, peer.flight.body.rpm, strict=True):
        assert reported == pytest.approx(true, rel=0.03)
    assert last.voltage[0] == pytest.approx(100.0 * peer.flight.body.pack.voltage_v, abs=2.0)


def test_the_imu_is_not_quantised():
    peer = hovering()
    for kind in ("HIGHRES_IMU", "ATTITUDE_TARGET"):
        peer.interval(STREAMS[kind], 100.0)
    peer.run(1.0)
    found = peer.messages()
    fine = [m.zacc for m in found if m.get_type() == "HIGHRES_IMU"]
    assert sum(fine) / len(fine) == pytest.approx(-9.81, abs=0.15)
    assert any(abs(v * 1000 / 9.80665 - round(v * 1000 / 9.80665)) > 0.01 for v in fine)
    thrust = [m.thrust for m in found if m.get_type() == "ATTITUDE_TARGET"]
    assert sum(thrust) / len(thrust) == pytest.approx(peer.flight.autopilot.throttle, abs=0.05)


def test_parameters_are_served_and_set():
    peer = hovering()
    peer.say(mavlink.MAVLink_param_request_read_message(1, 1, b"MOT_THST_EXPO", -1))
    peer.run(0.1)
    (value,) = peer.messages("PARAM_VALUE")
    assert value.param_id == "MOT_THST_EXPO"
    assert value.param_value == pytest.approx(0.65)
    peer.say(mavlink.MAVLink_param_request_list_message(1, 1))
    peer.run(0.5)
    served = {m.param_id: m.param_value for m in peer.messages("PARAM_VALUE")}
    assert {
        "GUID_OPTIONS",
        "GUID_TIMEOUT",
        "MOT_SPIN_MIN",
        "MOT_SPIN_MAX",
        "MOT_THST_HOVER",
    } <= set(served)
    true_hover = peer.flight.autopilot.throttle
    assert served["MOT_THST_HOVER"] < 0.95 * true_hover  # off, as on the real one
    peer.say(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    peer.run(0.1)
    assert peer.messages("PARAM_VALUE") == []


def test_messages_to_another_system_are_not_ours():
    peer = hovering()
    peer.frames.clear()
    peer.say(
        mavlink.MAVLink_command_long_message(
            7, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, *[0.0] * 7
        )
    )
    peer.say(mavlink.MAVLink_set_attitude_target_message(0, 7, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.5))
    assert peer.messages() == []
    assert peer.link.taken == 0


def test_disarming_in_the_air_is_refused_and_unknown_commands_are_unsupported():
    peer = hovering()
    assert peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == mavlink.MAV_RESULT_FAILED
    assert peer.command(mavlink.MAV_CMD_DO_REPOSITION) == mavlink.MAV_RESULT_UNSUPPORTED


def test_garbage_on_the_wire_does_no_harm():
    peer = hovering()
    peer.link.receive(b"\xfd\xff\x00garbage\x00" * 20)
    peer.link.receive(b"")
    peer.run(0.1)
    assert peer.flight.autopilot.armed


def test_the_pilot_takes_off_and_speaks_to_the_companion_through_the_router():
    v = vehicle()
    peer = Peer(simulated(v, build("corner", v), 1))
    pilot = ScriptedPilot(peer.flight, peer.link, companion=True)
    due = [0]

    def each() -> None:
        pilot.step()
        due[0] += 1
        if peer.flight.time_s > 8.0 and due[0] % 8 == 0:
            peer.attitude(thrust=peer.flight.autopilot.throttle or 0.5)

    peer.run(12.5, each)
    found = peer.messages()
    targets = [m for m in found if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert peer.flight.script_s > 0.0
    assert targets
    assert {
        (m.get_srcSystem(), m.get_srcComponent(), m.target_system, m.target_component)
        for m in targets
    } == {(255, 190, 1, 191)}
    assert {
        (m.get_srcSystem(), m.get_srcComponent()) for m in found if m.get_type() == "HEARTBEAT"
    } == {
        (1, 1),
        (255, 190),
    }


# -- PX4 -------------------------------------------------------------------------------------------------------------


def unpack(frame: bytes, extra: int) -> tuple[int, bytes]:
    """Message id and zero-filled payload of a MAVLink 2 frame whose checksum is right."""
    length = frame[1]
    crc = x25crc(frame[1 : 10 + length])
    crc.accumulate(bytes([extra]))
    assert frame[0] == 0xFD
    assert struct.unpack("<H", frame[10 + length :])[0] == crc.crc
    return frame[7] | frame[8] << 8 | frame[9] << 16, frame[10 : 10 + length].ljust(64, b"\0")


def test_px4_reports_rotors_in_its_own_messages():
    peer = hovering(px4=True)
    assert peer.interval(ESC_STATUS, 10.0) == ACCEPTED
    assert peer.interval(mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4, 10.0) == DENIED
    peer.frames.clear()
    peer.run(0.3)
    frames = [f for f in peer.frames if f[7] | f[8] << 8 == ESC_STATUS]
    number, payload = unpack(frames[-1], ESC_STATUS_CRC)
    assert number == ESC_STATUS
    time_us, *rest = struct.unpack("<Q4i4f4fB", payload[:57])
    assert time_us / 1e6 == pytest.approx(peer.flight.time_s, abs=0.2)
    for reported, true in zip(rest[:4], peer.flight.body.rpm, strict=True):
        assert reported == pytest.approx(true, rel=0.03)
    assert peer.interval(ESC_INFO, 10.0) == ACCEPTED
    peer.frames.clear()
    peer.run(0.3)
    frames = [f for f in peer.frames if f[7] | f[8] << 8 == ESC_INFO]
    _, payload = unpack(frames[-1], ESC_INFO_CRC)
    assert struct.unpack("<Q4IH4H4hBBBB", payload[:46])[15] == 4  # count


OFFBOARD = (mavlink.MAV_CMD_DO_SET_MODE, 1.0, *map(float, PX4_MODES[Mode.GUIDED]))


def stream(peer: Peer, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        peer.attitude(thrust=peer.flight.autopilot.hover)
        peer.run(0.02)


def test_px4_wants_a_stream_for_a_second_before_it_enters_offboard():
    peer = hovering(px4=True)
    assert peer.flight.autopilot.mode is Mode.LOITER
    assert peer.command(*OFFBOARD) == mavlink.MAV_RESULT_FAILED
    stream(peer, 0.8)
    assert peer.command(*OFFBOARD) == mavlink.MAV_RESULT_FAILED
    assert peer.link.taken == 0
    stream(peer, 0.3)
    assert peer.command(*OFFBOARD) == ACCEPTED
    stream(peer, 0.1)
    assert peer.link.taken > 0


@pytest.mark.parametrize(("sticks", "fallback"), [(True, Mode.POSHOLD), (False, Mode.LOITER)])
def test_px4_leaves_offboard_a_second_after_the_stream_and_enters_again_with_it(sticks, fallback):
    peer = hovering(px4=True)
    stream(peer, 1.2)
    assert peer.command(*OFFBOARD) == ACCEPTED
    stream(peer, 0.2)

    def each() -> None:
        if sticks:
            peer.say(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0), 255, 190)

    peer.run(0.9, each)
    assert peer.flight.autopilot.mode is Mode.GUIDED
    peer.run(0.2, each)
    assert peer.flight.autopilot.mode is fallback
    if sticks:
        peer.run(6.0, each)
        assert peer.flight.autopilot.mode is Mode.POSHOLD
    stream(peer, 1.1)
    assert peer.flight.autopilot.mode is Mode.GUIDED


def test_px4_without_sticks_returns_five_seconds_after_the_stream():
    peer = hovering(px4=True)
    stream(peer, 1.2)
    assert peer.command(*OFFBOARD) == ACCEPTED
    peer.run(6.5)
    assert peer.flight.autopilot.mode in (Mode.RTL, Mode.LAND)


def test_px4_flies_the_stream_thrust_as_it_comes_and_learns_its_own_hover():
    peer = hovering(px4=True)
    pilot = peer.flight.autopilot
    assert pilot.parameters["MPC_THR_HOVER"] == 0.5
    assert pilot.hover == pytest.approx(pilot.throttle, rel=0.03)
    stream(peer, 1.2)
    assert peer.command(*OFFBOARD) == ACCEPTED
    peer.attitude(roll=10.0, thrust=0.6)
    peer.run(0.02)
    assert pilot.throttle == 0.6
    assert pilot.shaped[0] == pytest.approx(math.radians(10.0))


# -- manners of both -------------------------------------------------------------------------------------------------


def test_sticks_fly_a_velocity_and_where_they_end_is_held():
    for px4 in (False, True):
        peer = hovering(px4=px4)
        peer.flight.autopilot.set_mode(Mode.POSHOLD, peer.flight.estimate)
        top = peer.flight.autopilot.stick_speed_m_s
        push = [round(1000.0 / top), 0]

        def each(peer: Peer = peer, push: list[int] = push) -> None:
            peer.say(mavlink.MAVLink_manual_control_message(1, push[0], 0, 500, 0, 0), 255, 190)

        peer.run(4.0, each)
        assert peer.flight.body.velocity[0] == pytest.approx(1.0, abs=0.15)
        push[0] = 0
        peer.run(4.0, each)
        place = list(peer.flight.body.position)
        assert place[0] > 3.0
        peer.run(3.0)
        assert math.dist(place, peer.flight.body.position) < 0.12


def test_without_gps_the_estimate_goes_astray_and_says_so_after_five_seconds():
    number = {
        True: mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        False: mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    }
    for px4, kind in ((True, "ESTIMATOR_STATUS"), (False, "EKF_STATUS_REPORT")):
        peer = hovering(px4=px4)
        assert peer.interval(number[px4], 10.0) == ACCEPTED
        assert peer.interval(number[not px4], 10.0) == DENIED
        peer.flight.estimator.gps = False
        peer.run(4.8)
        assert all(m.flags & 16 for m in peer.messages(kind))
        peer.run(0.5)
        assert not peer.messages(kind)[-1].flags & 16
        assert (peer.flight.autopilot.mode is Mode.LAND) == (not px4)  # FS_EKF_ACTION
    estimate, true = peer.flight.estimate.position, peer.flight.body.position
    assert math.dist(estimate[:2], true[:2]) > 0.05


def test_attitude_gains_are_parameters_that_are_obeyed():
    reached = []
    for p, tc in ((4.5, 0.15), (2.25, 0.3)):
        peer = hovering("quad")
        for name, value in ((b"ATC_ANG_RLL_P", p), (b"ATC_INPUT_TC", tc)):
            peer.say(mavlink.MAVLink_param_set_message(1, 1, name, value, 9), 255, 190)
        for _ in range(15):
            peer.attitude(roll=5.0, thrust=peer.flight.autopilot.hover)
            peer.run(0.02)
        reached.append(math.degrees(peer.flight.body.euler()[0]))
    assert reached[1] < 0.7 * reached[0]


def test_positions_come_no_faster_than_the_limit_and_late():
    peer = hovering()
    peer.link.position_hz, peer.link.position_late_s = 10.0, 0.1
    assert peer.interval(STREAMS["LOCAL_POSITION_NED"], 50.0) == ACCEPTED
    peer.run(2.0)
    peer.messages()
    peer.run(1.0)
    found = peer.messages("LOCAL_POSITION_NED")
    assert len(found) == pytest.approx(10, abs=1)
    assert peer.link.boot_ms - found[-1].time_boot_ms == pytest.approx(150, abs=51)


def test_a_target_in_the_body_frame_is_turned_and_added():
    peer = hovering()
    start = list(peer.flight.body.position)
    yaw = peer.flight.estimate.yaw
    for _ in range(100):
        peer.run(0.05)
        if _ == 0:
            mask = 0x38 | 0x1C0 | 0x800 | 0x400
            peer.say(
                mavlink.MAVLink_set_position_target_local_ned_message(
                    0,
                    1,
                    1,
                    mavlink.MAV_FRAME_BODY_OFFSET_NED,
                    mask,
                    0.5,
                    0.0,
                    -0.2,
                    0,
                    0,
                    0,
                    0,
                    0,
                    0,
                    0,
                    0,
                ),
                255,
                190,
            )
    moved = [b - a for a, b in zip(start, peer.flight.body.position, strict=True)]
    assert moved[0] == pytest.approx(0.5 * math.cos(yaw), abs=0.05)
    assert moved[2] == pytest.approx(-0.2, abs=0.05)


def test_with_no_companion_the_autopilot_flies_what_is_for_it():
    for heard in (False, True):
        peer = hovering()
        if heard:
            peer.say(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
        peer.say(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0,
                1,
                191,
                1,
                0x38 | 0x1C0 | 0x800 | 0x400,
                1.0,
                0.0,
                -HEIGHT_M,
                0,
                0,
                0,
                0,
                0,
                0,
                0,
                0,
            ),
            255,
            190,
        )
        assert (peer.flight.autopilot.guided is Guided.POSITION) == (not heard)


def test_a_take_off_is_said_to_be_one_until_its_height_is_reached():
    v = vehicle()
    peer = Peer(simulated(v, build("hover", v), 2))
    peer.run(0.1)
    peer.flight.autopilot.set_mode(Mode.GUIDED, peer.flight.estimate)
    peer.flight.autopilot.arm(True)
    peer.flight.autopilot.take_off(1.5, peer.flight.estimate)
    peer.interval(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 10.0)
    peer.run(10.0)
    states = [m.landed_state for m in peer.messages("EXTENDED_SYS_STATE")]
    changes = [b for a, b in itertools.pairwise([0, *states]) if a != b]
    assert changes == [1, 3, 2]


def test_a_range_may_lose_its_echo_or_freeze():
    peer = hovering()
    sensor = peer.flight.ranges[0]
    before = sensor.reading_m
    sensor.fault = RangeFault.FROZEN
    peer.flight.autopilot.take_off(3.0, peer.flight.estimate)
    peer.run(1.0)
    assert sensor.reading_m == before
    sensor.fault = RangeFault.LOST
    peer.run(0.2)
    assert sensor.reading_m == 60.0


def test_wind_pushes():
    peer = hovering()
    peer.flight.body.wind = (0.0, 4.0, 0.0)
    drift = []
    peer.run(1.5, lambda: drift.append(peer.flight.body.position[1]))
    assert max(drift) > 0.03


def test_heartbeat_tells_which_autopilot_flies():
    for px4, firmware in (
        (False, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
        (True, mavlink.MAV_AUTOPILOT_PX4),
    ):
        peer = hovering(px4=px4)
        peer.run(1.0)
        beat = peer.messages("HEARTBEAT")[0]
        assert beat.autopilot == firmware
        assert beat.type == mavlink.MAV_TYPE_COAXIAL
        assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        assert beat.custom_mode == ((4 << 16 | 3 << 24) if px4 else 4)
