"""Calibrate the spread of a regressor on places that it had not seen: conformal, with the finite-sample correction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array
from models.surrogate.fan_surrogate import Calibration

# Factors on the members' spread to choose from: from spread ignored to spread 20 times too small, steps of a tenth.
GAINS = np.concatenate([[0.0], np.geomspace(0.05, 20.0, 60)])
# Share of the errors within this many sigma: 95 % of a normal distribution.
COVER = 0.95
COVER_SIGMAS = 1.96
# Least sigma as a share of the lift: below the rounding of any data file.
SMALLEST = 1e-6


@dataclass(frozen=True)
class HeldOut:
    """Errors (n, 6) of answers where nothing was learnt and the spread (n, 6) stated there, gates included."""

    error: Array
    spread: Array
    locations: NDArray[np.intp]

    @property
    def level(self) -> float:
        """Share of the n known places to cover so that the next one is covered with 95 %: ceil(0.95 (n + 1)) / n."""
        n = len(np.unique(self.locations))
        return min(1.0, math.ceil(COVER * (n + 1)) / n)


def calibrate(sets: Sequence[HeldOut], increments: Array) -> Calibration:
    """Gain and floor per component of sigma = sqrt((gain spread)^2 + floor^2).

    Of all pairs with which 1.96 sigma covers every one of ``sets`` to its level, the pair with the narrowest sigma, in
    the mean logarithm. ``increments`` (m, 6) give the size against which spread counts.
    """
    gains = np.empty(6)
    floors = np.empty(6)
    size = np.sqrt(np.mean(increments**2, axis=0))
    for c in range(6):
        scaled = []
        floor2 = np.full(len(GAINS), SMALLEST**2)
        for held_out in sets:
            spread2 = (GAINS[:, None] * held_out.spread[:, c]) ** 2
            scaled.append(spread2)
            lacking = (held_out.error[:, c] / COVER_SIGMAS) ** 2 - spread2
            enough = np.quantile(lacking, held_out.level, axis=1, method="higher")
            floor2 = np.maximum(floor2, enough)
        widths = [np.log(spread2 + floor2[:, None]).mean(axis=1) for spread2 in scaled]
        k = int(np.argmin(np.mean(widths, axis=0)))
        gains[c] = GAINS[k]
        floors[c] = math.sqrt(floor2[k])
    return Calibration(tuple(gains.tolist()), tuple(floors.tolist()), tuple(size.tolist()))
