"""MAVLink frames of a whole file at once, by the rules of ``wire_frames``, which cuts the bytes of a link.

Headers are read as arrays. Each frame begins where the one before it says. Where it does not, a message of another
dialect stands there, or damage.
"""

from __future__ import annotations

from collections.abc import Iterator
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
    Content,
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
_NONE = (np.empty(0, np.int64), np.empty(0, np.int64))


@dataclass(frozen=True)
class Cut:
    """Where each good frame begins, in order, and where a last frame begins that is not complete."""

    start: Places
    rest: int


def cut_file(data: Content, counts: Counts, ahead: int) -> Cut:
    """All good frames of a file. ``ahead``: bytes that precede each one."""
    frames = FileFrames(data, counts, ahead)
    pieces = list(frames.pieces())
    return Cut(np.concatenate([np.empty(0, np.int64), *pieces]), frames.rest)


class FileFrames:
    """The good frames of a file, some at a time: a file of any length can be cut."""

    def __init__(self, data: Content, counts: Counts, ahead: int) -> None:
        """``ahead``: bytes that precede each frame."""
        self._data = data
        self._counts = counts
        self._ahead = ahead
        self._blocks = _checked(data)
        self._take(_NONE)
        self.rest = 0
        """Where a last frame begins that is not complete; known when all pieces are read."""

    def pieces(self) -> Iterator[Places]:
        """Where frames begin, in order."""
        data = self._data
        at = self._ahead
        while at + V1_AROUND <= len(data):
            k = self._checked_from(at)
            if k < len(self._start) and self._start[k] == at:
                run_end = int(self._run_ends[self._run_ends.searchsorted(k, "right")])
                yield self._start[k:run_end]
                at = int(self._end[run_end - 1]) + self._ahead
            elif following := foreign_end(data, at, self._counts, self._ahead):
                yield np.array([at])
                at = following + self._ahead
            else:
                if k < len(self._start):
                    found = int(self._start[k])
                elif data[at] in (V1, V2):
                    break
                else:
                    found = len(data) + self._ahead
                self._counts.skipped_bytes += found - at
                at = found
        self.rest = at - self._ahead

    def _checked_from(self, at: int) -> int:
        """Which frame of the block is the first to begin at ``at`` or later, in this block or one after it."""
        while not len(self._start) or self._start[-1] < at:
            block = next(self._blocks, None)
            if block is None:
                break
            self._take(block)
        return int(self._start.searchsorted(at))

    def _take(self, block: tuple[Places, Places]) -> None:
        """Go on with the frames of this block; those that follow one another are a run."""
        self._start, self._end = block
        apart = self._start[1:] != self._end[:-1] + self._ahead
        self._run_ends = np.append(np.flatnonzero(apart) + 1, len(self._start))


def message_ids(bytes_: Bytes, start: Places) -> NDArray[np.int32]:
    """The numbers of the messages in frames."""
    ids = bytes_[start + 5].astype(np.int32)
    v2 = bytes_[start] == V2
    wide = start[v2]
    low, middle, high = (bytes_[wide + place].astype(np.int32) for place in (7, 8, 9))
    ids[v2] = low | middle << 8 | high << 16
    return ids


def _checked(data: Content) -> Iterator[tuple[Places, Places]]:
    """Begin and end of every frame whose checksum passes, also of those within another, block by block."""
    bytes_ = np.frombuffer(data, np.uint8)
    for first in range(0, len(data), _BLOCK_BYTES):
        start, end = _checked_in(data, bytes_, first)
        if not first and not start.size:
            return
        yield start, end


def _checked_in(data: Content, bytes_: Bytes, first: int) -> tuple[Places, Places]:
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
