"""Noise and time: size and correlation of every axis, contiguous blocks, folds with embargo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.frames import Array

Mask = NDArray[np.bool_]
LONGEST_LAG_S = 20.0
"""Up to which the autocorrelation is summed [s]."""
FOLDS = 8
FOLD_S = 6.0
"""Length of a run of time that is held out [s]."""
LONGEST_EMBARGO_S = 4.0
"""Time beside it that is fitted on neither [s]: a flight of a minute has to keep half of it."""


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


def block_numbers(valid: Mask, step_s: float, length_s: float, most: int = 400) -> NDArray[np.int64]:
    """Number of the contiguous block of every sample (n,), blocks of equal shares of the valid time."""
    known = np.cumsum(valid)
    seconds = float(known[-1]) * step_s
    count = int(np.clip(seconds / length_s, FOLDS, most))
    number: NDArray[np.int64] = np.minimum((known - 1).clip(0) * count // max(int(known[-1]), 1), count - 1)
    return number


def fold_of_block(count: int, block_s: float) -> NDArray[np.int64]:
    """Fold of every block: contiguous runs of about ``FOLD_S`` dealt to ``FOLDS`` folds in turn.

    Long single folds would hide a manoeuvre flown once from its own fit; runs of a few seconds with an embargo on
    both sides do not, and are still time that the fit never saw.
    """
    run = max(round(FOLD_S / max(block_s, 1e-9)), 1)
    run = min(run, max(count // FOLDS, 1))
    return np.arange(count) // run % FOLDS


def training_blocks(folds: NDArray[np.int64], fold: int, embargo: int) -> Mask:
    """Blocks to fit on: outside ``fold`` and ``embargo`` blocks around its runs."""
    near = np.convolve(folds == fold, np.ones(2 * embargo + 1), "same") > 0.5
    return ~near


def embargo_blocks(tau_s: float, block_s: float) -> int:
    """Blocks to leave out beside a fold: three correlation times, at most ``LONGEST_EMBARGO_S``."""
    return max(int(np.ceil(min(3.0 * tau_s, LONGEST_EMBARGO_S) / block_s)), 1)


def split(valid: Mask, step_s: float, block_s: float, tau_s: float) -> tuple[NDArray[np.int64], Mask]:
    """Fold (n,) of every sample, and the samples (FOLDS, n) that every fold is fitted on.

    ``block_s``: unit of the time that is held out; ``tau_s``: correlation time that the embargo is set by.
    """
    block = block_numbers(valid, step_s, block_s)
    count = int(block.max()) + 1
    length = float(valid.sum() * step_s) / count
    folds, embargo = fold_of_block(count, length), embargo_blocks(tau_s, length)
    return folds[block], np.stack([training_blocks(folds, k, embargo)[block] for k in range(FOLDS)])
