"""One channel through the whitening filter of one spectrum, and inner products of its columns, each computed once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.frames import Array
from replay.residual.grid import Mask
from replay.search.channel import Channel, Columns, Growing
from replay.search.disturbance import Spectrum

MOST_AT_ONCE = 120
"""A set with more columns than this is hardly weighed twice: its products are not kept."""


class Whitened:
    """Residual ``y`` (n,) and columns ``x`` (n, k) of a channel as innovations of unit variance.

    X^T W X and X^T W y are all that the likelihood needs to know of a flight.
    """

    def __init__(self, channel: Channel, spectrum: Spectrum) -> None:
        self._channel, self._spectrum = channel, spectrum
        self.y = spectrum.whiten(channel.y, channel.run)
        self._white = Growing(len(self.y))
        self._used = Growing(len(self.y))
        self._slot = np.empty(0, np.int64)
        self._gram = np.zeros((0, 0))
        self._products: dict[bytes, Array] = {}
        self._blocks: dict[int, Array] = {}

    @property
    def x(self) -> Array:
        """(n, k)."""
        known, x = self._white.count, self._channel.x
        if known < x.shape[1]:
            self._white.add(self._spectrum.whiten(x[:, known:], self._channel.run))
        return self._white.x

    def gram(self, columns: Columns, kept: Mask | None = None) -> tuple[Array, Array]:
        """X^T W X (k, k) and X^T W y (k,) of columns that act on this channel, over all samples or those kept."""
        local = self._channel.where[columns]
        if kept is not None or len(local) > MOST_AT_ONCE:
            rows = slice(None) if kept is None else kept
            x = self.x.T[local][:, rows]
            return x @ x.T, x @ self.y[rows]
        self._slot = np.pad(self._slot, (0, self.x.shape[1] - len(self._slot)), constant_values=-1)
        new = local[self._slot[local] < 0]
        if new.size:
            self._use(new)
        at = self._slot[local]
        return self._gram[at[:, None], at], self.products(None)[columns]

    def _use(self, new: Columns) -> None:
        """Extend the Gram matrix by columns of the channel."""
        first, end = self._used.count, self._used.count + len(new)
        if end > len(self._gram):
            room = np.empty((2 * end, 2 * end))
            room[:first, :first] = self._gram[:first, :first]
            self._gram = room
        self._slot[new] = np.arange(first, end)
        x = self.x.T[new]
        self._used.add(x.T)
        across = x @ self._used.x
        self._gram[first:end, :end] = across
        self._gram[:first, first:end] = across[:, :first].T

    def products(self, columns: Columns | None) -> Array:
        """X^T W X (k, K) of some columns of the library with all of them; without any, X^T W y (K,)."""
        key = b"" if columns is None else columns.tobytes()
        known = self._products.get(key)
        where = self._channel.where
        if known is None or known.shape[-1] < len(where):
            v = self.y if columns is None else self._of_library(columns)
            local = where if known is None else where[known.shape[-1] :]
            on = local >= 0
            first = int(local[on].min(initial=self.x.shape[1]))
            more = np.zeros((*v.shape[:-1], len(local)))
            more[..., on] = (v @ self.x[:, first:])[..., local[on] - first]
            known = more if known is None else np.concatenate([known, more], axis=-1)
            self._products[key] = known
        return known

    def blocks(self, of_term: NDArray[np.int64]) -> Array:
        """X^T W X (m, width, width) of every term with itself, by the terms' columns (m, width)."""
        width = of_term.shape[1]
        known = self._blocks.get(width, np.zeros((0, width, width)))
        if len(known) < len(of_term):
            rows = self._of_library(of_term[len(known) :])
            known = np.concatenate([known, rows @ rows.transpose(0, 2, 1)])
            self._blocks[width] = known
        return known

    def _of_library(self, columns: NDArray[np.int64]) -> Array:
        """Columns of the library (..., n), 0 where they do not act on this channel."""
        local = self._channel.where[columns]
        return np.where((local >= 0)[..., None], self.x.T[local], 0.0)
