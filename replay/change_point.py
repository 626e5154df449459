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


def likeliest(log_odds: Sequence[float]) -> int | None:
    """Index of the likeliest place, the first of equal ones; None where its odds are below ``SURE``."""
    best = max(range(len(log_odds)), key=log_odds.__getitem__, default=None)
    if best is None or log_odds[best] < SURE:
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
    middle = _mean(values, variance)
    # Sums of squares lose no digits where they are of small numbers.
    y = values - middle
    before, after = _between(y, variance)
    whole = _log_likelihood(y, variance + before[-1], count)
    paid = 1.5 * math.log(count) - math.log(RARE / (1.0 - RARE))
    places = range(SIDE, count - SIDE + 1)
    spread = 0.5 * (before[:-1] + after[:-1])
    log_odds = []
    for k in places:
        log_odds.append(_log_likelihood(y, variance + spread[k - 1], k) - whole - paid)
    best = likeliest(log_odds)
    if best is None:
        return None
    k = places[best]
    of_logs = variance + spread[k - 1]
    return Step(
        at=k,
        before=_mean(values[:k], of_logs[:k]),
        after=_mean(values[k:], of_logs[k:]),
        log_odds=log_odds[best],
    )


def _mean(y: Array, variance: Array) -> float:
    weight = 1.0 / variance
    return float((y * weight).sum() / weight.sum())


def _log_likelihood(y: Array, variance: Array, k: int) -> float:
    """Of one mean up to index ``k`` and another one from there on; of one mean where ``k`` is the end.

    sum (y_i - m)^2 / v_i = sum y_i^2 / v_i - (sum y_i / v_i)^2 / sum 1 / v_i on either side.
    """
    weight = 1.0 / variance
    weighted = weight * y
    square = weighted @ y
    for side in (slice(None, k), slice(k, None)):
        known = weight[side].sum()
        if known > 0.0:
            square -= weighted[side].sum() ** 2 / known
    return float(-0.5 * (square + np.log(variance).sum()))


def _between(y: Array, variance: Array) -> tuple[Array, Array]:
    """Variance between logs, tau^2, by the method of moments: of the first k logs, and of those after them (n,)."""
    weight = 1.0 / variance
    counts = np.ones(len(y))
    terms = np.stack([counts, weight, weight**2, weight * y, weight * y**2])
    before = terms.cumsum(axis=1)
    return _moments(before), _moments(before[:, -1:] - before)


def _moments(sums: Array) -> Array:
    """tau^2 from sums (5, n) of 1, w, w^2, w y, w y^2."""
    count, known, squared, first, second = sums
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = known - squared / known
        spread = (second - first**2 / known - (count - 1.0)) / scale
    return np.where(scale > 1e-9 * known, np.maximum(spread, 0.0), 0.0)
