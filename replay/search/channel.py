"""One axis of one flight: its residual and the columns that act on it, which may grow; and the same whitened."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from models.effects import Context
from models.frames import Array
from replay.residual.grid import Mask
from replay.search.noise_spectra import Spectrum

Columns = NDArray[np.int64]


def hundredths(context: Context) -> Array:
    """One hundredth of the weight, times the lever for moments [N, N m] (6,): the unit of a channel."""
    return 0.01 * context.weight * np.where(np.arange(6) < 3, 1.0, context.lever)


@dataclass(frozen=True)
class Mixture:
    """Rows of a channel that are sums of others: ``mixing`` (k, m) times the rows ``of`` (k,)."""

    of: Columns
    mixing: Array


class ResidualChannel:
    """One axis of one flight: ``rows`` (1 + k, n), the residual and then the columns, all 0 where not valid.

    ``run`` (n,): valid samples directly before, -1 where not valid. ``limit``: one hundredth of the weight (times the
    lever, for moments) [N or N m]. ``where`` (K,): row of a column of the library, or -1.
    """

    def __init__(self, flight: int, axis: int, y: Array, run: NDArray[np.int64], limit: float) -> None:
        self.flight = flight
        self.axis = axis
        self.valid = run >= 0
        self.run = run
        self.limit = limit
        self.count = max(int(self.valid.sum()), 1)
        self.where = np.empty(0, np.int64)
        self.mixtures: dict[int, Mixture] = {}
        """By the first of their rows."""
        self._parts = [np.where(self.valid, y, 0.0)[None]]

    @property
    def rows(self) -> Array:
        """(1 + k, n)."""
        if len(self._parts) > 1:
            self._parts = [np.concatenate(self._parts)]
        return self._parts[0]

    def add(self, columns: Columns, x: Array) -> None:
        """Columns (n, m) of the library with these numbers."""
        self._append(columns, np.where(self.valid, x.T, 0.0))

    def mix(self, columns: Columns, of: Columns, mixing: Array) -> None:
        """Columns (m,) of the library that are sums of those in ``of`` (k,), by ``mixing`` (k, m)."""
        self.reach(int(of.max()) + 1)
        rows = self.where[of]
        acting = rows >= 0
        if not acting.any():
            return
        mixture = Mixture(rows[acting], mixing[acting])
        x = mixture.mixing.T @ self.rows[mixture.of]
        self.mixtures[len(self.rows)] = mixture
        self._append(columns, x)

    def _append(self, columns: Columns, rows: Array) -> None:
        first = sum(map(len, self._parts))
        self._parts.append(rows)
        self.reach(int(columns.max()) + 1)
        self.where[columns] = np.arange(first, first + len(columns))

    def reach(self, size: int) -> None:
        """Let ``where`` know of a library of ``size`` columns."""
        self.where = np.pad(self.where, (0, max(size - len(self.where), 0)), constant_values=-1)


class Whitened:
    """The rows of a channel as innovations of unit variance.

    Their inner products, X^T W X and X^T W y, are all that the likelihood needs to know of a flight.
    """

    def __init__(self, channel: ResidualChannel, spectrum: Spectrum) -> None:
        self.channel, self._spectrum = channel, spectrum
        self._rows = np.empty((0, len(channel.run)))
        self._gram = np.zeros((1, 1))

    @property
    def gram(self) -> Array:
        """Of all rows with each other (1 + k + 1, 1 + k + 1); the last, -1, is 0: a column that does not act here."""
        old = len(self._rows)
        count = len(self.channel.rows)
        if count > old:
            self._whiten(old)
            self._gram = np.pad(self._gram[:old, :old], (0, count + 1 - old))
            mixtures = self.channel.mixtures
            ends = (end for m, mixture in mixtures.items() for end in (m, m + mixture.mixing.shape[1]))
            for first, end in pairwise(sorted({old, count, *(e for e in ends if e > old)})):
                self._multiply(first, end, mixtures.get(first))
        return self._gram

    def _whiten(self, old: int) -> None:
        fresh = self._spectrum.whiten(self.channel.rows[old:].T, self.channel.run).T
        self._rows = np.concatenate([self._rows, fresh])

    def _multiply(self, first: int, end: int, mixture: Mixture | None) -> None:
        """Inner products of some rows with those before and each other; of sums of rows they are sums, too."""
        gram = self._gram
        if mixture is None:
            gram[first:end, :end] = self._rows[first:end] @ self._rows[:end].T
        else:
            gram[first:end, :first] = mixture.mixing.T @ gram[mixture.of, :first]
            gram[first:end, first:end] = gram[first:end, mixture.of] @ mixture.mixing
        gram[:first, first:end] = gram[first:end, :first].T

    def gram_of(self, rows: Columns, kept: Mask) -> Array:
        """The same of some rows with each other, over some samples."""
        x = np.where((rows >= 0)[:, None], self._rows[rows], 0.0)[:, kept]
        return np.asarray(x @ x.T)
