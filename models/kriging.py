"""Kriging, the paper's other rival: a Gaussian process per component; scikit-learn fits it, numpy predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from models.wrench import Array

# The cost of fitting grows as rows^3: length scales are fitted on the first, predictions rest on the second number.
ROWS_FOR_LENGTHS = 300
ROWS = 1000
CHUNK = 2048


@dataclass(frozen=True)
class KrigingRegressor:
    """Zero-mean process per component with covariance v exp(-sum((x - x')^2 / (2 l^2))) and a nugget, heteroscedastic.

    ``rows`` (n, 3) conditioning inputs, ``lengths`` (6, 3), ``variance`` (6,), ``weights`` (6, n) = K^-1 y and
    ``inverse`` (6, n, n) = K^-1, which gives the spread.
    """

    rows: Array
    lengths: Array
    variance: Array
    weights: Array
    inverse: Array

    kind = "kriging"

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and standard deviation, each (n, 6), at inputs (n, 3)."""
        mean, spread = np.empty((len(x), 6)), np.empty((len(x), 6))
        for start in range(0, len(x), CHUNK):
            part = slice(start, start + CHUNK)
            for c in range(6):
                k = self.variance[c] * _correlation(x[part], self.rows, self.lengths[c])
                mean[part, c] = k @ self.weights[c]
                known = np.einsum("ij,ij->i", k @ self.inverse[c], k)
                spread[part, c] = np.sqrt(np.maximum(self.variance[c] - known, 0.0))
        return mean, spread

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds; the inverse in single precision, enough for a spread."""
        return {
            "rows": self.rows,
            "lengths": self.lengths,
            "variance": self.variance,
            "weights": self.weights,
            "inverse": self.inverse.astype(np.float32),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> KrigingRegressor:
        """Inverse of ``arrays``."""
        return cls(**{name: arrays[name] for name in ("rows", "lengths", "variance", "weights", "inverse")})


def _correlation(a: Array, b: Array, lengths: Array) -> Array:
    """exp(-|a - b|^2 / 2) over scaled inputs (m, 3) and (n, 3), shape (m, n)."""
    a, b = a / lengths, b / lengths
    squared = (a * a).sum(1)[:, None] + (b * b).sum(1)[None, :] - 2.0 * a @ b.T
    out: Array = np.exp(-0.5 * np.maximum(squared, 0.0))
    return out
