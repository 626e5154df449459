"""How large the largest score gets by chance: block sign flips, and circular shifts against the trajectory.

Sign flips of whitened blocks hold for constants as well as for what varies, and for noise whose size changes along the
flight; circular shifts (physics.md, RD-1) tell whether any force in step with the trajectory would have done as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.wrench import Array

DRAWS = 999


def flip_maxima(
    parts: Array, groups: Sequence[NDArray[np.int64]], inverses: Sequence[Array], penalties: Array, seed: int
) -> Array:
    """Largest penalised score over the groups in ``DRAWS`` sign-flipped worlds, (DRAWS,).

    ``parts`` (blocks, K) are the blocks' shares of X^T e; a group's score is g^T inverse g - penalty.
    """
    rng = np.random.default_rng(seed)
    signs = rng.choice((-1.0, 1.0), (DRAWS, len(parts)))
    flipped = signs @ parts
    best = np.full(DRAWS, -np.inf)
    for group, inverse, penalty in zip(groups, inverses, penalties, strict=True):
        g = flipped[:, group]
        best = np.maximum(best, np.einsum("bi,ij,bj->b", g, inverse, g) - penalty)
    return best


def p_value(null: ArrayLike, observed: float) -> float:
    """(1 + exceedances)/(1 + draws)."""
    return float((1 + np.sum(np.asarray(null) >= observed)) / (1 + np.size(null)))


def shift_p(columns: Array, residual: Array, inverse: Array, shortest: int) -> float:
    """Share of circular shifts of the residual (n, axes) that score as high as no shift; columns (n, axes, k)."""
    n = len(residual)
    if n < 4 * shortest:
        return 1.0
    fe = np.conj(np.fft.rfft(residual, axis=0))
    g = np.stack(
        [
            np.fft.irfft(np.fft.rfft(columns[..., j], axis=0) * fe, n, axis=0).sum(axis=1)
            for j in range(columns.shape[2])
        ],
        axis=1,
    )
    score = np.einsum("ni,ij,nj->n", g, inverse, g)
    null = score[shortest : n - shortest]
    return float((1 + np.sum(null >= score[0])) / (1 + np.size(null)))
