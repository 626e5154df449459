"""One channel through the whitening filter of one spectrum, and inner products of its columns, each computed once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.frames import Array
from replay.residual.grid import Mask
from replay.search.channel import Channel, Columns, Rows
from replay.search.disturbance import Spectrum


class Whitened:
    """Residual ``y`` (n,) and columns ``x`` (n, k) of a channel as innovations of unit variance.

    X^T W X and X^T W y are all that the likelihood needs to know of a flight.
    """

    def __init__(self, channel: Channel, spectrum: Spectrum) -> None:
        self._channel, self._spectrum = channel, spectrum
        self.y = spectrum.whiten(channel.y, channel.run)
        self._rows = Rows(len(self.y))
        self._grams: dict[bytes, tuple[Array, Array]] = {}
        self._products: dict[bytes, Array] = {}
        self._blocks: dict[int, Array] = {}

    @property
    def x(self) -> Array:
        """(n, k)."""
        fresh = self._channel.x[:, len(self._rows) :]
        if fresh.size:
            self._rows.add(self._spectrum.whiten(fresh, self._channel.run).T)
        return self._rows.array.T

    def gram(self, local: Columns) -> tuple[Array, Array]:
        """X^T W X (k, k) and X^T W y (k,) of columns of this channel, by their places in ``x``."""
        key = local.tobytes()
        if key not in self._grams:
            x = self.x.T[local]
            self._grams[key] = x @ x.T, x @ self.y
        return self._grams[key]

    def gram_of(self, local: Columns, kept: Mask) -> tuple[Array, Array]:
        """The same over some samples."""
        x = self.x.T[local][:, kept]
        return x @ x.T, x @ self.y[kept]

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
