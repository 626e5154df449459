"""How well the mean of a flow that swings is known, from one run of it."""

from __future__ import annotations

import numpy as np

from models.frames import Array

# With fewer blocks the error of the error is above 40 % (1 / sqrt(2 (n - 1))).
LEAST_BLOCKS = 4
SIZES = 3


def error_of_mean(samples: Array) -> Array:
    """Standard error (k,) of the mean of correlated samples (n, k), in time order; nan for fewer than four.

    Means of blocks, whose size doubles as long as ``LEAST_BLOCKS`` of them are left (Flyvbjerg and Petersen 1989).
    Short blocks know nothing of the swing, long ones are few: the largest estimate of the ``SIZES`` longest counts.
    """
    if len(samples) < LEAST_BLOCKS:
        return np.full(samples.shape[1:], np.nan)
    found = []
    size = 1
    while len(samples) // size >= LEAST_BLOCKS:
        blocks = len(samples) // size
        # What does not fill a block is left out at the start, where the run is least settled.
        means = samples[len(samples) - blocks * size :].reshape(blocks, size, -1).mean(axis=1)
        found.append(means.std(axis=0, ddof=1) / np.sqrt(blocks))
        size *= 2
    out: Array = np.max(found[-SIZES:], axis=0)
    return out
