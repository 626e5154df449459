"""One channel through the whitening filter of one spectrum, and inner products of its columns."""

from __future__ import annotations

import numpy as np

from models.frames import Array
from replay.residual.grid import Mask
from replay.search.channel import Channel, Columns
from replay.search.disturbance import Spectrum


class Whitened:
    """The rows of a channel as innovations of unit variance.

    Their inner products, X^T W X and X^T W y, are all that the likelihood needs to know of a flight.
    """

    def __init__(self, channel: Channel, spectrum: Spectrum) -> None:
        self.channel, self._spectrum = channel, spectrum
        self._rows = np.empty((0, len(channel.run)))
        self._gram = np.zeros((1, 1))

    @property
    def gram(self) -> Array:
        """Of all rows with each other (1 + k + 1, 1 + k + 1); the last, -1, is 0: a column that does not act here."""
        old, count = len(self._rows), len(self.channel.rows)
        if count > old:
            fresh = self._spectrum.whiten(self.channel.rows[old:].T, self.channel.run).T
            self._rows = np.concatenate([self._rows, fresh])
            self._gram = np.pad(self._gram[:old, :old], (0, count + 1 - old))
            self._gram[old:count, :count] = fresh @ self._rows.T
            self._gram[:old, old:count] = self._gram[old:count, :old].T
        return self._gram

    def gram_of(self, rows: Columns, kept: Mask) -> Array:
        """The same of some rows with each other, over some samples."""
        x = np.where((rows >= 0)[:, None], self._rows[rows], 0.0)[:, kept]
        return np.asarray(x @ x.T)
