from __future__ import annotations

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc
from simflight import HEIGHT_M, Peer, hovering, vehicle

from companion.sim.autopilot import Mode
from companion.sim.flight import Flight
from companion.sim.link import ESC_INFO, ESC_INFO_CRC, ESC_STATUS, ESC_STATUS_CRC, PX4_MODES
from companion.sim.pilot import Hand, ScriptedPilot
from companion.sim.scenario import build

ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
STREAMS = {
    "ATTITUDE": mavlink.MAVLINK_MSG_ID_ATTITUDE,
    "ATTITUDE_QUATERNION": mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    "RAW_IMU": mavlink.MAVLINK_MSG_ID_RAW_IMU,
    "SCALED_IMU": mavlink.MAVLINK_MSG_ID_SCALED_IMU,
    "HIGHRES_IMU": mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
    "LOCAL_POSITION_NED": mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    "SERVO_OUTPUT_RAW": mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
    "ATTITUDE_TARGET": mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
    "POSITION_TARGET_LOCAL_NED": mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    "BATTERY_STATUS": mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
    "SYS_STATUS": mavlink.MAVLINK_MSG_ID_SYS_STATUS,
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


def test_imu_is_quantised_where_the_real_one_is():
    peer = hovering()
    for kind in ("SCALED_IMU", "HIGHRES_IMU", "ATTITUDE_TARGET"):
        peer.interval(STREAMS[kind], 100.0)
    peer.run(1.0)
    found = peer.messages()
    fine = [m.zacc for m in found if m.get_type() == "HIGHRES_IMU"]
    coarse = [m.zacc for m in found if m.get_type() == "SCALED_IMU"]
    assert sum(fine) / len(fine) == pytest.approx(-9.81, abs=0.15)
    assert sum(coarse) / len(coarse) == pytest.approx(-1000, abs=15)
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
    assert {"GUID_OPTIONS", "GUID_TIMEOUT", "MOT_SPIN_MIN", "MOT_SPIN_MAX", "MOT_THST_HOVER"} <= set(served)
    true_hover = peer.flight.autopilot.throttle
    assert served["MOT_THST_HOVER"] < 0.95 * true_hover  # off, as on the real one
    peer.say(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    peer.run(0.1)
    assert peer.messages("PARAM_VALUE") == []


def test_timesync_is_answered_with_the_boot_clock():
    peer = hovering()
    peer.frames.clear()
    peer.say(mavlink.MAVLink_timesync_message(0, 12345))
    (reply,) = peer.messages("TIMESYNC")
    assert reply.ts1 == 12345
    assert reply.tc1 == pytest.approx(peer.flight.time_s * 1e9, abs=1e6)


def test_messages_to_another_system_are_not_ours():
    peer = hovering()
    peer.frames.clear()
    peer.say(mavlink.MAVLink_command_long_message(7, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, *[0.0] * 7))
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
    peer = Peer(Flight(v, build("corner", v), 1))
    pilot = ScriptedPilot(peer.flight, peer.link, Hand.COMPANION, endless=False)
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
    assert {(m.get_srcSystem(), m.get_srcComponent(), m.target_system, m.target_component) for m in targets} == {
        (255, 190, 1, 191)
    }
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in found if m.get_type() == "HEARTBEAT"} == {
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


def test_px4_leaves_offboard_when_the_stream_stops_and_wants_it_back_before_it_enters():
    peer = hovering(px4=True)
    peer.attitude(thrust=0.5)
    peer.run(0.3)
    assert peer.flight.autopilot.mode is Mode.GUIDED
    peer.run(0.6)
    assert peer.flight.autopilot.mode is Mode.LOITER
    main, sub = PX4_MODES[Mode.GUIDED]
    request = (mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(main), float(sub))
    assert peer.command(*request) == mavlink.MAV_RESULT_FAILED
    for _ in range(60):
        peer.attitude(thrust=0.5)
        peer.run(0.02)
    assert peer.command(*request) == ACCEPTED
    assert peer.flight.autopilot.mode is Mode.GUIDED


def test_heartbeat_tells_which_autopilot_flies():
    for px4, firmware in ((False, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA), (True, mavlink.MAV_AUTOPILOT_PX4)):
        peer = hovering(px4=px4)
        peer.attitude(thrust=0.5)
        peer.run(0.1)
        beat = peer.messages("HEARTBEAT")[0]
        assert beat.autopilot == firmware
        assert beat.type == mavlink.MAV_TYPE_COAXIAL
        assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        assert beat.custom_mode == ((6 << 16) if px4 else 4)
        assert math.isfinite(beat.custom_mode)
