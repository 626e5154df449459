"""A Kalman filter over the sizes, one axis of the residual at a time: scalar updates need no inverse.

With x the offsets of the sizes from their values as modelled and P their covariance, an axis of the residual is
z = H x + noise of variance R, H its regressors. Kalman 1960, J. Basic Eng. 82:

    y = z - H x                                       innovation
    S = H P H' + R                                    its variance
    w = min(1, c sqrt(S) / |y|)                       Huber's weight, c = ``ROBUST_SIGMAS``
    K = m w P H' / S                                  gain; m is 1 for the sizes that the axis excites, else 0
    x = x + K y
    P = P - K (P H')' - P H' K' + S K K'              Joseph's form (Bucy and Joseph 1968), right for any gain

Huber 1964, Ann. Math. Statist. 35, 73. A gain of zero makes a "considered" state (Schmidt 1966, Advances in Control
Systems 3, 293). Numbers of one flight: about eleven sizes, so numpy beats plain floats three times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from companion.adaptation import sizes as at
from companion.adaptation.sizes import Size, Sizes
from models.common.frames import Array

Flags = NDArray[np.bool_]

ROBUST_SIGMAS = 2.5
"""A residual counts no more than this many standard deviations."""
SURPRISED_BLOCKS = 4
"""After so many of them in a row to one side something has jumped: a load, a gust front."""
_EXCITED = 0.2
"""A size learns from an axis where its prior's sd would move the axis by this share of the axis' noise."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a table allows its sizes, (n,) each."""

    low: Array
    high: Array
    """Of the offset."""
    variance: Array
    """Of the prior: never more."""
    growth_1_s: Array
    """Of the variance."""


@lru_cache(maxsize=8)
def _limits(table: tuple[Size, ...]) -> Limits:
    """Of a table."""
    return Limits(
        low=np.array([size.low - size.as_modelled for size in table]),
        high=np.array([size.high - size.as_modelled for size in table]),
        variance=np.array([size.sd**2 for size in table]),
        growth_1_s=np.array([size.per_minute**2 / 60.0 for size in table]),
    )


def predict(table: tuple[Size, ...], sizes: Sizes, seconds: float) -> Sizes:
    """The same after some time: less sure, but never less than before any flight."""
    here = _limits(table)
    covariance = sizes.covariance.copy()
    diagonal = covariance.reshape(-1)[:: len(table) + 1]
    diagonal += np.minimum(seconds * here.growth_1_s, np.maximum(here.variance - diagonal, 0.0))
    return Sizes(sizes.offset, covariance)


_JUMPS = ((at.NORTH, at.EAST), (at.NORTH, at.EAST), (at.THRUST,), (at.CG_Y,), (at.CG_X,))
"""What may change at once, by axis: a gust front, a load, what shifts in a bay."""
_JUMP_VARIANCE = 0.1
"""Of the prior's: what a block adds to the variance while an axis is surprised."""
_GAIN_EXPLAINS = 1.5
"""A residual smaller than this many times what ground and wall do by the model may be the model's fault."""


def surprises(
    sizes: Sizes, innovation: Array, regressors: Array, variance: Array, before: tuple[int, ...]
) -> tuple[int, ...]:
    """For how many blocks in a row each axis has been off by more than ``ROBUST_SIGMAS`` to the same side: +n or -n.

    What a gain on the model can explain is no surprise.
    """
    variances = ((regressors @ sizes.covariance) * regressors).sum(axis=1) + variance
    most = ROBUST_SIGMAS * np.sqrt(variances)
    out = []
    for count, off, limit, row in zip(
        before, innovation.tolist(), most.tolist(), regressors, strict=True
    ):
        by_model = sum(map(abs, row[: at.THRUST].tolist()))
        if abs(off) > limit and abs(off) > _GAIN_EXPLAINS * by_model:
            out.append(in_a_row(count, 1 if off > 0.0 else -1))
        else:
            out.append(0)
    return tuple(out)


def in_a_row(before: int, side: int) -> int:
    """Blocks in a row that were far off to the same ``side`` (1 or -1), with one more: +n or -n."""
    if before * side > 0:
        return before + side
    return side


def inflate(table: tuple[Size, ...], sizes: Sizes, surprised: tuple[int, ...]) -> Sizes:
    """The same, less sure of what may have jumped on axes that have been surprised for several blocks."""
    axes = [k for k, count in enumerate(surprised) if abs(count) >= SURPRISED_BLOCKS]
    if not axes:
        return sizes
    most = _limits(table).variance
    more = np.zeros(len(table))
    for axis in axes:
        for place in _JUMPS[axis]:
            more[place] = min(
                _JUMP_VARIANCE * most[place], max(most[place] - sizes.covariance[place, place], 0.0)
            )
    return Sizes(sizes.offset, sizes.covariance + np.diag(more))


def excites(table: tuple[Size, ...], regressors: Array, variance: Array) -> Flags:
    """Of every axis (axes, n), the sizes whose prior would move it by a share of its noise."""
    most = _limits(table).variance
    out: Flags = regressors * regressors * most > (_EXCITED * _EXCITED * variance)[:, None]
    return out


def update(
    table: tuple[Size, ...], sizes: Sizes, z: float, H: Array, R: float, moves: Flags
) -> Sizes:
    """The sizes after an axis of the residual, z = H x + noise of variance R; the same object if unmoved.

    ``H`` (n,): the axis' regressors. ``moves`` (n,): the sizes that it ``excites``; only they change. Formulas: above.
    """
    if not math.isfinite(z) or not R > 0.0 or True not in moves.tolist():
        return sizes
    here = _limits(table)
    x = sizes.offset
    P = sizes.covariance
    PH = P @ H
    S = float(H @ PH) + R
    y = z - float(H @ x)
    if y:
        w = min(1.0, ROBUST_SIGMAS * math.sqrt(S) / abs(y))
    else:
        w = 1.0
    K = moves * PH * (w / S)
    x = np.minimum(np.maximum(x + y * K, here.low), here.high)
    # Written so that it stays symmetric to the last bit.
    half = K[:, None] * (PH - (0.5 * S) * K)
    return Sizes(x, P - (half + half.T))
