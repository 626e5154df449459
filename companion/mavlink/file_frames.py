"""MAVLink frames of a whole file at once, by the rules of ``wire_frames``, which cuts the bytes of a link.

Headers are read as arrays. Each frame begins where the one before it says. Where it does not, a message of another
dialect stands there, or damage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from fastcrc.crc16 import mcrf4xx as crc16
from numpy.typing import NDArray

from companion.mavlink.wire_frames import (
    EXTRA,
    SIGNATURE_BYTES,
    V1,
    V1_AROUND,
    V2,
    V2_AROUND,
    Counts,
    foreign_end,
)

STAMP_BYTES = 8
"""Of the receiver's clock, before every frame of a .tlog."""
_BLOCK_BYTES = 1 << 20
"""Looked through at once. Data without one good frame in its first block is no MAVLink."""

_NUMBERS = np.fromiter(EXTRA, np.int32)

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]


@dataclass(frozen=True)
class Cut:
    """Where each good frame begins, in order, and where a last frame begins that is not complete."""

    start: Places
    rest: int


def cut_file(data: bytes, counts: Counts, ahead: int) -> Cut:
    """All good frames of a file. ``ahead``: bytes that precede each one."""
    start, end = _checked(data)
    run_ends = np.append(np.flatnonzero(start[1:] != end[:-1] + ahead) + 1, len(start))
    pieces = [start[:0]]
    at = ahead
    while at + V1_AROUND <= len(data):
        k = start.searchsorted(at)
        if k < len(start) and start[k] == at:
            run_end = run_ends[run_ends.searchsorted(k, "right")]
            pieces.append(start[k:run_end])
            at = int(end[run_end - 1]) + ahead
        elif following := foreign_end(data, at, counts, ahead):
            pieces.append(np.array([at]))
            at = following + ahead
        else:
            if k < len(start):
                found = int(start[k])
            elif data[at] in (V1, V2):
                break
            else:
                found = len(data) + ahead
            counts.skipped_bytes += found - at
            at = found
    return Cut(np.concatenate(pieces), at - ahead)


def message_ids(bytes_: Bytes, start: Places) -> NDArray[np.int32]:
    """The numbers of the messages in frames."""
    ids = bytes_[start + 5].astype(np.int32)
    v2 = bytes_[start] == V2
    wide = start[v2]
    low, middle, high = (bytes_[wide + place].astype(np.int32) for place in (7, 8, 9))
    ids[v2] = low | middle << 8 | high << 16
    return ids


def _checked(data: bytes) -> tuple[Places, Places]:
    """Begin and end of every frame whose checksum passes, also of those within another."""
    bytes_ = np.frombuffer(data, np.uint8)
    found = []
    for first in range(0, len(data), _BLOCK_BYTES):
        start, end = _checked_in(data, bytes_, first)
        found.append((start, end))
        if not found[0][0].size:
            break
    starts, ends = zip(*found, strict=True)
    return np.concatenate(starts), np.concatenate(ends)


def _checked_in(data: bytes, bytes_: Bytes, first: int) -> tuple[Places, Places]:
    """Of the block that begins at ``first``."""
    block = bytes_[first : first + _BLOCK_BYTES]
    start = first + np.flatnonzero((block == V1) | (block == V2))
    around = np.where(bytes_[start] == V2, V2_AROUND, V1_AROUND)
    start = start[start + around <= len(data)]
    v2 = bytes_[start] == V2
    numbers = message_ids(bytes_, start)
    body_end = start + np.where(v2, 10, 6) + bytes_[start + 1]
    signed = v2 & (bytes_[start + 2] & 1 > 0)
    end = body_end + 2 + np.where(signed, SIGNATURE_BYTES, 0)
    known = np.flatnonzero((end <= len(data)) & np.isin(numbers, _NUMBERS))
    found = zip(
        start[known].tolist(), body_end[known].tolist(), numbers[known].tolist(), strict=True
    )
    sums = [crc16(data[at + 1 : to] + EXTRA[number]) for at, to, number in found]
    sent_at = body_end[known]
    sent = bytes_[sent_at] | bytes_[sent_at + 1].astype(np.uint16) << 8
    right = known[np.array(sums, np.uint16) == sent]
    return start[right], end[right]
