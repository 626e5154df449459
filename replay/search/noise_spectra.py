"""Slow disturbance and sensor noise of one axis: a small grid of spectra, each with its whitening filter."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from models.common.frames import Array
from replay.residual.grid import Mask

ORDER = 4
"""Of the whitening filters: 0.8 s of samples, longer than the smoother reaches."""
SLOW_S = (0.3, 1.0, 3.0, 10.0)
"""Correlation times of the slow disturbance (Ornstein-Uhlenbeck) that are tried [s]."""
SLOW_SHARE = (0.4, 0.75, 0.95, 0.99)
"""Shares of the variance that the slow disturbance may have; the rest is sensor noise, white through the smoother."""
FITTED_SHARE = 0.75
"""Sizes are fitted beside no slower noise. Else only the fast part would count: there loops respond to disturbances."""
SMOOTHER_S = 0.066
"""Standard deviation of the 2 Hz Gaussian smoother that the residual went through [s]."""
NUGGET = 1e-3
"""White share of the variance, so that no combination of samples is free of noise."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Unit-variance noise by its whitening filters.

    ``filters`` (ORDER + 1, ORDER + 1): row k holds (1, -a_1, ..., -a_k, 0, ...) / sqrt(v_k), the weights of a sample
    and of those before it. a_1 ... a_k is the best linear predictor from the k samples before, v_k its variance.
    """

    slow_s: float
    slow_share: float
    filters: Array

    def whiten(self, x: Array, run: NDArray[np.int64]) -> Array:
        """Innovations of unit variance of (n, ...), exact at the start of every run; 0 outside runs (``run`` < 0)."""
        order = np.minimum(run, ORDER)
        valid = run[:, None] >= 0
        weights = np.where(valid, self.filters[order], 0.0)
        out = np.zeros_like(x)
        for lag in range(ORDER + 1):
            shape = (-1, *[1] * (x.ndim - 1))
            weight = weights[lag:, lag].reshape(shape)
            out[lag:] += weight * x[: len(x) - lag]
        return out

    def log_determinant(self, run: NDArray[np.int64]) -> float:
        """Of the covariance of the valid samples, unit variance."""
        order = np.minimum(run[run >= 0], ORDER)
        return float(-2.0 * np.log(self.filters[order, 0]).sum())


def whitened_energies(filters: Array, x: Array, run: NDArray[np.int64]) -> Array:
    """Sum of squares of the innovations of signals (axes, n) by the ``filters`` of every spectrum, (axes, spectra).

    f^T L f for the filter f of the highest order: L are the inner products of a signal with itself at lags 0 to
    ``ORDER``, over the samples that the filter is used for. The few at the start of a run are added one by one.
    """
    axes, samples = x.shape
    lags = np.zeros((axes, ORDER + 1, samples))
    for lag in range(ORDER + 1):
        lags[:, lag, lag:] = x[:, : samples - lag]
    f = filters[:, ORDER]
    in_run = run >= ORDER
    products = (lags * in_run) @ lags.transpose(0, 2, 1)
    energies = ((f @ products) * f).sum(axis=2)
    starts = np.flatnonzero((run >= 0) & (run < ORDER))
    innovations = np.einsum("stl,alt->ast", filters[:, run[starts]], lags[:, :, starts])
    return np.asarray(energies + (innovations**2).sum(axis=2))


def spectra(step_s: float) -> tuple[Spectrum, ...]:
    """The grid for samples ``step_s`` apart."""
    grid = product(SLOW_S, SLOW_SHARE)
    return tuple(_spectrum(step_s, slow_s, share) for slow_s, share in grid)


def valid_before(valid: Mask) -> NDArray[np.int64]:
    """How many valid samples went directly before (n,); -1 where a sample is not valid."""
    index = np.arange(len(valid))
    broken = np.maximum.accumulate(np.where(valid, -1, index))
    return np.where(valid, index - broken - 1, -1)


def _spectrum(step_s: float, slow_s: float, share: float) -> Spectrum:
    """Best linear predictors of every order from the autocovariance r, R a = r with R Toeplitz.

    r(u) = s exp(-u / tau) + (1 - s) exp(-u^2 / (4 SMOOTHER_S^2)), and NUGGET more at u = 0; tau is ``slow_s``, s
    ``share``. The Yule-Walker equations: Brockwell & Davis 1991, Time Series: Theory and Methods, §5.1.
    """
    lag = step_s * np.arange(ORDER + 1)
    slow = np.exp(-lag / slow_s)
    fast = np.exp(-(lag**2) / (4.0 * SMOOTHER_S**2))
    r = share * slow + (1.0 - share) * fast
    r = r / r[0]
    r[0] += NUGGET
    filters = np.zeros((ORDER + 1, ORDER + 1))
    filters[0, 0] = 1.0 / np.sqrt(r[0])
    for k in range(1, ORDER + 1):
        at_lags = r[1 : k + 1]
        a = solve_toeplitz(r[:k], at_lags)
        v = r[0] - a @ at_lags
        filters[k, : k + 1] = np.concatenate([[1.0], -a]) / np.sqrt(v)
    return Spectrum(slow_s, share, filters)
