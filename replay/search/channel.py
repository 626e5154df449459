"""One axis of one flight: its residual and the columns that act on it, which may grow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.frames import Array

Columns = NDArray[np.int64]


class Rows:
    """Rows (k, n) in one piece of memory, to which more may be added."""

    def __init__(self, n: int) -> None:
        self._memory = np.empty((16, n))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def array(self) -> Array:
        """(k, n)."""
        return self._memory[: self._count]

    def add(self, rows: Array) -> None:
        """More rows (m, n). Memory doubles, so that a row is moved about once, however many come."""
        count = self._count + len(rows)
        if count > len(self._memory):
            grown = np.empty((max(count, 2 * len(self._memory)), self._memory.shape[1]))
            grown[: self._count] = self.array
            self._memory = grown
        self._memory[self._count : count] = rows
        self._count = count


class Channel:
    """One axis of one flight: residual ``y`` (n,) and columns ``x`` (n, k), both 0 where not valid.

    ``run`` (n,): valid samples directly before, -1 where not valid. ``limit``: one hundredth of the weight (times the
    lever, for moments) [N or N m]. ``where`` (K,): place of a column of the library in ``x``, or -1.
    """

    def __init__(self, flight: int, axis: int, y: Array, run: NDArray[np.int64], limit: float) -> None:
        self.flight = flight
        self.axis = axis
        self.valid = run >= 0
        self.y = np.where(self.valid, y, 0.0)
        self.run = run
        self.limit = limit
        self.count = int(self.valid.sum())
        self.where = np.empty(0, np.int64)
        self._rows = Rows(len(y))

    @property
    def x(self) -> Array:
        """(n, k), every column in one piece of memory."""
        return self._rows.array.T

    def add(self, columns: Columns, x: Array) -> None:
        """Columns (n, m) of the library with these numbers."""
        first = len(self._rows)
        self._rows.add(np.where(self.valid, x.T, 0.0))
        self.reach(int(columns.max()) + 1)
        self.where[columns] = np.arange(first, first + len(columns))

    def reach(self, size: int) -> None:
        """Let ``where`` know of a library of ``size`` columns."""
        if size > len(self.where):
            self.where = np.concatenate([self.where, np.full(size - len(self.where), -1)])


@dataclass(frozen=True)
class Flight:
    """The channels of one flight, which have the same samples."""

    numbers: slice
    """Of the channels, among those of all flights."""
    channels: Sequence[Channel]
    y: Array
    """(channels, n)."""
    limits: Array
    """(channels,)."""
    run: NDArray[np.int64]
    count: int


def by_flight(channels: Sequence[Channel]) -> list[Flight]:
    """Channels in the order of the flights, flight by flight."""
    out, first = [], 0
    for flight in dict.fromkeys(c.flight for c in channels):
        own = [c for c in channels if c.flight == flight]
        y = np.stack([c.y for c in own])
        limits = np.array([c.limit for c in own])
        out.append(Flight(slice(first, first + len(own)), own, y, limits, own[0].run, max(own[0].count, 1)))
        first += len(own)
    return out
