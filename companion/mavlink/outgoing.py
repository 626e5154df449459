"""The few messages beside setpoints that this program sends: id and payload, packed by one struct each."""

from __future__ import annotations

import struct

TIMESYNC, _OURS_NS = 111, 191
Message = tuple[int, bytes]
"""Message id, and the payload in wire order."""

_HEARTBEAT = struct.Struct("<IBBBBB")
"""Custom mode, MAV_TYPE, MAV_AUTOPILOT, base mode, MAV_STATE, version of MAVLink."""
_PARAM_REQUEST_READ = struct.Struct("<hBB16s")
"""Index, target system and component, name."""
_COMMAND_LONG = struct.Struct("<7fHBBB")
"""Parameters, command, target system and component, confirmation."""
_NAMED_VALUE_FLOAT = struct.Struct("<If10s")
"""Boot time [ms], value, name."""
_TIMESYNC = struct.Struct("<qq")
"""Clock of who answers, 0 in a question; clock of who asks [ns]."""
_STATUSTEXT = struct.Struct("<B50sHB")
"""Severity, text, number of the text, place of the chunk."""
_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _ACTIVE, _MAVLINK = 18, 8, 4, 3


def heartbeat() -> Message:
    """HEARTBEAT of an onboard controller that is active."""
    return 0, _HEARTBEAT.pack(0, _ONBOARD_CONTROLLER, _NO_AUTOPILOT, 0, _ACTIVE, _MAVLINK)


def param_request_read(system: int, component: int, name: str) -> Message:
    """PARAM_REQUEST_READ of a parameter by its name."""
    return 20, _PARAM_REQUEST_READ.pack(-1, system, component, name.encode())


def command_long(system: int, component: int, command: int, *parameters: float) -> Message:
    """COMMAND_LONG; parameters that are not given are 0."""
    seven = (*parameters, *(0.0,) * (7 - len(parameters)))
    return 76, _COMMAND_LONG.pack(*seven, command, system, component, 0)


def timesync(now_us: int) -> Message:
    """TIMESYNC: a question for the autopilot's clock, known as ours by its nanoseconds."""
    return TIMESYNC, _TIMESYNC.pack(0, 1000 * now_us + _OURS_NS)


def timesync_answer(payload: bytes) -> tuple[int, int] | None:
    """When our question left, by our clock, and what the answering clock read [us]; None: no answer to us."""
    theirs, asked = _TIMESYNC.unpack(payload[: _TIMESYNC.size].ljust(_TIMESYNC.size, b"\0"))
    return (asked // 1000, theirs // 1000) if theirs > 0 and asked % 1000 == _OURS_NS else None


def named_value_float(boot_ms: int, name: str, value: float) -> Message:
    """NAMED_VALUE_FLOAT; the name has at most 10 characters."""
    return 251, _NAMED_VALUE_FLOAT.pack(boot_ms, value, name.encode())


def statustext(severity: int, text: str, number: int = 0, place: int = 0) -> Message:
    """STATUSTEXT of at most 50 characters; a text of several has a number above 0 and its places count from 0."""
    return 253, _STATUSTEXT.pack(severity, text.encode("ascii", "replace"), number, place)
