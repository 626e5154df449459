"""The tables of a log one after another, as often as asked for: a short log is kept, a long one read again."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

from replay.export.columns import Table, table
from replay.logs.formats import read_pieces
from replay.logs.pieces import Piece
from replay.logs.progress import with_progress

_KEPT = 1
"""Pieces that are kept in memory."""


class Tables:
    """Iterate as often as wanted. Raises LogError where the log cannot be read."""

    def __init__(
        self, path: Path, target_system: int | None = None, rate_hz: float | None = None, *, quiet: bool = True
    ) -> None:
        self._path, self._target, self._rate, self._quiet = path, target_system, rate_hz, quiet
        self._times = 0
        head = list(itertools.islice(read_pieces(path, target_system), _KEPT + 1))
        self._all = list(map(self._table, head)) if len(head) <= _KEPT else None
        self.system = head[0].log.system
        self.boots = len({piece.log.boot for piece in head})
        """Those met so far."""

    def _table(self, piece: Piece) -> Table:
        return table(piece, self._rate)

    def __iter__(self) -> Iterator[Table]:
        if self._all is not None:
            yield from self._all
            return
        self._times += 1
        what = f"reading, time {self._times} of 2"  # names of the columns, then rows (files.py)
        for piece in with_progress(self._path, read_pieces(self._path, self._target), what, quiet=self._quiet):
            self.boots = max(self.boots, piece.log.boot + 1)
            yield self._table(piece)
