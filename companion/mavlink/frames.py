"""MAVLink 1 and 2 frames in a run of bytes: found, checked and cut out, for the live link and for log files alike.

A frame counts where its checksum passes. A frame of a message that the dialect does not know cannot be checked: it
counts where another frame (or the end of the data) follows it properly. After damage the walk looks for the next frame
that passes its checksum.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from fastcrc.crc16 import mcrf4xx as crc16

from companion.mavlink.dialect import MESSAGES

V1, V2 = 0xFE, 0xFD
"""First byte of a frame."""
SIGNATURE_BYTES = 13
"""Link id, 6 of time, 6 of the digest."""
_V1_AROUND, _V2_AROUND = 8, 12
"""Bytes of header and checksum around a payload."""
_SEARCH_BYTES = 1 << 20
"""Data without one good frame in its first MiB is no MAVLink."""

CRC_EXTRAS: dict[int, int] = {number: kind.crc_extra for number, kind in MESSAGES.items()}
"""Checksum extra of every message, by id."""
_EXTRA_V2 = {number.to_bytes(3, "little"): bytes([extra]) for number, extra in CRC_EXTRAS.items()}
_EXTRA_V1 = {number: bytes([extra]) for number, extra in CRC_EXTRAS.items() if number < 256}


class Frame(NamedTuple):
    """One whole frame: what its header says, and its bytes with checksum and signature."""

    id: int
    system: int
    component: int
    payload: bytes
    """As on the wire: MAVLink 2 cuts trailing zeros."""
    raw: bytes


@dataclass(slots=True)
class Counts:
    """What a walk met besides good frames."""

    bad_crc: int = 0
    """Frames dropped because their checksum is wrong, or because their message is of another dialect."""
    unknown: int = 0
    """Frames of messages that the dialect does not know."""
    skipped_bytes: int = 0


def unpacked(message_id: int, payload: bytes) -> tuple[Any, ...]:
    """The fields in wire order; trailing zeros filled up, fields of a later version left out."""
    unpacker = MESSAGES[message_id].unpacker
    if len(payload) != unpacker.size:
        payload = payload[: unpacker.size].ljust(unpacker.size, b"\0")
    fields: tuple[Any, ...] = unpacker.unpack(payload)
    return fields


def frame_bytes(data: bytes, i: int) -> int:
    """Length of the frame that starts at ``i``, signature included."""
    if data[i] == V2:
        return data[i + 1] + (_V2_AROUND + SIGNATURE_BYTES if data[i + 2] & 1 else _V2_AROUND)
    return data[i + 1] + _V1_AROUND


def cut(data: bytes, i: int) -> Frame:
    """The frame that starts at ``i`` of ``data``, which a walk has found good."""
    length = data[i + 1]
    if data[i] == V2:
        number = data[i + 7] | data[i + 8] << 8 | data[i + 9] << 16
        end = i + length + (_V2_AROUND + SIGNATURE_BYTES if data[i + 2] & 1 else _V2_AROUND)
        return Frame(number, data[i + 5], data[i + 6], data[i + 10 : i + 10 + length], data[i:end])
    return Frame(data[i + 5], data[i + 3], data[i + 4], data[i + 6 : i + 6 + length], data[i : i + length + _V1_AROUND])


def walk(data: bytes, counts: Counts, ahead: int = 0, *, whole: bool = True) -> tuple[array[int], int]:
    """Offsets of all good frames in ``data``, and where the rest begins: a last frame that is not complete.

    ``ahead``: bytes that precede every frame (8 in a .tlog: its stamp); offsets are of these. ``whole`` False: more
    bytes may follow, so a frame that cannot be checked yet is left in the rest.
    """
    n, i = len(data), 0
    starts = array("q")
    while (i := _good_run(data, i, ahead, starts)) + ahead + _V1_AROUND <= n:
        magic, following, known = _header(data, i + ahead)
        if following <= n and _proper_end(data, following, ahead):
            if not known:
                # A message of another dialect cannot be checked; the frame after it vouches for its length.
                counts.unknown += 1
                starts.append(i)
                i = following
                continue
            counts.bad_crc += 1
        if not whole and magic in (V1, V2) and following > n:
            break  # the rest of this frame has not arrived yet
        found = _resync(data, i + 1, ahead, searched=len(starts) > 0)
        if found < 0:
            rest = _unfinished(data, i + 1) if not whole else i if magic in (V1, V2) else n
            counts.skipped_bytes += rest - i
            return starts, rest
        counts.skipped_bytes += found - i
        i = found
    return starts, i


def _good_run(data: bytes, i: int, ahead: int, starts: array[int]) -> int:
    """Append the offsets of the frames from ``i`` on that follow each other with a right checksum; where they end."""
    n, after = len(data), ahead + 1
    append, crc, extra_v2, extra_v1 = starts.append, crc16, _EXTRA_V2, _EXTRA_V1
    while i + ahead + _V1_AROUND <= n:
        magic = data[i + ahead]
        if magic == V2 and i + ahead + _V2_AROUND <= n:
            end = i + ahead + 10 + data[i + after]
            following = end + 2 + SIGNATURE_BYTES if data[i + ahead + 2] & 1 else end + 2
            extra = extra_v2.get(data[i + ahead + 7 : i + ahead + 10])
        elif magic == V1:
            end = i + ahead + 6 + data[i + after]
            following = end + 2
            extra = extra_v1.get(data[i + ahead + 5])
        else:
            return i
        if following > n or extra is None:
            return i
        if crc(data[i + after : end] + extra) != data[end] | data[end + 1] << 8:
            return i
        append(i)
        i = following
    return i


def _header(data: bytes, at: int) -> tuple[int, int, bool]:
    """First byte, end, and whether the dialect knows the message, of what should be a frame at ``at``.

    The end is beyond ``data`` where this is no frame or its header is not complete.
    """
    magic, beyond = data[at], len(data) + 1
    if magic == V1:
        return magic, at + frame_bytes(data, at), data[at + 5] in _EXTRA_V1
    if magic == V2 and at + _V2_AROUND <= len(data):
        return magic, at + frame_bytes(data, at), data[at + 7 : at + 10] in _EXTRA_V2
    return magic, beyond, False


def _proper_end(data: bytes, following: int, ahead: int) -> bool:
    """Whether another frame, or the end of the data, is where a frame ends."""
    return following == len(data) or (following + ahead < len(data) and data[following + ahead] in (V1, V2))


def _unfinished(data: bytes, i: int) -> int:
    """Place of the first byte at or after ``i`` that starts a frame which is longer than the data; else the end."""
    n = len(data)
    while i < n:
        marks = [at for at in (data.find(V2, i), data.find(V1, i)) if at >= 0]
        if not marks:
            return n
        i = min(marks)
        if i + _V2_AROUND > n or i + frame_bytes(data, i) > n:
            return i
        i += 1
    return n


def _resync(data: bytes, i: int, ahead: int, *, searched: bool) -> int:
    """Offset of the next frame that passes its checksum, or -1."""
    n = len(data)
    two, one = data.find(V2, i + ahead), data.find(V1, i + ahead)
    while two >= 0 or one >= 0:
        if not searched and min(m for m in (two, one) if m >= 0) > _SEARCH_BYTES:
            return -1
        if one < 0 or 0 <= two < one:
            m, header, two = two, 10, data.find(V2, two + 1)
            extra = _EXTRA_V2.get(data[m + 7 : m + 10])
        else:
            m, header, one = one, 6, data.find(V1, one + 1)
            extra = _EXTRA_V1.get(data[m + 5]) if m + 5 < n else None
        if extra is None or m + 1 >= n:
            continue
        end = m + header + data[m + 1]
        if end + 2 <= n and crc16(data[m + 1 : end] + extra) == data[end] | data[end + 1] << 8:
            return m - ahead
    return -1


def only_frame(data: bytes) -> Frame | None:
    """The one good MAVLink 2 frame that ``data`` is, as a datagram mostly is; None where it is anything else."""
    n = len(data)
    if n < _V2_AROUND or data[0] != V2 or n != data[1] + (_V2_AROUND + SIGNATURE_BYTES if data[2] & 1 else _V2_AROUND):
        return None
    number, end = data[7:10], 10 + data[1]
    extra = _EXTRA_V2.get(number)
    if extra is None or crc16(data[1:end] + extra) != data[end] | data[end + 1] << 8:
        return None
    return Frame(int.from_bytes(number, "little"), data[5], data[6], data[10:end], data)


class FrameReader:
    """Frames out of a link's bytes, whatever the pieces they arrive in."""

    def __init__(self) -> None:
        self.counts = Counts()
        self._rest = b""

    def feed(self, data: bytes) -> Sequence[Frame]:
        """The whole frames that ``data`` completes, in order."""
        if not self._rest and (frame := only_frame(data)) is not None:
            return (frame,)
        data = self._rest + data
        starts, rest = walk(data, self.counts, whole=False)
        self._rest = data[rest:]
        return [cut(data, i) for i in starts]


def pack(message_id: int, payload: bytes, system: int, component: int, sequence: int, *, signed: bool = False) -> bytes:
    """A MAVLink 2 frame: trailing zeros of the payload cut, checksum with the message's extra.

    ``signed`` announces a signature, which is for the caller to append.
    """
    payload = payload.rstrip(b"\0") or b"\0"
    number = message_id.to_bytes(3, "little")
    body = bytes((len(payload), int(signed), 0, sequence & 0xFF, system, component)) + number + payload
    return b"\xfd" + body + crc16(body + _EXTRA_V2[number]).to_bytes(2, "little")
