"""Slow disturbance and sensor noise of one axis: a small grid of spectra, each with its whitening filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from models.frames import Array
from replay.residual.grid import Mask

ORDER = 4
"""Of the whitening filters: 0.8 s of samples, longer than the smoother reaches."""
SLOW_S = (0.3, 1.0, 3.0, 10.0)
"""Correlation times of the slow disturbance (Ornstein-Uhlenbeck) that are tried [s]."""
SLOW_SHARE = (0.4, 0.75, 0.95, 0.99)
"""Shares of the variance that the slow disturbance may have; the rest is sensor noise, white through the smoother."""
FITTED_SHARE = 0.75
"""Sizes are fitted beside no slower noise: else only the fast part would count, in which loops answer disturbances."""
SMOOTHER_S = 0.066
"""Standard deviation of the 2 Hz Gaussian smoother that the residual went through [s]."""
NUGGET = 1e-3
"""White share of the variance, so that no combination of samples is free of noise."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Unit-variance noise: one predictor for every number of samples that went before, up to ``ORDER``."""

    slow_s: float
    slow_share: float
    predictors: tuple[Array, ...]
    innovations: Array

    def whiten(self, x: Array, run: NDArray[np.int64]) -> Array:
        """Innovations of unit variance of (n, ...), exact at the start of every run; 0 outside runs (``run`` < 0)."""
        tail = (1,) * (x.ndim - 1)
        out = np.zeros_like(x)
        full = run >= ORDER
        out[ORDER:] = x[ORDER:]
        for i, a in enumerate(self.predictors[ORDER]):
            out[ORDER:] -= a * x[ORDER - 1 - i : len(x) - 1 - i]
        out *= np.where(full, 1.0 / np.sqrt(self.innovations[ORDER]), 0.0).reshape(-1, *tail)
        for order in range(ORDER):
            rows = np.flatnonzero(run == order)
            value = x[rows].copy()
            for i, a in enumerate(self.predictors[order]):
                value -= a * x[rows - 1 - i]
            out[rows] = value / np.sqrt(self.innovations[order])
        return out

    def log_determinant(self, run: NDArray[np.int64]) -> float:
        """Of the covariance of the valid samples, unit variance."""
        order = np.minimum(run[run >= 0], ORDER)
        return float(np.log(self.innovations[order]).sum())


def rows_by_order(run: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Samples that are predicted from 0, 1, ... ``ORDER`` before them."""
    return [np.flatnonzero(run == order) for order in range(ORDER)] + [np.flatnonzero(run >= ORDER)]


def lag_products(x: Array, rows: Sequence[NDArray[np.int64]]) -> Array:
    """Inner products of a signal (n,) with itself at lags 0 to each order, over the ``rows_by_order``, in one row."""
    windows = sliding_window_view(np.concatenate([np.zeros(ORDER), x]), ORDER + 1)[:, ::-1]
    out = []
    for order, at in enumerate(rows):
        lags = windows[at, : order + 1]
        out.append((lags.T @ lags).ravel())
    return np.concatenate(out)


@lru_cache(maxsize=8)
def bank_energy(bank: tuple[Spectrum, ...]) -> Array:
    """What takes ``lag_products`` of a signal to the sum of squares of its innovations by every spectrum."""
    parts = []
    for order in range(ORDER + 1):
        f = np.array([[1.0, *-s.predictors[order]] for s in bank])
        innovations = np.array([s.innovations[order] for s in bank])[:, None]
        parts.append((f[:, :, None] * f[:, None, :]).reshape(len(bank), -1) / innovations)
    return np.concatenate(parts, axis=1)


@lru_cache(maxsize=8)
def spectra(step_s: float) -> tuple[Spectrum, ...]:
    """The grid for samples ``step_s`` apart."""
    lag = step_s * np.arange(ORDER + 1)
    fast = np.exp(-(lag**2) / (4.0 * SMOOTHER_S**2))
    out = []
    for slow_s in SLOW_S:
        slow = np.exp(-lag / slow_s)
        out += [_spectrum(slow_s, share, share * slow + (1.0 - share) * fast) for share in SLOW_SHARE]
    return tuple(out)


def runs(valid: Mask) -> NDArray[np.int64]:
    """How many valid samples went directly before (n,); -1 where a sample is not valid."""
    index = np.arange(len(valid))
    broken = np.maximum.accumulate(np.where(valid, -1, index))
    out: NDArray[np.int64] = np.where(valid, index - broken - 1, -1)
    return out


def _spectrum(slow_s: float, share: float, autocovariance: Array) -> Spectrum:
    """Levinson's recursion: best predictors of every order."""
    r = autocovariance / autocovariance[0]
    r[0] += NUGGET
    a = np.empty(0)
    predictors, innovations = [a], [r[0]]
    for k in range(1, ORDER + 1):
        reflection = (r[k] - a @ r[1:k][::-1]) / innovations[-1]
        a = np.concatenate([a - reflection * a[::-1], [reflection]])
        predictors.append(a)
        innovations.append(innovations[-1] * (1.0 - reflection**2))
    return Spectrum(slow_s, share, tuple(predictors), np.array(innovations))
