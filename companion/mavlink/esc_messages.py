"""ESC_INFO (290) and ESC_STATUS (291), which pymavlink 2.4.50 has in no dialect: frames in, frames out.

pymavlink hands these frames over as ``UNKNOWN_290`` / ``UNKNOWN_291`` *without* checking their CRC, so it is checked
here. Field order on the wire, sizes and checksum extras follow from the fields in common.xml by MAVLink's own rules
(fields by size, the extra from names and types); ``tests/companion/test_messages_esc.py`` derives them again with
pymavlink's generator.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar

from pymavlink.generator.mavcrc import x25crc

INT16_MAX = 2**15 - 1
_STX, _HEADER, _CRC, _SIGNATURE = 0xFD, 10, 2, 13

Four = tuple[int, int, int, int]
FourFloats = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class EscInfo:
    """ESC_INFO as on the wire: ``index`` is the first of the four ESCs, from 0; temperature in cdegC."""

    ID: ClassVar[int] = 290
    CRC_EXTRA: ClassVar[int] = 251
    PAYLOAD: ClassVar[struct.Struct] = struct.Struct("<Q4IH4H4hBBBB")
    NAME: ClassVar[str] = "ESC_INFO"

    system: int
    component: int
    time_usec: int
    error_count: Four
    counter: int
    failure_flags: Four
    temperature: Four
    index: int
    count: int
    connection_type: int
    info: int

    @classmethod
    def _from_wire(cls, system: int, component: int, v: tuple[int, ...]) -> EscInfo:
        errors, flags, temperature = (v[1], v[2], v[3], v[4]), (v[6], v[7], v[8], v[9]), (v[10], v[11], v[12], v[13])
        return cls(system, component, v[0], errors, v[5], flags, temperature, v[14], v[15], v[16], v[17])

    def _payload(self) -> bytes:
        return self.PAYLOAD.pack(
            self.time_usec, *self.error_count, self.counter, *self.failure_flags, *self.temperature,
            self.index, self.count, self.connection_type, self.info,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class EscStatus:
    """ESC_STATUS as on the wire: rpm (negative in reverse), V, A; ``index`` is the first of the four ESCs, from 0."""

    ID: ClassVar[int] = 291
    CRC_EXTRA: ClassVar[int] = 10
    PAYLOAD: ClassVar[struct.Struct] = struct.Struct("<Q4i4f4fB")
    NAME: ClassVar[str] = "ESC_STATUS"

    system: int
    component: int
    time_usec: int
    rpm: Four
    voltage: FourFloats
    current: FourFloats
    index: int

    @classmethod
    def _from_wire(cls, system: int, component: int, v: tuple[float, ...]) -> EscStatus:
        rpm = (int(v[1]), int(v[2]), int(v[3]), int(v[4]))
        return cls(system, component, int(v[0]), rpm, (v[5], v[6], v[7], v[8]), (v[9], v[10], v[11], v[12]), int(v[13]))

    def _payload(self) -> bytes:
        return self.PAYLOAD.pack(self.time_usec, *self.rpm, *self.voltage, *self.current, self.index)


EscMessage = EscInfo | EscStatus
BY_ID: dict[int, type[EscInfo] | type[EscStatus]] = {EscInfo.ID: EscInfo, EscStatus.ID: EscStatus}


def parse_frame(frame: bytes | bytearray) -> EscMessage | None:
    """The message in one whole MAVLink 2 frame, or None: not one of the two, of the wrong length, or CRC wrong."""
    if len(frame) < _HEADER + _CRC or frame[0] != _STX:
        return None
    kind = BY_ID.get(frame[7] | frame[8] << 8 | frame[9] << 16)
    end = _HEADER + frame[1]
    if kind is None or len(frame) != end + _CRC + (_SIGNATURE if frame[2] & 1 else 0):
        return None
    if x25crc(bytes(frame[1:end]) + bytes([kind.CRC_EXTRA])).crc != frame[end] | frame[end + 1] << 8:
        return None
    # MAVLink 2 drops trailing zeros; a later version may append fields.
    payload = bytes(frame[_HEADER:end])[: kind.PAYLOAD.size].ljust(kind.PAYLOAD.size, b"\0")
    return kind._from_wire(frame[5], frame[6], kind.PAYLOAD.unpack(payload))


def pack_frame(message: EscMessage, sequence: int) -> bytes:
    """The MAVLink 2 frame (unsigned) of ``message``, as an autopilot sends it."""
    payload = message._payload().rstrip(b"\0") or b"\0"
    header = struct.pack(
        "<BBBBBBHB", len(payload), 0, 0, sequence & 0xFF, message.system, message.component, message.ID, 0
    )
    crc = x25crc(header + payload + bytes([message.CRC_EXTRA])).crc
    return bytes([_STX]) + header + payload + struct.pack("<H", crc)
