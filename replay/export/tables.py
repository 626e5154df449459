"""The tables of a log one after another, as often as asked for: a short log is kept, a long one read again."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

from replay.export.columns import Column, Table, recorded, table
from replay.export.decided import Decided
from replay.logs.formats import read_pieces
from replay.logs.pieces import Piece
from replay.logs.progress import with_progress

_KEPT = 1
"""Pieces that are kept in memory."""


class Tables:
    """Iterate as often as wanted. Raises LogError where the log cannot be read."""

    def __init__(
        self, path: Path, target_system: int | None = None, decided: Decided | None = None, *, quiet: bool = True
    ) -> None:
        self._path, self._target, self._quiet = path, target_system, quiet
        self._decided = decided
        head = list(itertools.islice(read_pieces(path, target_system), _KEPT + 1))
        self._all = head if len(head) <= _KEPT else None
        self.system = head[0].log.system
        self.boots = len({piece.log.boot for piece in head})
        """Those met so far."""

    def columns(self) -> list[Column]:
        """Every column, without samples, in the order of first appearance; decisions last.

        Nothing is decided on a log that holds no attitude: then they are left out.
        """
        seen: dict[str, Column] = {}
        for piece in self._pieces("names of the columns", quiet=self._quiet):
            for c in recorded(piece.log):
                seen.setdefault(c.name, c.blank())
        if self._decided is not None and "attitude_qw" in seen:
            seen |= {c.name: c.blank() for c in self._decided.columns()}
        return list(seen.values())

    def __iter__(self) -> Iterator[Table]:
        if self._decided is None:
            for piece in self._pieces("rows", quiet=self._quiet):
                yield table(piece)
            return
        # The replay shows how far it is.
        pieces = self._pieces("rows", quiet=True)
        for piece, columns in self._decided.beside(pieces, self._target, quiet=self._quiet):
            yield table(piece, columns)

    def _pieces(self, what: str, *, quiet: bool) -> Iterator[Piece]:
        if self._all is not None:
            yield from self._all
            return
        for piece in with_progress(self._path, read_pieces(self._path, self._target), what, quiet=quiet):
            self.boots = max(self.boots, piece.log.boot + 1)
            yield piece
