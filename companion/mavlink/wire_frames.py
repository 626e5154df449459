"""MAVLink 1 and 2 frames in a run of bytes: found, checked and cut out, for the live link and for log files alike.

A frame counts where its checksum passes. A frame of a message that the dialect does not know cannot be checked: it
counts where another frame (or the end of the data) follows it properly. After damage the walk looks for the next frame
that passes its checksum.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from fastcrc.crc16 import mcrf4xx as crc16

from companion.mavlink.dialect import MESSAGES

V1 = 0xFE
V2 = 0xFD
"""First byte of a frame."""
SIGNATURE_BYTES = 13
"""Link id, 6 of time, 6 of the digest."""
_V1_AROUND = 8
_V2_AROUND = 12
"""Bytes of header and checksum around a payload."""
_SEARCH_BYTES = 1 << 20
"""Data without one good frame in its first MiB is no MAVLink."""

_EXTRA = {number: bytes([kind.crc_extra]) for number, kind in MESSAGES.items()}
"""Checksum extra of every message, by id."""
_MARK = re.compile(rb"[\xfd\xfe]")
"""Where a frame may begin."""


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
    return Frame(
        data[i + 5],
        data[i + 3],
        data[i + 4],
        data[i + 6 : i + 6 + length],
        data[i : i + length + _V1_AROUND],
    )


def checked_end(data: bytes, at: int) -> int:
    """Where the frame at ``at`` ends, if it is whole and its checksum passes; else 0."""
    n = len(data)
    if at + _V2_AROUND <= n and data[at] == V2:
        end = at + 10 + data[at + 1]
        if data[at + 2] & 1:
            following = end + 2 + SIGNATURE_BYTES
        else:
            following = end + 2
        extra = _EXTRA.get(data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16)
    elif at + _V1_AROUND <= n and data[at] == V1:
        end = at + 6 + data[at + 1]
        extra = _EXTRA.get(data[at + 5])
        following = end + 2
    else:
        return 0
    if (
        extra is None
        or following > n
        or crc16(data[at + 1 : end] + extra) != data[end] | data[end + 1] << 8
    ):
        return 0
    return following


def walk(
    data: bytes, counts: Counts, ahead: int = 0, *, whole: bool = True
) -> tuple[array[int], int]:
    """Offsets of all good frames in ``data``, and where the rest begins: a last frame that is not complete.

    ``ahead``: bytes that precede every frame (8 in a .tlog: its stamp); offsets are of these. ``whole`` False: more
    bytes may follow, so a frame that cannot be checked yet is left in the rest.
    """
    n = len(data)
    i = 0
    starts = array("q")
    while (at := i + ahead) + _V1_AROUND <= n:
        if following := checked_end(data, at):
            starts.append(i)
            i = following
            continue
        begun = data[at] == V1 or (data[at] == V2 and at + _V2_AROUND <= n)
        if begun:
            following = at + frame_bytes(data, at)
        else:
            following = n + 1
        if following == n or (following + ahead < n and data[following + ahead] in (V1, V2)):
            if cut(data, at).id not in _EXTRA:
                # A message of another dialect cannot be checked; the frame after it vouches for its length.
                counts.unknown += 1
                starts.append(i)
                i = following
                continue
            counts.bad_crc += 1
        proper = data[at] in (V1, V2)
        if not whole and proper and following > n:
            break  # the rest of this frame has not arrived yet
        found = _resync(data, at + 1, searched=len(starts) > 0) - ahead
        if found < 0:
            if not whole:
                rest = _unfinished(data, i + 1)
            elif proper:
                rest = i
            else:
                rest = n
            counts.skipped_bytes += rest - i
            return starts, rest
        counts.skipped_bytes += found - i
        i = found
    return starts, i


def _unfinished(data: bytes, i: int) -> int:
    """Place of the first byte at or after ``i`` that starts a frame which is longer than the data; else the end."""
    n = len(data)
    marks = (mark.start() for mark in _MARK.finditer(data, i))
    return next((at for at in marks if at + _V2_AROUND > n or at + frame_bytes(data, at) > n), n)


def _resync(data: bytes, i: int, *, searched: bool) -> int:
    """Place of the next frame that passes its checksum, or -1."""
    for mark in _MARK.finditer(data, i):
        if not searched and mark.start() > _SEARCH_BYTES:
            return -1
        if checked_end(data, mark.start()):
            return mark.start()
    return -1


class FrameReader:
    """Frames out of a link's bytes, whatever the pieces they arrive in."""

    def __init__(self) -> None:
        self.counts = Counts()
        self._rest = b""

    def feed(self, data: bytes) -> Sequence[Frame]:
        """The whole frames that ``data`` completes, in order."""
        if not self._rest and 0 < len(data) == checked_end(data, 0):  # as a datagram mostly is
            return (cut(data, 0),)
        data = self._rest + data
        starts, rest = walk(data, self.counts, whole=False)
        self._rest = data[rest:]
        return [cut(data, i) for i in starts]


def pack(
    message_id: int,
    payload: bytes,
    system: int,
    component: int,
    sequence: int,
    *,
    signed: bool = False,
) -> bytes:
    """A MAVLink 2 frame: trailing zeros of the payload cut, checksum with the message's extra.

    ``signed`` announces a signature, which is for the caller to append.
    """
    payload = payload.rstrip(b"\0") or b"\0"
    number = message_id.to_bytes(3, "little")
    body = (
        bytes((len(payload), int(signed), 0, sequence & 0xFF, system, component)) + number + payload
    )
    return b"\xfd" + body + crc16(body + _EXTRA[message_id]).to_bytes(2, "little")
