"""Reads a .tlog: 8-byte big-endian microseconds of the receiver's clock, then a MAVLink 1 or 2 frame, again and again.

Every frame is CRC-checked; after damage the walk looks for the next frame that passes. Stamps that cannot be true are
repaired from their neighbours. What was dropped or repaired is counted (``Report``), never hidden.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from companion.mavlink.file_frames import STAMP_BYTES, FileFrames, message_ids
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
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    report: Report

    def __len__(self) -> int:
        return len(self.start)

    def part(self, first: int, end: int) -> Tlog:
        """The frames ``first`` <= i < ``end``, as views."""
        return self.taken(slice(first, end))

    def taken(self, own: slice | Whole) -> Tlog:
        """Some of the frames, by their places."""
        arrays = (
            self.start[own],
            self.arrival_us[own],
            self.message_id[own],
            self.system[own],
            self.component[own],
        )
        return Tlog(self.path, self.data, *arrays, self.report)

    def frames(self) -> Iterator[tuple[int, bytes]]:
        """(arrival stamp [us], frame) in file order."""
        for rows in blocks(len(self)):
            places = zip(self.arrival_us[rows].tolist(), self.start[rows].tolist(), strict=True)
            for arrival, i in places:
                yield arrival, self.data[i : i + frame_bytes(self.data, i)]

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
        bytes_ = np.frombuffer(self.data, np.uint8)
        for part in spans(indices):
            self._fill(raw[part], bytes_, self.start[indices[part]])
        return raw.view(dtype).reshape(-1)

    def _fill(self, raw: NDArray[np.uint8], bytes_: NDArray[np.uint8], start: Whole) -> None:
        """Payloads of the frames that begin at ``start`` (n,) into ``raw`` (n, bytes); what is shorter stays zero."""
        payload = start + np.where(bytes_[start] == V2, 10, 6)
        length = np.minimum(bytes_[start + 1], raw.shape[1])
        for size in np.flatnonzero(np.bincount(length, minlength=1)):
            if size:
                rows = np.flatnonzero(length == size)
                raw[rows, :size] = sliding_window_view(bytes_, int(size))[payload[rows]]

    def counts(self) -> Counter[tuple[int, int, int]]:
        """How many frames of each (system, component, message id), by message id."""
        key = (
            self.message_id.astype(np.int64) << 16
            | self.system.astype(np.int64) << 8
            | self.component
        )
        values, count = np.unique(key, return_counts=True)
        senders = zip(
            (values >> 8 & 255).tolist(),
            (values & 255).tolist(),
            (values >> 16).tolist(),
            strict=True,
        )
        return Counter(dict(zip(senders, count.tolist(), strict=True)))


def read_tlog(path: Path) -> Tlog:
    """Every frame of a file. Raises LogError where it cannot be read, is empty, or holds no MAVLink frame."""
    data = read_file(path)
    bytes_ = np.frombuffer(data, np.uint8)
    counts = Counts()
    frames = FileFrames(data, counts, STAMP_BYTES)
    start = Spool(np.int64)
    stamps = Spool(np.int64)
    message_id = Spool(np.int32)
    system = Spool(np.uint8)
    component = Spool(np.uint8)
    for magic in _together(frames.pieces()):
        source = magic + np.where(bytes_[magic] == V2, 5, 3)
        start.append(magic)
        stamps.append(_stamps(bytes_, magic))
        message_id.append(message_ids(bytes_, magic))
        system.append(bytes_[source])
        component.append(bytes_[source + 1])
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


def _stamps(bytes_: NDArray[np.uint8], magic: Whole) -> Whole:
    """The receiver's stamps [us] before the frames that begin at ``magic`` (n,)."""
    stamps = sliding_window_view(bytes_, STAMP_BYTES)[magic - STAMP_BYTES]
    found: NDArray[np.uint64] = stamps.view(">u8").reshape(-1)
    return np.minimum(found, _NO_STAMP).astype(np.int64)


def repair_stamps(stamps_us: Whole) -> tuple[Whole, int, int]:
    """Receiver stamps (n,) with the impossible ones interpolated; how many; how often the clock was set back.

    A stamp is impossible where it differs by more than half a second from the median of itself and its two neighbours
    on either side: gaps and lasting steps of the clock pass, single damaged stamps (back in time, year 2793) do not.
    The first and the last have neighbours on one side only: up to an hour from them, in order, is taken as a pause.
    """
    bad = outliers(stamps_us, _STAMP_TOLERANCE_US)
    bad = bad[[not _behind_a_pause(stamps_us, int(i)) for i in bad]]
    if len(bad):
        stamps_us = stamps_us.copy()
        # What lies between two bad ones is all that the lines through them need.
        near = np.unique(np.clip(bad[:, None] + (-1, 1), 0, len(stamps_us) - 1))
        good = np.setdiff1d(near, bad)
        origin = stamps_us[np.setdiff1d(np.arange(len(bad) + 1), bad)[0]]
        fitted = np.interp(bad, good, (stamps_us[good] - origin).astype(float))
        stamps_us[bad] = origin + np.rint(fitted).astype(np.int64)
    set_back = len(places_of(stamps_us, lambda steps: steps < -_STAMP_TOLERANCE_US))
    return stamps_us, len(bad), set_back


def places_of(values: Whole, wanted: Callable[[Whole], Mask]) -> Whole:
    """Places of (n,) from which the step to the next is one that is ``wanted``."""
    found = [np.empty(0, np.int64)]
    for rows in blocks(len(values)):
        steps = np.diff(values[rows.start : rows.stop + 1])
        found.append(rows.start + np.flatnonzero(wanted(steps)))
    return np.concatenate(found)


def _behind_a_pause(stamps_us: Whole, i: int) -> bool:
    """Whether a stamp is the first or the last, and in order: a link that begins or ends with one frame and a pause."""
    n = len(stamps_us)
    ends = {0: stamps_us[1] - stamps_us[0], n - 1: stamps_us[-1] - stamps_us[-2]}
    return i in ends and 0 <= ends[i] <= _LONGEST_PAUSE_US


def outliers(values: Whole, tolerance: int) -> Whole:
    """Places of (n,) that differ by more than ``tolerance`` from the median of themselves and two neighbours each side.

    In a sequence that only grows none does, however large its steps, except the first and the last: beyond them there
    is nothing to compare with.
    """
    n = len(values)
    odd = places_of(values, lambda steps: (steps < 0) | (steps > tolerance))
    if n < 5 or not odd.size:
        return np.empty(0, np.int64)
    near = np.unique(np.clip(odd[:, None] + np.arange(-2, 4), 0, n - 1))
    # Beyond the ends the sequence is mirrored.
    around = np.abs(near[:, None] + np.arange(-2, 3))
    around = np.where(around < n, around, 2 * (n - 1) - around)
    median = np.median(values[around], axis=1)
    return np.asarray(near[np.abs(values[near] - median) > tolerance])
