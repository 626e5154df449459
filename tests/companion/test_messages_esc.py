"""ESC_INFO and ESC_STATUS: sizes, checksum extras and field order follow from the XML by MAVLink's own rules."""

import dataclasses
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.generator import mavparse

from companion.mavlink.boot_clock import BootClock
from companion.mavlink.decoders import decode, id_of, source_of, wire_dtype
from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import BY_ID, EscInfo, EscStatus, pack_frame, parse_frame
from companion.mavlink.message_filter import Intake
from companion.mavlink.samples import EscHealth, RotorSpeeds

COMMON_XML = """<?xml version="1.0"?><mavlink><version>3</version><messages>
<message id="290" name="ESC_INFO"><description>d</description>
<field type="uint8_t" name="index">-</field><field type="uint64_t" name="time_usec">-</field>
<field type="uint16_t" name="counter">-</field><field type="uint8_t" name="count">-</field>
<field type="uint8_t" name="connection_type">-</field><field type="uint8_t" name="info">-</field>
<field type="uint16_t[4]" name="failure_flags">-</field><field type="uint32_t[4]" name="error_count">-</field>
<field type="int16_t[4]" name="temperature">-</field></message>
<message id="291" name="ESC_STATUS"><description>d</description>
<field type="uint8_t" name="index">-</field><field type="uint64_t" name="time_usec">-</field>
<field type="int32_t[4]" name="rpm">-</field><field type="float[4]" name="voltage">-</field>
<field type="float[4]" name="current">-</field></message></messages></mavlink>"""

STATUS = EscStatus(1, 1, 5_000_000, (4000, -4100, 0, 2**31 - 1), (16.0, 16.5, 15.0, 0.0), (3.0, 3.5, 0.0, 0.0), 4)
INFO = EscInfo(1, 1, 5_000_000, (0, 1, 2, 3), 7, (0, 0, 8, 0), (3000, 32767, -500, 0), 0, 4, 1, 0b1011)


def handed_over(frame):
    """What a pymavlink receiver makes of the frame."""
    return mavlink.MAVLink(None).parse_buffer(frame)[0]


def test_extras_sizes_and_order_as_the_generator_computes_them(tmp_path):
    path = tmp_path / "esc.xml"
    path.write_text(COMMON_XML)
    for message in mavparse.MAVXML(str(path), "2.0").message:
        ours = BY_ID[message.id]
        assert message.crc_extra == ours.CRC_EXTRA
        assert ours.PAYLOAD.size == message.wire_length
        assert wire_dtype(message.id).names == tuple(f.name for f in message.ordered_fields)
    assert (EscInfo.CRC_EXTRA, EscStatus.CRC_EXTRA) == (251, 10)


@pytest.mark.parametrize("message_id", [290, 291])
def test_a_later_pymavlink_must_agree(message_id):
    theirs = mavlink.mavlink_map.get(message_id)
    if theirs is None:
        pytest.skip("this pymavlink does not know the message")
    assert theirs.crc_extra == BY_ID[message_id].CRC_EXTRA
    assert theirs.unpacker.size == BY_ID[message_id].PAYLOAD.size


@pytest.mark.parametrize("message", [STATUS, INFO])
def test_round_trip(message):
    assert parse_frame(pack_frame(message, 200)) == message


def test_through_pymavlink_to_a_sample():
    clock = BootClock()
    sample = decode(handed_over(pack_frame(STATUS, 0)), 10, clock)
    assert isinstance(sample, RotorSpeeds)
    assert sample.first_esc == 5
    assert sample.rpm[:3] == (4000.0, -4100.0, 0.0)
    assert sample.rpm[3] != sample.rpm[3], "an absurd speed is NaN"
    assert sample.health is not None
    assert sample.health.voltage_v == (16.0, 16.5, 15.0, 0.0)
    health = decode(handed_over(pack_frame(INFO, 0)), 10, clock)
    assert isinstance(health, EscHealth)
    assert health.online == (True, True, False, True)
    assert health.temperature_c[0] == 30.0
    assert health.temperature_c[1] != health.temperature_c[1]
    assert health.temperature_c[2] == -5.0


def test_the_sender_is_read_and_its_speeds_pass_the_intake():
    """pymavlink leaves the header of an unknown frame unread: system 0, which is nobody's vehicle."""
    link = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    intake = Intake()
    intake.sample(handed_over(mavlink.MAVLink_heartbeat_message(2, 12, 137, 6 << 16, 4, 3).pack(link)), 0)
    status = dataclasses.replace(STATUS, system=7)
    assert id_of(handed_over(pack_frame(status, 0))) == 291
    assert source_of(handed_over(pack_frame(status, 0))) == (7, 1)
    assert isinstance(intake.sample(handed_over(pack_frame(status, 0)), 10), RotorSpeeds)
    assert intake.sample(handed_over(pack_frame(STATUS, 0)), 20) is None, "of another vehicle"


@pytest.mark.parametrize("message", [STATUS, INFO])
def test_one_flipped_bit_anywhere_is_noticed(message):
    frame = pack_frame(message, 1)
    for bit in range(8 * 1, 8 * len(frame)):
        bad = bytearray(frame)
        bad[bit // 8] ^= 1 << bit % 8
        assert parse_frame(bad) is None


def test_pymavlink_passes_a_bad_crc_and_we_do_not():
    frame = bytearray(pack_frame(STATUS, 1))
    frame[20] ^= 1
    message = handed_over(frame)
    if isinstance(message, mavlink.MAVLink_unknown):
        assert decode(message, 0, BootClock()) is None


@given(st.binary(max_size=300))
def test_no_bytes_raise(data):
    parse_frame(data)
    parse_frame(b"\xfd" + data)
    parse_frame(struct.pack("<BBBBBBBHB", 0xFD, min(len(data), 255), 0, 0, 0, 1, 1, 291, 0) + data)
