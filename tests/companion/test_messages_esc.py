"""ESC_INFO and ESC_STATUS: sizes, checksum extras and field order follow from the XML by MAVLink's own rules."""

import pytest
from pymavlink.generator import mavparse

from companion.mavlink.boot_clock import BootClock
from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import BY_ID, ESC_INFO, ESC_STATUS
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import decode
from companion.mavlink.samples import EscTemperatures, RotorSpeeds
from companion.mavlink.wire_frames import Counts, cut, pack, walk
from companion.mavlink.wire_layout import wire_format

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

RPM, VOLTS, AMPS = (4000, -4100, 0, 2**31 - 1), (16.0, 16.5, 15.0, 0.0), (3.0, 3.5, 0.0, 0.0)
STATUS = ESC_STATUS.unpacker.pack(5_000_000, *RPM, *VOLTS, *AMPS, 4)
INFO = ESC_INFO.unpacker.pack(
    5_000_000, 0, 1, 2, 3, 7, 0, 0, 8, 0, 3000, 32767, -500, 0, 0, 4, 1, 0b1011
)


def test_extras_sizes_and_order_as_the_generator_computes_them(tmp_path):
    path = tmp_path / "esc.xml"
    path.write_text(COMMON_XML)
    for message in mavparse.MAVXML(str(path), "2.0").message:
        ours = BY_ID[message.id]
        assert message.crc_extra == ours.crc_extra
        assert ours.unpacker.size == message.wire_length
        assert wire_format(message.id).dtype.names == tuple(f.name for f in message.ordered_fields)
    assert (ESC_INFO.crc_extra, ESC_STATUS.crc_extra) == (251, 10)


@pytest.mark.parametrize("message_id", [290, 291])
def test_a_later_pymavlink_must_agree(message_id):
    theirs = mavlink.mavlink_map.get(message_id)
    if theirs is None:
        pytest.skip("this pymavlink does not know the message")
    assert theirs.crc_extra == BY_ID[message_id].crc_extra
    assert theirs.unpacker.size == BY_ID[message_id].unpacker.size


def test_frames_to_samples():
    clock = BootClock()
    sample = decode(cut(pack(291, STATUS, 1, 1, 0), 0), 10, clock)
    assert isinstance(sample, RotorSpeeds)
    assert sample.first_esc == 5
    assert sample.rpm[:3] == (4000.0, -4100.0, 0.0)
    assert sample.rpm[3] != sample.rpm[3], "an absurd speed is NaN"
    info = decode(cut(pack(290, INFO, 1, 1, 0), 0), 10, clock)
    assert isinstance(info, EscTemperatures)
    assert info.temperature_c[0] == 30.0
    assert info.temperature_c[1] != info.temperature_c[1]
    assert info.temperature_c[2] == -5.0


def test_speeds_of_the_vehicle_pass_the_intake_and_those_of_another_do_not():
    link = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    intake = Intake()
    beat = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 137, 6 << 16, 4, 3).pack(link))
    intake.sample(cut(beat, 0), 0)
    assert isinstance(intake.sample(cut(pack(291, STATUS, 7, 1, 0), 0), 10), RotorSpeeds)
    assert intake.sample(cut(pack(291, STATUS, 1, 1, 0), 0), 20) is None, "of another vehicle"


@pytest.mark.parametrize("frame", [pack(291, STATUS, 1, 1, 1), pack(290, INFO, 1, 1, 1)])
def test_one_flipped_bit_of_payload_or_checksum_is_noticed(frame):
    for bit in range(8 * 10, 8 * len(frame)):
        bad = bytearray(frame)
        bad[bit // 8] ^= 1 << bit % 8
        assert not walk(bytes(bad), Counts())[0]
