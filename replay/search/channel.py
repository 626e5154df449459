"""One axis of one flight: its residual and the columns that act on it, which may grow; and the same whitened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array
from models.effects import Context
from replay.residual.grid import Mask
from replay.search.noise_spectra import Spectrum

Columns = NDArray[np.int64]
MANY = 400
"""Columns from which on it is faster to copy whole rows than one product after the other."""


def hundredths(context: Context) -> Array:
    """One hundredth of the weight, times the lever for moments [N, N m] (6,): the unit of a channel."""
    return 0.01 * context.weight * np.where(np.arange(6) < 3, 1.0, context.lever)


class Rows:
    """Rows (count, n) that grow, with room ahead: to copy all of them for a few more would take longest."""

    def __init__(self, first: Array) -> None:
        self._room = first
        self.count = len(first)

    @property
    def values(self) -> Array:
        """(count, n)."""
        return self._room[: self.count]

    def append(self, rows: Array) -> None:
        """Add rows (m, n) at the end."""
        end = self.count + len(rows)
        if end > len(self._room):
            room = np.empty((2 * end, rows.shape[1]))
            room[: self.count] = self.values
            self._room = room
        self._room[self.count : end] = rows
        self.count = end


@dataclass(frozen=True)
class Mixture:
    """Rows of a channel that are sums of others: ``mixing`` (k, m) times the rows ``of`` (k,)."""

    first: int
    of: Columns
    mixing: Array

    def holds(self, rows: Columns) -> Mask:
        """Which of some rows are of this mixture."""
        last = self.first + self.mixing.shape[1]
        return np.asarray((rows >= self.first) & (rows < last))


class ResidualChannel:
    """One axis of one flight: ``rows`` (1 + k, n), the residual and then the columns, all 0 where not valid.

    ``run`` (n,): valid samples directly before, -1 where not valid. ``limit``: one hundredth of the weight (times the
    lever, for moments) [N or N m]. ``where`` (K,): row of a column of the library, or -1.
    """

    def __init__(
        self, flight: int, axis: int, y: Array, run: NDArray[np.int64], limit: float
    ) -> None:
        self.flight = flight
        self.axis = axis
        self.valid = run >= 0
        self.run = run
        self.limit = limit
        self.count = max(int(self.valid.sum()), 1)
        self.where = np.empty(0, np.int64)
        self.mixtures: list[Mixture] = []
        self._rows = Rows(np.where(self.valid, y, 0.0)[None])

    @property
    def rows(self) -> Array:
        """(1 + k, n)."""
        return self._rows.values

    @property
    def count_of_rows(self) -> int:
        """1 + k."""
        return self._rows.count

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
        mixture = Mixture(len(self.rows), rows[acting], mixing[acting])
        self._append(columns, mixture.mixing.T @ self.rows[mixture.of])
        self.mixtures.append(mixture)

    def forget(self, columns: Columns) -> None:
        """Take the columns out that were added last."""
        rows = self.where[columns]
        if (rows >= 0).any():
            self._rows.count = int(rows[rows >= 0].min())
            self.mixtures = [m for m in self.mixtures if m.first < self._rows.count]
        self.where[columns] = -1

    def _append(self, columns: Columns, rows: Array) -> None:
        first = len(self.rows)
        self._rows.append(rows)
        self.reach(int(columns.max()) + 1)
        self.where[columns] = np.arange(first, first + len(columns))

    def reach(self, size: int) -> None:
        """Let ``where`` know of a library of ``size`` columns."""
        self.where = np.pad(self.where, (0, max(size - len(self.where), 0)), constant_values=-1)


class Whitened:
    """The rows of a channel as innovations of unit variance.

    Their inner products, X^T W X and X^T W y, are all that the likelihood needs to know of a flight. Most pairs of
    columns never meet in a set: a product is formed when it is first asked for. Row -1 is a column that does not act
    here, all its products are 0.
    """

    def __init__(self, channel: ResidualChannel, spectrum: Spectrum) -> None:
        self.channel = channel
        self._spectrum = spectrum
        self._rows = Rows(np.empty((0, len(channel.run))))
        self._gram = np.zeros((0, 0))
        """NaN: not formed yet."""

    def between(self, rows: Columns, others: Columns) -> Array:
        """Inner products (r, s) of rows with others."""
        self._keep_up()
        # First a term that is new to all others, then pairs that have not met.
        for share in (0.5, 0.0):
            products = self._known(rows, others)
            unknown = np.isnan(products)
            if not unknown.any():
                return products
            fresh = unknown.mean(axis=1) > share
            if fresh.any():
                self._form(rows[fresh], others[unknown[fresh].any(axis=0)])
        return self._known(rows, others)

    def _known(self, rows: Columns, others: Columns) -> Array:
        """Inner products (r, s) as far as they are formed; of many others, whole rows at a time."""
        if len(others) > MANY:
            return self._gram[rows].take(others, axis=1)
        return self._gram[rows[:, None], others]

    def within(self, blocks: Columns) -> Array:
        """Inner products (b, k, k) of the rows of every block (b, k) with each other."""
        self._keep_up()
        pairs = blocks[:, :, None], blocks[:, None, :]
        products = self._gram[pairs]
        unknown = np.isnan(products)
        if not unknown.any():
            return products
        for block in blocks[unknown.any(axis=(1, 2))]:
            acting = block[block >= 0]
            self._form(acting, acting)
        return self._gram[pairs]

    def gram_of(self, rows: Columns, kept: Mask) -> Array:
        """The same of some rows with each other, over some samples."""
        self._keep_up()
        x = np.where((rows >= 0)[:, None], self._rows.values[rows], 0.0)[:, kept]
        return np.asarray(x @ x.T)

    def forget(self) -> None:
        """Take out what the channel has forgotten."""
        old = self._rows.count
        count = min(self.channel.count_of_rows, old)
        self._rows.count = count
        self._gram[count:old, :old] = np.nan
        self._gram[:count, count:old] = np.nan

    def _keep_up(self) -> None:
        """Take in rows that the channel has got."""
        old = self._rows.count
        count = self.channel.count_of_rows
        if count == old:
            return
        self._rows.append(self._spectrum.whiten(self.channel.rows[old:].T, self.channel.run).T)
        if count < len(self._gram):
            return
        # Room for a quarter more only: most of the memory of a search lies here.
        size = count + count // 4 + 1
        gram = np.full((size, size), np.nan)
        gram[:old, :old] = self._gram[:old, :old]
        gram[-1] = 0.0
        gram[:, -1] = 0.0
        self._gram = gram

    def _form(self, rows: Columns, others: Columns) -> None:
        product = self._product(rows, others)
        self._gram[rows[:, None], others] = product
        self._gram[others[:, None], rows] = product.T

    def _product(self, rows: Columns, others: Columns) -> Array:
        """Inner products; those of sums of rows are sums, too."""
        for mixture in self.channel.mixtures:
            inside = mixture.holds(rows)
            if inside.any():
                out = np.empty((len(rows), len(others)))
                mixing = mixture.mixing[:, rows[inside] - mixture.first]
                out[inside] = mixing.T @ self.between(mixture.of, others)
                out[~inside] = self._product(rows[~inside], others)
                return out
            if mixture.holds(others).any():
                return self._product(others, rows).T
        x = self._rows.values
        return np.asarray(x[rows] @ x[others].T)
