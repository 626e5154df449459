"""How large the largest score gets by chance, from block sign flips.

Sign flips of whitened blocks hold for constants as well as for what varies, and for noise whose size changes along the
flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.frames import Array

DRAWS = 999
LEAST_WIDTH = 3.0
"""Twice the log likelihood: what one coefficient of white noise spreads."""


@dataclass(frozen=True)
class Chance:
    """Scores of several rivals in sign-flipped worlds: each rival's median and width, and the largest of all."""

    middle: dict[str, float]
    width: dict[str, float]
    largest: Array

    def p(self, name: str, score: float) -> float:
        """Share of the worlds in which any rival stands out as far by its own measure."""
        return p_value(self.largest, (score - self.middle[name]) / self.width[name])


def flips(
    parts: Array, names: Sequence[str], groups: Sequence[NDArray[np.int64]], inverses: Sequence[Array],
    penalties: Array, seed: int,
) -> Chance:  # fmt: skip
    """Chance from ``DRAWS`` sign-flipped worlds of ``parts`` (blocks, K), the blocks' shares of X^T e.

    A group's score is g^T inverse g - penalty, a rival's that of its best group. Rivals differ in how far chance
    carries them (a few blocks may hold all of one), so each is measured by its own spread before the largest counts.
    """
    rng = np.random.default_rng(seed)
    signs = rng.choice((-1.0, 1.0), (DRAWS, len(parts)))
    flipped = signs @ parts
    best: dict[str, Array] = {}
    for name, group, inverse, penalty in zip(names, groups, inverses, penalties, strict=True):
        g = flipped[:, group]
        score = np.einsum("bi,ij,bj->b", g, inverse, g) - penalty
        best[name] = np.maximum(best[name], score) if name in best else score
    middle = {name: float(np.median(scores)) for name, scores in best.items()}
    width = {name: max(float(np.quantile(s, 0.95)) - middle[name], LEAST_WIDTH) for name, s in best.items()}
    spread = [(scores - middle[name]) / width[name] for name, scores in best.items()]
    return Chance(middle, width, np.max(spread, axis=0))


def p_value(null: ArrayLike, observed: float) -> float:
    """(1 + exceedances)/(1 + draws)."""
    return float((1 + np.sum(np.asarray(null) >= observed)) / (1 + np.size(null)))
