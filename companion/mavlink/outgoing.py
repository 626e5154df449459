"""The few messages beside setpoints that this program sends: id and payload."""

from __future__ import annotations

from companion.mavlink import NO_AUTOPILOT
from companion.mavlink.dialect import MESSAGES
from companion.mavlink.wire_frames import unpacked

TIMESYNC = 111
_OURS_NS = 191
Message = tuple[int, bytes]
"""Message id, and the payload in wire order."""

_ONBOARD_CONTROLLER = 18
_ACTIVE = 4
_MAVLINK = 3


def message(number: int, *fields: object) -> Message:
    """A message of these fields, in wire order."""
    return number, MESSAGES[number].unpacker.pack(*fields)


def heartbeat() -> Message:
    """HEARTBEAT of an onboard controller that is active."""
    return message(0, 0, _ONBOARD_CONTROLLER, NO_AUTOPILOT, 0, _ACTIVE, _MAVLINK)


def param_request_read(system: int, component: int, name: str) -> Message:
    """PARAM_REQUEST_READ of a parameter by its name."""
    return message(20, -1, system, component, name.encode())


def command_long(system: int, component: int, command: int, *parameters: float) -> Message:
    """COMMAND_LONG; parameters that are not given are 0."""
    seven = (*parameters, *(0.0,) * (7 - len(parameters)))
    return message(76, *seven, command, system, component, 0)


def timesync(now_us: int) -> Message:
    """TIMESYNC: a question for the autopilot's clock, known as ours by its nanoseconds."""
    return message(TIMESYNC, 0, 1000 * now_us + _OURS_NS)


def timesync_answer(payload: bytes) -> tuple[int, int] | None:
    """When our question left, by our clock, and what the answering clock read [us]; None: no answer to us."""
    answered_ns, sent_ns = unpacked(TIMESYNC, payload)
    if answered_ns > 0 and sent_ns % 1000 == _OURS_NS:
        return (sent_ns // 1000, answered_ns // 1000)
    return None


def named_value_float(boot_ms: int, name: str, value: float) -> Message:
    """NAMED_VALUE_FLOAT; the name has at most 10 characters."""
    return message(251, boot_ms, value, name.encode())


def statustext(severity: int, text: str, number: int = 0, place: int = 0) -> Message:
    """STATUSTEXT of at most 50 characters; a text of several has a number above 0 and its places count from 0."""
    return message(253, severity, text.encode("ascii", "replace"), number, place)
