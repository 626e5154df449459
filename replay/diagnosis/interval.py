"""RMS with an interval, by a bootstrap over blocks of time."""

from __future__ import annotations

import numpy as np

from models.frames import Array

BLOCK_S = 3.0
"""Blocks of the bootstrap: longer than a residual hangs together [s]."""
_DRAWS = 400
"""Of the bootstrap: the ends of a 95 % interval are then sure to a fifth of its width."""


def rms_interval(residual: Array, step_s: float) -> tuple[float, float, float]:
    """RMS of (n,) with its 95 % interval from a bootstrap over blocks of ``BLOCK_S``.

    Künsch 1989, Annals of Statistics 17, 1217.
    """
    square = residual**2
    parts = np.array_split(square, max(len(square) // max(round(BLOCK_S / step_s), 1), 2))
    sums, counts = np.array([p.sum() for p in parts]), np.array([len(p) for p in parts])
    pick = np.random.default_rng(0).integers(0, len(parts), (_DRAWS, len(parts)))
    draws = np.sqrt(sums[pick].sum(1) / np.maximum(counts[pick].sum(1), 1))
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(np.sqrt(square.mean())), float(low), float(high)
