"""Calibrate the spread of an ensemble on rows its members had not seen."""

from __future__ import annotations

import numpy as np

from models.surrogate import Calibration
from models.wrench import Array

GAINS = np.geomspace(0.05, 20.0, 40)
COVER = 0.95
COVER_SIGMAS = 1.96
SMALLEST = 1e-6


def calibrate(error: Array, spread: Array, increments: Array) -> Calibration:
    """Gain and floor per component from errors (n, 6) on unseen rows and the spread (n, 6) there, gates included.

    Of sigma = sqrt((gain spread)^2 + floor^2) the most likely pair for Gaussian errors is taken, then both are scaled
    until 95 % of the errors lie within 1.96 sigma. ``increments`` (m, 6) give the size against which spread counts.
    """
    gains, floors = np.empty(6), np.empty(6)
    size = np.sqrt(np.mean(increments**2, axis=0))
    for c in range(6):
        scale = max(float(np.sqrt(np.mean(error[:, c] ** 2))), SMALLEST)
        best = np.inf
        for floor in scale * np.geomspace(0.02, 1.5, 24):
            variance = (GAINS[:, None] * spread[:, c]) ** 2 + floor**2
            cost = (0.5 * np.log(variance) + 0.5 * error[:, c] ** 2 / variance).mean(axis=1)
            k = int(np.argmin(cost))
            if cost[k] < best:
                best, gains[c], floors[c] = float(cost[k]), GAINS[k], floor
        sigma = np.sqrt((gains[c] * spread[:, c]) ** 2 + floors[c] ** 2)
        stretch = float(np.quantile(np.abs(error[:, c]) / sigma, COVER)) / COVER_SIGMAS
        gains[c] *= stretch
        floors[c] *= stretch
    return Calibration(tuple(gains.tolist()), tuple(floors.tolist()), tuple(size.tolist()))
