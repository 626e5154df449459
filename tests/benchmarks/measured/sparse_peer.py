"""A sparse regression of the residual, by PySINDy: few terms of a polynomial library of the features.

Sequentially thresholded least squares (Brunton, Proctor & Kutz 2016, PNAS 113, 3932; PySINDy's ``STLSQ``) on
PySINDy's ``PolynomialLibrary``. Threshold and ridge penalty of every axis are those that predict held-out blocks of the
flight best. ``pip install pysindy``; without it, the benchmark leaves this peer out and says so.
"""

from __future__ import annotations

import warnings
from itertools import product

import numpy as np
from sklearn.preprocessing import StandardScaler

from models.common.frames import Array

try:
    import pysindy
except ImportError:
    pysindy = None

BLOCKS = 5
"""Parts of the flight, one after the other; each is predicted from the others."""
DEGREE = 2
THRESHOLDS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5)
"""Terms with less are left out: standard deviations of the residual per standard deviation of the term."""
RIDGES = (0.01, 0.1, 1.0)
"""Penalties, as shares of the number of samples."""
MISSING = "pysindy is not installed: the sparse regression is left out (pip install pysindy)"


class SparseRegression:
    """``fit`` and ``predict`` as in scikit-learn; ``chosen``: (threshold, ridge penalty) of every axis."""

    def fit(self, x: Array, y: Array) -> SparseRegression:
        """(n, k) features in the order of time, (n, m) residual."""
        self.features = StandardScaler().fit(x)
        self.residual = StandardScaler().fit(y)
        self.library = pysindy.PolynomialLibrary(degree=DEGREE, include_bias=False)
        terms = np.asarray(self.library.fit_transform(self.features.transform(x)))
        self.terms = StandardScaler().fit(terms)
        columns = self.terms.transform(terms)
        targets = self.residual.transform(y)
        self.chosen = [_choose(columns, axis) for axis in targets.T]
        self.weights = np.stack(
            [_fit(columns, axis, c) for axis, c in zip(targets.T, self.chosen, strict=True)]
        )
        return self

    def predict(self, x: Array) -> Array:
        """(n, m)."""
        columns = self.terms.transform(
            np.asarray(self.library.transform(self.features.transform(x)))
        )
        return np.asarray(self.residual.inverse_transform(columns @ self.weights.T))

    def named(self, names: list[str]) -> list[list[tuple[str, float]]]:
        """Of every axis, the terms that are left with their weights, the largest first."""
        terms = self.library.get_feature_names(names)
        return [
            [(terms[i], float(row[i])) for i in np.argsort(-np.abs(row)) if row[i] != 0.0]
            for row in self.weights
        ]


def _choose(columns: Array, y: Array) -> tuple[float, float]:
    """Threshold and penalty with the least squared error on the blocks."""
    block = np.arange(len(y)) * BLOCKS // len(y)

    def error(choice: tuple[float, float]) -> float:
        held = (block == k for k in range(BLOCKS))
        return float(
            sum(((y[h] - columns[h] @ _fit(columns[~h], y[~h], choice)) ** 2).sum() for h in held)
        )

    return min(product(THRESHOLDS, RIDGES), key=error)


def _fit(columns: Array, y: Array, choice: tuple[float, float]) -> Array:
    threshold, ridge = choice
    optimizer = pysindy.STLSQ(threshold=threshold, alpha=ridge * len(y), unbias=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(optimizer.fit(columns, y).coef_).reshape(-1)
