"""A .tlog of any length in blocks: memory is that of one block, whatever the size of the file.

The file is walked once for what concerns all of it (frames, damage, vehicles, parameters) and once more for its blocks.
A block comes with some frames of its neighbours, so that filters, interpolation and clocks meet no edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.mavlink.frames import Counts, walk
from replay.logs.files import open_file
from replay.logs.tlog import STAMP, Report, Tlog, no_frame, tlog_of
from replay.logs.tlog_vehicle import Census

BLOCK_BYTES = 32 * 2**20
"""Some 35 minutes of the companion's streams. Logs that are not longer are read at once."""
MARGIN_BYTES = 2**20
"""Of a neighbour: a minute of the companion's streams, a second of a link that carries 8 Mbit/s."""


@dataclass(frozen=True)
class Block:
    """Frames ``first`` <= i < ``end`` of ``log`` are the block's own; those around them are of its neighbours."""

    log: Tlog
    first: int
    end: int
    is_last: bool
    share_read: float
    """Of the file, up to the end of this block."""


@dataclass(frozen=True)
class _Place:
    """A block in the file: bytes ``begin`` to ``end``; its last frames, from ``tail`` on, are the next one's margin."""

    begin: int
    tail: int
    end: int


class TlogFile:
    """A walked file; raises LogError where it cannot be read, is empty, or holds no MAVLink frame."""

    def __init__(self, path: Path, block_bytes: int | None = None) -> None:
        block_bytes = BLOCK_BYTES if block_bytes is None else block_bytes
        self.path = path
        self.census = Census()
        self._places: list[_Place] = []
        self._only: Tlog | None = None
        """The whole file, where it is one block."""
        self._margin = min(MARGIN_BYTES, block_bytes // 2)
        self.report = self._walked(block_bytes)

    def __len__(self) -> int:
        return self.report.frames

    def _walked(self, block_bytes: int) -> Report:
        counts, frames, repaired, steps, begin = Counts(), 0, 0, 0, 0
        with open_file(self.path) as file:
            size = file.seek(0, 2)
            while begin < size:
                file.seek(begin)
                data = file.read(min(block_bytes, size - begin))
                whole = begin + len(data) >= size
                starts, rest = walk(data, counts, STAMP, whole=whole)
                end = begin + rest
                if starts:
                    log = tlog_of(self.path, data, starts, Report(size, 0))
                    self.census.add(log)
                    frames += len(log)
                    repaired += log.report.stamps_repaired
                    steps += log.report.clock_steps
                    at = np.frombuffer(starts, np.int64)
                    tail = int(at[np.searchsorted(at, rest - self._margin).clip(max=len(at) - 1)])
                    self._places.append(_Place(begin, begin + tail, end))
                    self._only = log if begin == 0 and whole else None
                begin = size if whole else max(end, begin + 1)
        if not self._places:
            raise no_frame(self.path)
        report = replace(
            Report.of(counts, size, size - end), frames=frames, stamps_repaired=repaired, clock_steps=steps
        )
        if self._only is not None:
            self._only = replace(self._only, report=report)
        return report

    def blocks(self) -> Iterator[Block]:
        """The blocks in file order."""
        if self._only is not None:
            yield Block(self._only, 0, len(self._only), True, 1.0)
            return
        with open_file(self.path) as file:
            for k, place in enumerate(self._places):
                last = k + 1 == len(self._places)
                begin = self._places[k - 1].tail if k else place.begin
                file.seek(begin)
                data = file.read((self.report.bytes if last else place.end + self._margin) - begin)
                starts, _ = walk(data, Counts(), STAMP, whole=last)
                at = np.frombuffer(starts, np.int64) + begin
                first, end = np.searchsorted(at, (place.begin, place.end)).tolist()
                log = replace(tlog_of(self.path, data, starts, self.report), report=self.report)
                yield Block(log, first, end, last, place.end / self.report.bytes)

    def frames(self, since: int = 0) -> Iterator[tuple[int, bytes]]:
        """(arrival stamp [us], frame) in file order; ``since``: how many are passed over."""
        before = 0
        for block in self.blocks():
            own = block.log.part(block.first, block.end)
            yield from own.part(max(since - before, 0), len(own)).frames()
            before += len(own)
