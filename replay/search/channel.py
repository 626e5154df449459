"""One axis of one flight: its residual and the columns that act on it, which may grow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.frames import Array

Columns = NDArray[np.int64]


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
        self._rows = [np.empty((0, len(y)))]

    @property
    def x(self) -> Array:
        """(n, k), every column in one piece of memory."""
        if len(self._rows) > 1:
            self._rows = [np.concatenate(self._rows)]
        return self._rows[0].T

    def add(self, columns: Columns, x: Array) -> None:
        """Columns (n, m) of the library with these numbers."""
        first = sum(map(len, self._rows))
        self._rows.append(np.where(self.valid, x.T, 0.0))
        self.reach(int(columns.max()) + 1)
        self.where[columns] = np.arange(first, first + len(columns))

    def reach(self, size: int) -> None:
        """Let ``where`` know of a library of ``size`` columns."""
        if size > len(self.where):
            self.where = np.concatenate([self.where, np.full(size - len(self.where), -1)])
