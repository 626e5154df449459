"""From which log on something is another one: one rule for effects that are named and for sizes.

A change at a place is weighed against none, by log odds. The likeliest place counts where its odds reach a least.

Sizes of one parameter on several logs differ by their errors and by their flights: y_i ~ N(m, s_i^2 + tau^2), tau by
DerSimonian & Laird 1986, Controlled Clinical Trials 7, 177. A change is a split into two means. It is weighed by how
much likelier it is than one mean, the mean more and its place paid for (Schwarz 1978, The Annals of Statistics 6, 461),
and by how seldom a parameter changes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.common.frames import Array

LEAST = 4
"""Logs without which no size is looked at, two on either side of the change."""
SIDE = 2
RARE = 0.01
"""Probability that a parameter changes in a season, before anything was seen."""
SURE = 1.0
"""Log odds from which a change is named."""


@dataclass(frozen=True)
class Step:
    """A size that is another one from index ``at`` on."""

    at: int
    before: float
    after: float
    log_odds: float


def likeliest(log_odds: Sequence[float], least: float = SURE) -> int | None:
    """Index of the likeliest place, the first of equal ones; None where its odds are below ``least``."""
    best = max(range(len(log_odds)), key=log_odds.__getitem__, default=None)
    if best is None or log_odds[best] < least:
        return None
    return best


def change_of_names(named: Sequence[bool]) -> int | None:
    """The flight from which on an effect is mostly there; names err as often either way, and each counts as one."""
    votes = np.where(np.asarray(named, bool), 1.0, -1.0)
    return likeliest(votes[::-1].cumsum()[::-1].tolist())


def change_of_sizes(values: Array, sd: Array) -> Step | None:
    """The likeliest change of a parameter (n,) with standard deviations (n,); None where one mean will do."""
    count = len(values)
    if count < LEAST:
        return None
    variance = sd**2
    whole = _log_likelihood(values, variance + _between(values, variance))
    paid = 1.5 * math.log(count) - math.log(RARE / (1.0 - RARE))
    places = range(SIDE, count - SIDE + 1)
    log_odds = []
    for k in places:
        spread = _spread(values, variance, k)
        split = _log_likelihood(values[:k], spread[:k]) + _log_likelihood(values[k:], spread[k:])
        log_odds.append(split - whole - paid)
    best = likeliest(log_odds)
    if best is None:
        return None
    k = places[best]
    spread = _spread(values, variance, k)
    return Step(
        at=k,
        before=_mean(values[:k], spread[:k]),
        after=_mean(values[k:], spread[k:]),
        log_odds=log_odds[best],
    )


def _spread(values: Array, variance: Array, k: int) -> Array:
    """Variance of every log, where the size is another one from index ``k`` on."""
    before = _between(values[:k], variance[:k])
    after = _between(values[k:], variance[k:])
    return variance + 0.5 * (before + after)


def _mean(y: Array, variance: Array) -> float:
    weight = 1.0 / variance
    return float((y * weight).sum() / weight.sum())


def _log_likelihood(y: Array, variance: Array) -> float:
    """Of one mean."""
    off = y - _mean(y, variance)
    return float(-0.5 * (off**2 / variance + np.log(variance)).sum())


def _between(y: Array, variance: Array) -> float:
    """Variance between logs, tau^2, by the method of moments."""
    weight = 1.0 / variance
    off = y - _mean(y, variance)
    q = float((weight * off**2).sum())
    scale = float(weight.sum() - (weight**2).sum() / weight.sum())
    if scale <= 0.0:
        return 0.0
    return max((q - (len(y) - 1)) / scale, 0.0)
