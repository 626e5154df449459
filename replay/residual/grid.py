"""A uniform clock for raw samples, and the one low-pass filter that every signal goes through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array

Mask = NDArray[np.bool_]


RATE_HZ = 10.0
"""Rate of a record: five samples a period at the cut-off."""
CUT_OFF_HZ = 2.0
"""-3 dB of the low-pass. Above it rotor speeds, IMU and estimator are not of one time within their phases."""
KNOWN_SHARE = 0.4
"""Share of the filter's weight that must be known: less than half, so that the edge of a gap is still smoothed."""


class Grid:
    """Raw samples on a uniform clock, and the smoother that every signal goes through.

    ``every``: of so many samples one is kept, so that a record has ``RATE_HZ``.
    """

    def __init__(self, start: float, end: float, rate: float, cut_off_hz: float) -> None:
        self.rate = rate
        self.t = start + np.arange(max(int((end - start) * rate), 1)) / rate
        # -3 dB of a Gaussian: sqrt(ln 2) / (2 pi sigma_t)
        sigma = 0.1325 / cut_off_hz * rate
        half = max(int(4 * sigma), 1)
        sample = np.arange(-half, half + 1)
        kernel = np.exp(-0.5 * (sample / sigma) ** 2)
        self.kernel = kernel / kernel.sum()
        self.spread_s = sigma / rate
        """Standard deviation of the low-pass."""
        self.smooth_s = half / rate
        """By which the low-pass reaches to either side."""
        self.every = max(round(rate / RATE_HZ), 1)

    def smooth(self, x: Array) -> Array:
        """Zero-phase Gaussian low-pass of (n, ...) along time, NaN ignored, every n-th sample kept."""
        columns = x.reshape(len(x), -1).T
        out = [self._smooth(column) for column in columns]
        return np.stack(out, axis=1).reshape(-1, *x.shape[1:])

    def _smooth(self, x: Array) -> Array:
        known = np.isfinite(x)
        weight = np.convolve(known.astype(float), self.kernel, "same")
        total = np.convolve(np.where(known, x, 0.0), self.kernel, "same")
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(weight > KNOWN_SHARE, total / weight, np.nan)
        return mean[:: self.every]


def rate_of_change(x: Array, rate_hz: float) -> Array:
    """Time derivative of (n, ...) by central differences, per second."""
    return np.gradient(x, 1.0 / rate_hz, axis=0)


def running_mean(x: Array, half: int) -> Array:
    """Mean of (n,) over ``2 half + 1`` samples, NaN and infinities left out."""
    kernel = np.ones(2 * half + 1)
    known = np.isfinite(x) & (np.abs(x) < 1e6)
    samples = np.convolve(known.astype(float), kernel, "same")
    total = np.convolve(np.where(known, x, 0.0), kernel, "same")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(samples > 0, total / samples, np.nan)


def band(x: Array, rate: float, fast_s: float, slow_s: float) -> Array:
    """What of (n,) varies between two half widths of running means [s]."""
    fast = running_mean(x, int(fast_s * rate))
    slow = running_mean(x, int(slow_s * rate))
    return fast - slow
