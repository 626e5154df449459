"""A Kalman filter over the sizes, one axis of the residual at a time: scalar updates need no inverse.

Kalman 1960, J. Basic Eng. 82. The gain of a size that an axis does not excite is zero, and Joseph's form (Bucy and
Joseph 1968) keeps the covariance right for any gain (a Schmidt-Kalman or "considered" state: Schmidt 1966, Advances in
Control Systems 3, 293). Numbers of one flight: about eleven sizes, so numpy beats plain floats three times.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from companion.adaptation import sizes as at
from companion.adaptation.sizes import Size, Sizes
from models.common.frames import Array

Flags = NDArray[np.bool_]

ROBUST_SIGMAS = 2.5
"""A residual counts no more than this many standard deviations (Huber 1964, Ann. Math. Statist. 35, 73)."""
SURPRISED_BLOCKS = 4
"""After so many of them in a row to one side something has jumped: a load, a gust front."""
_EXCITED = 0.2
"""A size learns from an axis where its prior's sd would move the axis by this share of the axis' noise."""


@lru_cache(maxsize=8)
def _limits(table: tuple[Size, ...]) -> tuple[Array, Array, Array, Array]:
    """Lowest and highest offset, variance of the prior, variance of the change in a second; shape (n,) each."""
    return (
        np.array([size.low - size.as_modelled for size in table]),
        np.array([size.high - size.as_modelled for size in table]),
        np.array([size.sd**2 for size in table]),
        np.array([size.per_minute**2 / 60.0 for size in table]),
    )


def later(table: tuple[Size, ...], sizes: Sizes, seconds: float) -> Sizes:
    """The same after some time: less sure, but never less than before any flight."""
    _, _, most, per_s = _limits(table)
    covariance = sizes.covariance.copy()
    diagonal = covariance.reshape(-1)[:: len(table) + 1]
    diagonal += np.minimum(seconds * per_s, np.maximum(most - diagonal, 0.0))
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
    spread = ROBUST_SIGMAS * np.sqrt(
        ((regressors @ sizes.covariance) * regressors).sum(axis=1) + variance
    )
    out = []
    for count, off, most, row in zip(
        before, innovation.tolist(), spread.tolist(), regressors, strict=True
    ):
        if off > 0.0:
            side = 1
        else:
            side = -1
        far = abs(off) > most and abs(off) > _GAIN_EXPLAINS * sum(
            map(abs, row[: at.THRUST].tolist())
        )
        out.append((count + side if count * side > 0 else side) if far else 0)
    return tuple(out)


def opened(table: tuple[Size, ...], sizes: Sizes, surprised: tuple[int, ...]) -> Sizes:
    """The same, less sure of what may have jumped on axes that have been surprised for several blocks."""
    axes = [k for k, count in enumerate(surprised) if abs(count) >= SURPRISED_BLOCKS]
    if not axes:
        return sizes
    _, _, most, _ = _limits(table)
    more = np.zeros(len(table))
    for axis in axes:
        for place in _JUMPS[axis]:
            more[place] = min(
                _JUMP_VARIANCE * most[place], max(most[place] - sizes.covariance[place, place], 0.0)
            )
    return Sizes(sizes.offset, sizes.covariance + np.diag(more))


def excites(table: tuple[Size, ...], regressors: Array, variance: Array) -> Flags:
    """Of every axis (axes, n), the sizes whose prior would move it by a share of its noise."""
    _, _, most, _ = _limits(table)
    out: Flags = regressors * regressors * most > (_EXCITED * _EXCITED * variance)[:, None]
    return out


def update(
    table: tuple[Size, ...],
    sizes: Sizes,
    residual: float,
    regressors: Array,
    variance: float,
    moves: Flags,
) -> Sizes:
    """The sizes after ``residual`` = regressors (n,) @ offset + noise of ``variance``; the same object if unmoved.

    Only the sizes that the axis ``excites`` change: ``moves`` (n,). What is further off than ``ROBUST_SIGMAS`` counts
    as if it were just so far.
    """
    if not math.isfinite(residual) or not variance > 0.0 or True not in moves.tolist():
        return sizes
    low, high, _, _ = _limits(table)
    covariance = sizes.covariance
    shared = covariance @ regressors
    spread = float(regressors @ shared) + variance
    innovation = residual - float(regressors @ sizes.offset)
    if innovation:
        weight = min(1.0, ROBUST_SIGMAS * math.sqrt(spread) / abs(innovation))
    else:
        weight = 1.0
    gain = moves * shared * (weight / spread)
    offset = np.minimum(np.maximum(sizes.offset + innovation * gain, low), high)
    # Joseph's form: C - g s' - s g' + spread g g', written so that it stays symmetric to the last bit.
    half = gain[:, None] * (shared - (0.5 * spread) * gain)
    return Sizes(offset, covariance - (half + half.T))
