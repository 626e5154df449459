"""Our own tables of MAVLink against pymavlink's dialect, and what is sent against pymavlink's encoder."""

from __future__ import annotations

import subprocess
import sys

import pytest

from companion.mavlink.definitions import CRC_EXTRAS, MESSAGES, PITCH_YAW_DEG
from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import BY_ID as ESC_BY_ID
from companion.mavlink.frames import pack
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.outgoing import command_long, heartbeat, named_value_float, param_request_read, statustext


def test_checksum_extras_are_those_of_the_dialect():
    assert {number: kind.crc_extra for number, kind in mavlink.mavlink_map.items() if number >= 0} == CRC_EXTRAS


@pytest.mark.parametrize("number", sorted(MESSAGES))
def test_layouts_are_those_of_the_dialect(number):
    ours, theirs = MESSAGES[number], mavlink.mavlink_map[number]
    assert ours.name == theirs.msgname
    assert list(ours.fields) == list(theirs.ordered_fieldnames)
    assert ours.format == theirs.unpacker.format


def test_every_message_that_is_decoded_has_a_layout():
    assert {*MESSAGES, *ESC_BY_ID} == set(LAYOUTS)


def test_sensor_orientations_are_those_of_the_dialect():
    names = {value: entry.name for value, entry in mavlink.enums["MAV_SENSOR_ORIENTATION"].items()}
    known = {value for value, name in names.items() if name.startswith("MAV_SENSOR_ROTATION_") and value != 100}
    assert known == set(PITCH_YAW_DEG)
    for value in known:
        words = names[value].removeprefix("MAV_SENSOR_ROTATION_").split("_")
        angles = dict(zip(words[::2], words[1::2], strict=False))
        assert PITCH_YAW_DEG[value] == (int(angles.get("PITCH", 0)), int(angles.get("YAW", 0)))


MAV = mavlink.MAVLink(None, srcSystem=7, srcComponent=191)
SENT = {
    "heartbeat": (heartbeat(), MAV.heartbeat_encode(18, 8, 0, 0, 4)),
    "parameter": (param_request_read(7, 1, "GUID_OPTIONS"), MAV.param_request_read_encode(7, 1, b"GUID_OPTIONS", -1)),
    "command": (
        command_long(7, 1, 511, 32.0, 20000.0),
        MAV.command_long_encode(7, 1, 511, 0, 32, 20000, 0, 0, 0, 0, 0),
    ),
    "named value": (
        named_value_float(1234, "cc_thrust", -0.125),
        MAV.named_value_float_encode(1234, b"cc_thrust", -0.125),
    ),
    "text": (statustext(4, "companion: holding"), MAV.statustext_encode(4, b"companion: holding")),
    "chunk": (statustext(4, "x" * 50, 3, 1), MAV.statustext_encode(4, b"x" * 50, 3, 1)),
}


@pytest.mark.parametrize("name", SENT)
def test_what_is_sent_is_what_pymavlink_would_send(name):
    ours, theirs = SENT[name]
    assert pack(*ours, 7, 191, MAV.seq) == theirs.pack(MAV)


def test_flight_imports_no_large_dialect_and_nothing_large_that_it_does_not_use():
    code = (
        "import sys, companion.flight, companion.mavlink.link as link, models; models.load(); link._mavutil()\n"
        "large = ('.ardupilotmega', '.v10.all', 'scipy', 'torch', '_ssl', '_curses', '_decimal')\n"
        "print([m for m in sys.modules if m.endswith(large)])"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_what_is_hidden_from_pymavlinks_endpoints_is_there_for_others():
    code = (
        "import companion.mavlink.link as link; mavutil = link._mavutil()\n"
        "import curses.ascii, ssl\n"
        "ssl.create_default_context()\n"
        "print(mavutil.is_printable('a'), mavutil.is_printable(chr(7)))"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "True False"
