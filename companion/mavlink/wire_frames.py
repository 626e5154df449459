"""MAVLink 1 and 2 frames in the bytes of a link: found, checked and cut out. ``file_frames`` cuts those of a file.

A frame counts where its checksum passes. A frame of a message that the dialect does not know cannot be checked: it
counts where another frame (or the end of the data) follows it properly. After damage the walk looks for the next frame
that passes its checksum.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from mmap import mmap
from typing import Any, NamedTuple

from fastcrc.crc16 import mcrf4xx as crc16

from companion.mavlink.dialect import MESSAGES

V1 = 0xFE
V2 = 0xFD
"""First byte of a frame."""
SIGNATURE_BYTES = 13
"""Link id, 6 of time, 6 of the digest."""
V1_AROUND = 8
V2_AROUND = 12
"""Bytes of header and checksum around a payload."""

EXTRA = {number: bytes([kind.crc_extra]) for number, kind in MESSAGES.items()}
"""Checksum extra of every message, by id."""
Content = bytes | mmap
"""The bytes of a link or of a file: in memory, or mapped."""
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


def frame_bytes(data: Content, i: int) -> int:
    """Length of the frame that starts at ``i``, signature included."""
    if data[i] == V2:
        return data[i + 1] + (V2_AROUND + SIGNATURE_BYTES if data[i + 2] & 1 else V2_AROUND)
    return data[i + 1] + V1_AROUND


def cut(data: Content, i: int) -> Frame:
    """The frame that starts at ``i`` of ``data``, which a walk has found good."""
    length = data[i + 1]
    if data[i] == V2:
        number = data[i + 7] | data[i + 8] << 8 | data[i + 9] << 16
        end = i + length + (V2_AROUND + SIGNATURE_BYTES if data[i + 2] & 1 else V2_AROUND)
        return Frame(number, data[i + 5], data[i + 6], data[i + 10 : i + 10 + length], data[i:end])
    return Frame(
        data[i + 5],
        data[i + 3],
        data[i + 4],
        data[i + 6 : i + 6 + length],
        data[i : i + length + V1_AROUND],
    )


def checked_end(data: bytes, at: int) -> int:
    """Where the frame at ``at`` ends, if it is whole and its checksum passes; else 0."""
    n = len(data)
    if at + V2_AROUND <= n and data[at] == V2:
        end = at + 10 + data[at + 1]
        if data[at + 2] & 1:
            following = end + 2 + SIGNATURE_BYTES
        else:
            following = end + 2
        extra = EXTRA.get(data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16)
    elif at + V1_AROUND <= n and data[at] == V1:
        end = at + 6 + data[at + 1]
        extra = EXTRA.get(data[at + 5])
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


def foreign_end(data: Content, at: int, counts: Counts, ahead: int = 0) -> int:
    """Where the frame at ``at`` ends, whose checksum does not pass, if its message is of another dialect; else 0.

    Such a message cannot be checked. The frame after it, ``ahead`` bytes behind its end, vouches for its length.
    """
    n = len(data)
    if data[at] not in (V1, V2) or _cut_off(data, at):
        return 0
    following = at + frame_bytes(data, at)
    after = following + ahead
    if following < n and (after >= n or data[after] not in (V1, V2)):
        return 0
    if cut(data, at).id in EXTRA:
        counts.bad_crc += 1
        return 0
    counts.unknown += 1
    return following


def walk(data: bytes, counts: Counts) -> tuple[array[int], int]:
    """Offsets of all good frames in ``data``, and where the rest begins: a frame whose end may still arrive."""
    n = len(data)
    at = 0
    starts = array("q")
    while at + V1_AROUND <= n:
        if following := checked_end(data, at) or foreign_end(data, at, counts):
            starts.append(at)
            at = following
        elif data[at] in (V1, V2) and _cut_off(data, at):
            break
        else:
            found = _resync(data, at + 1)
            counts.skipped_bytes += found - at
            at = found
    return starts, at


def _cut_off(data: Content, at: int) -> bool:
    """Whether the frame that begins at ``at`` is longer than the data."""
    n = len(data)
    return at + V1_AROUND > n or at + frame_bytes(data, at) > n


def _resync(data: bytes, i: int) -> int:
    """Place of the next frame that passes its checksum, else of the first that is cut off, else the end."""
    marks = [mark.start() for mark in _MARK.finditer(data, i)]
    good = (at for at in marks if checked_end(data, at))
    cut_off = (at for at in marks if _cut_off(data, at))
    return next(chain(good, cut_off, [len(data)]))


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
        starts, rest = walk(data, self.counts)
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
    return b"\xfd" + body + crc16(body + EXTRA[message_id]).to_bytes(2, "little")
