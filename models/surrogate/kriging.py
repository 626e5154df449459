"""Kriging, the paper's other rival: Gaussian processes that scikit-learn fits and numpy evaluates."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array

# Fitting costs rows^3: length scales are fitted on the first number of rows, predictions rest on the second.
ROWS_FOR_LENGTHS = 200
ROWS = 800
# Points at a time: their covariances with all rows take 13 MB.
CHUNK = 2048
# Rows whose gate is nearly closed say nothing about the process behind it.
LEAST_GATE = 0.02
# Accuracy of the data that a nugget stands for, as a share of the increments' RMS.
DATA_ACCURACY = 1e-2


@dataclass(frozen=True, kw_only=True)
class Process:
    """One zero-mean process with covariance k(x, x') = exp(-sum((x - x')^2 / (2 l^2))), shared by some components.

    ``columns`` (6,) 1 for a component it serves, ``rows`` (n, 3) conditioning inputs, ``lengths`` (3,),
    ``weights`` (n, 6) = K^-1 y (0 in other columns), ``deviation`` (6,) the prior's standard deviation, ``root`` (n, n)
    the inverse of K's Cholesky factor, which gives the spread.
    """

    columns: Array
    rows: Array
    lengths: Array
    weights: Array
    deviation: Array
    root: Array

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and standard deviation (m, 6) at x (m, 3), zero in columns of other processes."""
        k = _correlation(x, self.rows, self.lengths)
        known = ((k @ self.root.T) ** 2).sum(axis=1)
        left = np.sqrt(np.clip(1.0 - known, 0.0, 1.0))
        return k @ self.weights, left[:, None] * self.deviation


@dataclass(frozen=True)
class KrigingRegressor:
    """The processes of all six components: one for each gate, as components behind one gate share their rows."""

    processes: tuple[Process, ...]

    kind = "kriging"

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and standard deviation, each (n, 6), at inputs (n, 3)."""
        mean = np.zeros((len(x), 6))
        spread = np.zeros((len(x), 6))
        for start in range(0, len(x), CHUNK):
            part = slice(start, start + CHUNK)
            for process in self.processes:
                own_mean, own_spread = process.predict(x[part])
                mean[part] += own_mean
                spread[part] += own_spread
        return mean, spread

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds."""
        out = {}
        for i, process in enumerate(self.processes):
            for name, value in vars(process).items():
                out[f"{name}_{i}"] = value
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> KrigingRegressor:
        """Inverse of ``arrays``."""
        count = sum(name.startswith("rows_") for name in arrays)
        processes = []
        for i in range(count):
            own = {name: arrays[f"{name}_{i}"] for name in Process.__dataclass_fields__}
            processes.append(Process(**own))
        return cls(tuple(processes))


def fit(
    x: Array, y: Array, gate: Array, locations: NDArray[np.intp], seed: int
) -> KrigingRegressor:
    """Fit on increments y (n, 6) = gate (n, 6) x process(x); inputs x (n, 3) in [-1, 1], ``locations`` (n,) places.

    Length scales and nugget by maximum likelihood (scikit-learn) on one row each of part of the places, jointly for the
    components behind one gate. All rows of a place share one nugget: rotor speeds repeat its error, they do not average
    it out. On top each row carries the data's accuracy over its gate.
    """
    rng = np.random.default_rng(seed)
    scale = np.sqrt(np.mean(y**2, axis=0))
    _, groups = np.unique(gate, axis=1, return_inverse=True)
    processes = []
    for group in np.unique(groups):
        columns = (groups.ravel() == group) & (scale > 1e-9)
        if columns.any():
            processes.append(_fit_process(x, y, gate, locations, columns, rng))
    return KrigingRegressor(tuple(processes))


def _fit_process(
    x: Array,
    y: Array,
    gate: Array,
    locations: NDArray[np.intp],
    columns: Array,
    rng: np.random.Generator,
) -> Process:
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    opening = gate[:, int(np.argmax(columns))]
    open_rows = np.flatnonzero(opening > LEAST_GATE)
    chosen = rng.permutation(open_rows)[:ROWS]
    place = locations[chosen]
    rows = x[chosen]
    target = y[chosen][:, columns] / opening[chosen, None]
    weight = opening[chosen] ** 2
    deviation = np.sqrt(weight @ target**2 / weight.sum())
    target = target / deviation
    noise = DATA_ACCURACY**2 / weight
    smooth = RBF(np.array([0.5, 0.5, 2.0]), (0.1, 20.0))
    kernel = ConstantKernel(1.0, (0.1, 1e4)) * smooth + WhiteKernel(1e-4, (1e-9, 1.0))
    _, first = np.unique(place, return_index=True)
    few = np.sort(first)[:ROWS_FOR_LENGTHS]
    with warnings.catch_warnings():
        # A length scale at its bound says that an input does not matter, or that the data are too few to tell.
        warnings.simplefilter("ignore", ConvergenceWarning)
        regressor = GaussianProcessRegressor(kernel, alpha=noise[few])
        fitted = regressor.fit(rows[few], target[few]).kernel_
    lengths = np.asarray(fitted.k1.k2.length_scale, dtype=float)
    variance = float(fitted.k1.k1.constant_value)
    nugget = float(fitted.k2.noise_level)
    same_place = place[:, None] == place
    covariance = _correlation(rows, rows, lengths)
    covariance += nugget / variance * same_place
    covariance[np.diag_indices_from(covariance)] += noise / variance
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    weights = np.zeros((len(chosen), 6))
    prior = np.zeros(6)
    weights[:, columns] = np.linalg.solve(covariance, target) * deviation
    prior[columns] = deviation * np.sqrt(variance)
    return Process(
        columns=columns.astype(float),
        rows=rows,
        lengths=lengths,
        weights=weights,
        deviation=prior,
        root=root,
    )


def _correlation(a: Array, b: Array, lengths: Array) -> Array:
    """exp(-|a - b|^2 / 2) over scaled inputs (m, 3) and (n, 3), shape (m, n)."""
    a = a / lengths
    b = b / lengths
    size_a = np.sum(a * a, axis=1)
    size_b = np.sum(b * b, axis=1)
    squared = size_a[:, None] + size_b - 2.0 * a @ b.T
    return np.asarray(np.exp(-0.5 * np.maximum(squared, 0.0)))
