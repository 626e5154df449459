"""Reads a .tlog: 8-byte big-endian microseconds of the receiver's clock, then a MAVLink 1 or 2 frame, again and again.

Every frame is CRC-checked; after damage the walk looks for the next frame that passes. Stamps that cannot be true are
repaired from their neighbours. What was dropped or repaired is counted (``Report``), never hidden.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from companion.mavlink.file_frames import STAMP_BYTES, Bytes, FileFrames, message_ids
from companion.mavlink.wire_frames import V2, Content, Counts, frame_bytes
from companion.mavlink.wire_layout import wire_format
from models.common.errors import LogError
from models.common.frames import Mask, Whole
from replay.logs.files import read_file
from replay.spill import BLOCK, Spool, blocks, release, spans, spilled

GROUND_STATION = 190
"""MAV_COMP_ID_MISSIONPLANNER."""
_STAMP_TOLERANCE_US = 500_000
"""Links seldom hold messages back for half a second; a damaged stamp is off by far more."""
_LONGEST_PAUSE_US = 3_600_000_000
_NO_STAMP = np.uint64(2**62)
"""Larger numbers are no time in microseconds (146 000 years), and would overflow signed 64 bits."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What had to be dropped or repaired."""

    bad_crc: int
    """Frames dropped because their checksum is wrong, or because their message is of another dialect."""
    unknown: int
    """Frames of messages that the dialect does not know: kept where the next frame follows properly."""
    skipped_bytes: int
    truncated_bytes: int
    """Length of an incomplete last frame."""
    stamps_repaired: int
    clock_steps: int
    """Backward steps of the receiver's clock that lasted."""

    def notes(self) -> list[str]:
        """What a reader should know, in words."""
        out = []
        if self.bad_crc or self.skipped_bytes:
            out.append(
                f"{self.bad_crc} frames with a wrong checksum dropped, {self.skipped_bytes} bytes "
                "skipped"
            )
        if self.truncated_bytes:
            out.append(f"last frame cut off ({self.truncated_bytes} bytes)")
        if self.stamps_repaired:
            out.append(f"{self.stamps_repaired} receiver stamps repaired")
        if self.clock_steps:
            out.append(f"the receiver's clock was set back {self.clock_steps} times")
        return out


@dataclass(frozen=True)
class Tlog:
    """A walked file. All arrays have shape (n,), one place per good frame in file order."""

    path: Path
    data: Content = field(repr=False)
    start: Whole
    """Offset of the frame's first byte (the magic)."""
    arrival_us: Whole
    message_id: NDArray[np.int32]
    system: Bytes
    component: Bytes
    report: Report

    def __len__(self) -> int:
        return len(self.start)

    def part(self, first: int, end: int) -> Tlog:
        """The frames ``first`` <= i < ``end``, as views."""
        return self.taken(slice(first, end))

    def taken(self, own: slice | Whole) -> Tlog:
        """Some of the frames, by their places."""
        return replace(
            self,
            start=self.start[own],
            arrival_us=self.arrival_us[own],
            message_id=self.message_id[own],
            system=self.system[own],
            component=self.component[own],
        )

    def frames(self) -> Iterator[tuple[int, bytes]]:
        """(arrival stamp [us], frame) in file order."""
        for rows in blocks(len(self)):
            arrivals = self.arrival_us[rows].tolist()
            starts = self.start[rows].tolist()
            for arrival, start in zip(arrivals, starts, strict=True):
                end = start + frame_bytes(self.data, start)
                yield arrival, self.data[start:end]

    def indices(self, message_id: int, system: int | None = None) -> Whole:
        """Places of the frames of one message, of one system if given."""
        found = [np.empty(0, np.int64)]
        for rows in blocks(len(self)):
            match = self.message_id[rows] == message_id
            if system is not None:
                match &= self.system[rows] == system
            found.append(rows.start + np.flatnonzero(match))
        return np.concatenate(found)

    def records(self, message_id: int, indices: Whole) -> NDArray[Any]:
        """Payloads of the frames at ``indices``, all of one message, zero-padded: array of its wire format."""
        dtype = wire_format(message_id).dtype
        raw = np.zeros((len(indices), dtype.itemsize), np.uint8)
        for part in spans(indices):
            self._fill(raw[part], self.start[indices[part]])
        return raw.view(dtype).reshape(-1)

    def _fill(self, raw: Bytes, start: Whole) -> None:
        """Payloads of the frames that begin at ``start`` (n,) into ``raw`` (n, bytes); what is shorter stays zero."""
        file = np.frombuffer(self.data, np.uint8)
        payload = start + np.where(file[start] == V2, 10, 6)
        length = np.minimum(file[start + 1], raw.shape[1])
        lengths = np.flatnonzero(np.bincount(length, minlength=1)).tolist()
        for size in lengths:
            if size:
                rows = np.flatnonzero(length == size)
                payloads = sliding_window_view(file, size)
                raw[rows, :size] = payloads[payload[rows]]

    def counts(self) -> Counter[tuple[int, int, int]]:
        """How many frames of each (system, component, message id), by message id."""
        sender = self.system.astype(np.int64) << 8 | self.component
        keys = self.message_id.astype(np.int64) << 16 | sender
        distinct, count = np.unique(keys, return_counts=True)
        out: Counter[tuple[int, int, int]] = Counter()
        for key, frames in zip(distinct.tolist(), count.tolist(), strict=True):
            out[key >> 8 & 255, key & 255, key >> 16] = frames
        return out


def read_tlog(path: Path) -> Tlog:
    """Every frame of a file. Raises LogError where it cannot be read, is empty, or holds no MAVLink frame."""
    data = read_file(path)
    file = np.frombuffer(data, np.uint8)
    counts = Counts()
    frames = FileFrames(data, counts, STAMP_BYTES)
    start = Spool(np.int64)
    stamps = Spool(np.int64)
    message_id = Spool(np.int32)
    system = Spool(np.uint8)
    component = Spool(np.uint8)
    for magic in _together(frames.pieces()):
        sender = magic + np.where(file[magic] == V2, 5, 3)
        start.append(magic)
        stamps.append(_stamps(file, magic))
        message_id.append(message_ids(file, magic))
        system.append(file[sender])
        component.append(file[sender + 1])
    places = start.array()
    if not places.size:
        raise LogError(f"{path}: holds no MAVLink frame: not a .tlog, or damaged throughout")
    arrival, repaired, steps = repair_stamps(stamps.array())
    report = Report(
        bad_crc=counts.bad_crc,
        unknown=counts.unknown,
        skipped_bytes=counts.skipped_bytes,
        truncated_bytes=len(data) - frames.rest,
        stamps_repaired=repaired,
        clock_steps=steps,
    )
    return Tlog(
        path=path,
        data=data,
        start=places,
        arrival_us=spilled(arrival),
        message_id=message_id.array(),
        system=system.array(),
        component=component.array(),
        report=report,
    )


def _together(pieces: Iterable[Whole]) -> Iterator[Whole]:
    """The same in pieces of at least ``BLOCK``, but for the last; what was mapped is given back after each."""
    waiting: list[Whole] = []
    count = 0
    for piece in pieces:
        waiting.append(piece)
        count += len(piece)
        if count >= BLOCK:
            yield np.concatenate(waiting)
            waiting = []
            count = 0
            release()
    if waiting:
        yield np.concatenate(waiting)


def _stamps(file: Bytes, magic: Whole) -> Whole:
    """The receiver's stamps [us] before the frames that begin at ``magic`` (n,)."""
    stamps = sliding_window_view(file, STAMP_BYTES)[magic - STAMP_BYTES]
    found: NDArray[np.uint64] = stamps.view(">u8").reshape(-1)
    return np.minimum(found, _NO_STAMP).astype(np.int64)


def repair_stamps(stamps_us: Whole) -> tuple[Whole, int, int]:
    """Receiver stamps (n,) with the impossible ones interpolated; how many; how often the clock was set back.

    A stamp is impossible where it differs by more than half a second from the median of itself and its two neighbours
    on either side: gaps and lasting steps of the clock pass, single damaged stamps (back in time, year 2793) do not.
    The first and the last have neighbours on one side only: up to an hour from them, in order, is taken as a pause.
    """
    odd = outliers(stamps_us, _STAMP_TOLERANCE_US).tolist()
    bad = np.array([i for i in odd if not _behind_a_pause(stamps_us, i)], np.int64)
    if len(bad):
        stamps_us = stamps_us.copy()
        # What lies between two bad ones is all that the lines through them need.
        beside = np.clip(bad[:, None] + (-1, 1), 0, len(stamps_us) - 1)
        good = np.setdiff1d(beside, bad)
        first_good = np.setdiff1d(np.arange(len(bad) + 1), bad)[0]
        origin = stamps_us[first_good]
        since = (stamps_us[good] - origin).astype(float)
        fitted = np.interp(bad, good, since)
        stamps_us[bad] = origin + np.rint(fitted).astype(np.int64)
    set_back = places_of(stamps_us, lambda steps: steps < -_STAMP_TOLERANCE_US)
    return stamps_us, len(bad), len(set_back)


def places_of(values: Whole, wanted: Callable[[Whole], Mask]) -> Whole:
    """Places of (n,) from which the step to the next is one that is ``wanted``."""
    found = [np.empty(0, np.int64)]
    for rows in blocks(len(values)):
        steps = np.diff(values[rows.start : rows.stop + 1])
        found.append(rows.start + np.flatnonzero(wanted(steps)))
    return np.concatenate(found)


def _behind_a_pause(stamps_us: Whole, i: int) -> bool:
    """Whether a stamp is the first or the last, and in order: a link that begins or ends with one frame and a pause."""
    last = len(stamps_us) - 1
    if 0 < i < last:
        return False
    inner = 1 if i == 0 else last
    pause = stamps_us[inner] - stamps_us[inner - 1]
    return bool(0 <= pause <= _LONGEST_PAUSE_US)


def outliers(values: Whole, tolerance: int) -> Whole:
    """Places of (n,) that differ by more than ``tolerance`` from the median of themselves and two neighbours each side.

    In a sequence that only grows none does, however large its steps, except the first and the last: beyond them there
    is nothing to compare with.
    """
    last = len(values) - 1
    odd = places_of(values, lambda steps: (steps < 0) | (steps > tolerance))
    if last < 4 or not odd.size:
        return np.empty(0, np.int64)
    near = np.unique(np.clip(odd[:, None] + np.arange(-2, 4), 0, last))
    found = []
    for rows in blocks(len(near)):
        # Beyond the ends the sequence is mirrored.
        around = np.abs(near[rows, None] + np.arange(-2, 3))
        around = np.where(around <= last, around, 2 * last - around)
        median = np.median(values[around], axis=1)
        far = np.abs(values[near[rows]] - median) > tolerance
        found.append(near[rows][far])
    return np.concatenate(found)
