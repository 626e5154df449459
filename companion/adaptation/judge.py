"""With the model or without it: two hypotheses about lift, pull or tilt, judged by how well each predicts.

Multiple-model estimation (Magill 1965, IEEE Trans. Automatic Control 10, 434): a Kalman filter for each, and the odds
of one against the other from the likelihoods of what they had not yet seen. Both hold a map of what is left
(``near_map``): small beside a model, large without one. What steady things add is estimated along in both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from companion.adaptation import sizes as at
from companion.adaptation.near_map import CELLS, cells, cheeseman_bennett, prior_covariance
from companion.adaptation.options import AdaptTuning
from companion.adaptation.parts import Around
from companion.adaptation.sizes import Size
from models.frames import Array


@dataclass(frozen=True, slots=True)
class Channel:
    """One of lift, pull and tilt: the axes it is seen in, the sizes estimated along, and the column of its gain.

    A state holds those sizes, the gain, the ground's lift in Cheeseman and Bennett's, and the cells of the map.
    ``means`` and ``covariances`` (with the model, without it), ``growth`` of their variances in a second.
    """

    axes: tuple[int, ...]
    along: tuple[int, ...]
    own: int
    means: tuple[Array, Array]
    covariances: tuple[Array, Array]
    growth: tuple[Array, Array]

    @property
    def gain(self) -> int:
        """Place of the gain in a state; the ground's lift and the cells follow."""
        return len(self.along)


@dataclass(frozen=True, slots=True)
class Judged:
    """What is believed of one channel: with the model and without it, and the odds between the two."""

    means: tuple[Array, Array]
    covariances: tuple[Array, Array]
    log_odds: float
    """Of the model against none."""
    surprised: tuple[int, ...]
    """For how many blocks in a row each axis has been far off to one side of both."""

    @property
    def probability(self) -> float:
        """Of the model."""
        return 1.0 / (1.0 + math.exp(-self.log_odds))


_ALONG = ((at.THRUST, at.INFLOW), (at.NORTH, at.EAST, at.DRAG), (at.CG_X, at.CG_Y, at.DRAG_ARM))
_AXES = ((2,), (0, 1), (3, 4))


@lru_cache(maxsize=8)
def channels_of(table: tuple[Size, ...], tuning: AdaptTuning) -> tuple[Channel, Channel, Channel]:
    """Lift, pull and tilt."""
    out = []
    for own, (axes, along) in enumerate(zip(_AXES, _ALONG, strict=True)):
        wind = tuning.calm_wind if own == at.PULL else 1.0
        beside = [
            (table[k].mean - table[k].as_modelled, table[k].sd, table[k].per_minute * (wind if k in _WIND else 1.0))
            for k in along
        ]
        means, covariances, growth = [], [], []
        for gain, sd, ground, near in (
            (table[own].mean, table[own].sd, 0.0, tuning.left_sd[own]),
            (0.0, 0.0, tuning.ground_sd if own == at.LIFT else 0.0, tuning.map_sd[own]),
        ):
            cell = prior_covariance(near, of_wall=own != at.LIFT)
            mean, variance = [*[m for m, _, _ in beside], gain, 0.0], [*[s * s for _, s, _ in beside], sd**2, ground**2]
            drift = [*[d for _, _, d in beside], tuning.drift * sd, tuning.drift * ground]
            covariance = np.zeros((len(mean) + CELLS,) * 2)
            np.fill_diagonal(covariance, [*variance, *[0.0] * CELLS])
            covariance[len(mean) :, len(mean) :] = cell
            means.append(np.array([*mean, *[0.0] * CELLS]))
            covariances.append(covariance)
            growth.append(np.array([*[d * d for d in drift], *(tuning.drift**2 * np.diagonal(cell))]) / 60.0)
        out.append(
            Channel(axes, along, own, (means[0], means[1]), (covariances[0], covariances[1]), (growth[0], growth[1]))
        )
    return out[0], out[1], out[2]


_WIND = (at.NORTH, at.EAST)


def initial(channel: Channel, odds: float) -> Judged:
    """Before anything is seen; ``odds`` of the model against none."""
    return Judged(channel.means, channel.covariances, math.log(odds), (0,) * len(channel.axes))


def rows(channel: Channel, regressors: Array, around: Around, radius_m: float) -> list[Array]:
    """What a state adds to each axis of the channel: shape (n,) each."""
    weights = np.zeros(CELLS)
    form = 0.0
    for height, gap, thrust in zip(around.heights, around.gaps, around.free_lift_n, strict=True):
        form += thrust * cheeseman_bennett(height)
        for k, weight in cells(height, gap):
            weights[k] += weight * thrust
    c, s = math.cos(around.bearing_rad), math.sin(around.bearing_rad)
    along = {0: c, 1: s, 2: -1.0, 3: s * radius_m, 4: -c * radius_m}
    out = []
    for axis in channel.axes:
        row = np.empty(channel.gain + 2 + CELLS)
        row[: channel.gain] = regressors[axis, channel.along]
        row[channel.gain] = regressors[axis, channel.own]
        row[channel.gain + 1] = -form if channel.own == at.LIFT else 0.0
        row[channel.gain + 2 :] = along[axis] * weights
        out.append(row)
    return out


def learn(
    channel: Channel, judged: Judged, seconds: float, seen: Sequence[tuple[float, Array, float]], tuning: AdaptTuning
) -> Judged:
    """One block on: (value, row, variance) of each axis of the channel; an axis that is not a number tells nothing."""
    means, covariances = list(judged.means), [
        _later(p, g, seconds, first)
        for p, g, first in zip(judged.covariances, channel.growth, channel.covariances, strict=True)
    ]  # fmt: skip
    log_odds, surprised = judged.log_odds, []
    for (value, row, variance), before in zip(seen, judged.surprised, strict=True):
        if not math.isfinite(value) or not variance > 0.0:
            surprised.append(0)
            continue
        likely, sides = [], []
        for k in (0, 1):
            means[k], covariances[k], off, log_likelihood = _updated(
                means[k], covariances[k], value, row, variance, tuning.robust_sigmas
            )
            likely.append(log_likelihood)
            sides.append(off)
        log_odds += tuning.evidence * (likely[0] - likely[1])
        far = min(sides) > tuning.robust_sigmas or max(sides) < -tuning.robust_sigmas
        side = 1 if sides[0] > 0.0 else -1
        surprised.append((before + side if before * side > 0 else side) if far else 0)
    gain = channel.gain
    means[0][gain] = min(max(means[0][gain], 0.0), tuning.most)  # a fresh array: see _updated
    log_odds = min(max(log_odds, -tuning.most_log_odds), tuning.most_log_odds)
    if any(abs(n) >= tuning.surprised_blocks for n in surprised):
        covariances = [_opened(p, first, gain) for p, first in zip(covariances, channel.covariances, strict=True)]
    return Judged((means[0], means[1]), (covariances[0], covariances[1]), log_odds, tuple(surprised))


def _later(covariance: Array, growth: Array, seconds: float, first: Array) -> Array:
    """The covariance after some time; no variance beyond that before any flight."""
    out = covariance.copy()
    n = len(growth)
    diagonal = out.reshape(-1)[:: n + 1]
    diagonal += np.minimum(growth * seconds, np.maximum(first.reshape(-1)[:: n + 1] - diagonal, 0.0))
    return out


_OPENED = 0.1
"""Of the prior's variance: what a block adds to that of steady things after a jump."""


def _opened(covariance: Array, first: Array, steady: int) -> Array:
    out = covariance.copy()
    for k in range(steady):
        out[k, k] += min(_OPENED * first[k, k], max(first[k, k] - out[k, k], 0.0))
    return out


def _updated(
    mean: Array, covariance: Array, value: float, row: Array, variance: float, sigmas: float
) -> tuple[Array, Array, float, float]:
    """Mean and covariance after a value; how many standard deviations off it was, and its log likelihood before."""
    shared = covariance @ row
    spread = float(row @ shared) + variance
    innovation = value - float(row @ mean)
    off = innovation / math.sqrt(spread)
    weight = min(1.0, sigmas / abs(off)) if off else 1.0
    # Joseph's form for the weighted gain w shared / spread.
    less = (2.0 - weight) * weight / spread
    log_likelihood = -0.5 * math.log(spread) - 0.5 * min(off * off, 2.0 * sigmas * sigmas)
    return (
        mean + (weight * innovation / spread) * shared,
        covariance - less * (shared[:, None] * shared),
        off,
        log_likelihood,
    )


def believed(channel: Channel, judged: Judged) -> tuple[float, float, Array]:
    """Gain on the model, the ground's lift in Cheeseman and Bennett's, and the map (CELLS,): both hypotheses' mean."""
    p, gain = judged.probability, channel.gain
    mixed = p * judged.means[0] + (1.0 - p) * judged.means[1]
    return float(mixed[gain]), float(mixed[gain + 1]), mixed[gain + 2 :]
