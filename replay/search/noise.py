"""What is left of every axis: its size, and over which time it is correlated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.frames import Array
from replay.residual.grid import Mask

LONGEST_LAG_S = 20.0
"""Up to which the autocorrelation is summed [s]."""


@dataclass(frozen=True)
class Noise:
    """Noise of every axis: standard deviation (axes,) in N, N m."""

    total: Array
    tau_s: Array
    """Integrated autocorrelation time [s] (axes,)."""


def fit_noise(residual: Array, valid: Mask, step_s: float) -> Noise:
    """Of every axis of ``residual`` (n, axes), gaps bridged by nothing."""
    axes = residual.shape[1]
    total, tau = np.ones(axes), np.ones(axes)
    weight = valid.astype(float)
    for a in range(axes):
        x = np.where(valid, residual[:, a], 0.0)
        covariance = _autocovariance(x, weight, int(LONGEST_LAG_S / step_s))
        total[a] = np.sqrt(max(covariance[0], 1e-24))
        tau[a] = step_s * _integrated(covariance / max(covariance[0], 1e-24))
    return Noise(total, tau)


def _autocovariance(x: Array, weight: Array, lags: int) -> Array:
    """Of (n,) at lags 0 to ``lags``, over the pairs of samples that are both known."""
    lags = min(lags, len(x) - 1)
    # Wiener-Khinchin, with as many zeros behind as there are samples.
    powers = (np.abs(np.fft.rfft(v, 2 * len(v))) ** 2 for v in (x, weight))
    top, count = (np.fft.irfft(power)[: lags + 1] for power in powers)
    return np.asarray(top / np.maximum(count, 1.0))


def _integrated(correlation: Array) -> float:
    """1 + 2 sum of the autocorrelation up to its first value below 0.05, in samples."""
    below = np.flatnonzero(correlation < 0.05)
    end = int(below[0]) if below.size else len(correlation)
    return float(1.0 + 2.0 * correlation[1:end].sum())
