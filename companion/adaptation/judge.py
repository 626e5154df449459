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
from typing import NamedTuple

import numpy as np

from companion.adaptation import sizes as at
from companion.adaptation.apply import MOST
from companion.adaptation.filter import ROBUST_SIGMAS, SURPRISED_BLOCKS
from companion.adaptation.near_map import CELLS, MAP, cheeseman_bennett
from companion.adaptation.sizes import Size
from companion.disturbance.records import FanPlaces
from models.common.frames import Array

_ALONG = ((at.THRUST, at.INFLOW), (at.NORTH, at.EAST, at.DRAG), (at.CG_X, at.CG_Y, at.DRAG_ARM))
_AXES = ((2,), (0, 1), (3, 4))
_WIND = (at.NORTH, at.EAST)
_MAP_SD = (0.05, 0.012, 0.05)
"""Prior sd of what is measured of lift, pull (of a fan's thrust) and tilt (of that times the radius) without a model,
within two rotor radii: half of the largest that is published (Ai et al. 2020; docs/lab/adaptation.md)."""
_LEFT_SD = (0.015, 0.004, 0.015)
"""The same of what a right model leaves: its law is 10 to 30 % off."""
_GROUND_SD = 1.0
"""Prior sd of the ground's lift in Cheeseman and Bennett's; its mean is 0, so that nothing is applied unseen."""
_DRIFT = 0.3
"""Change of gain, ground's lift and map in a minute, of their prior sd."""
_CALM_WIND = 0.25
"""Change of the wind in a minute while the pull is judged, of what it may change otherwise: a gust is a jump."""
_EVIDENCE = 0.5
"""Of a block's log likelihood: neighbours are alike."""
_MOST_LOG_ODDS = 4.0
"""Bound of the odds, so that a model that was contradicted can come back: 0.02 to 0.98."""
_LOW_RADII = 1.6
"""Where the ground's lift is reported: low, and yet where most flights have been."""
_OPENED = 0.1
"""Of the prior's variance: what a block adds to that of steady things after a jump."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One of lift, pull and tilt: the axes it is seen in, the sizes estimated along, and the column of its gain.

    A state (n,) holds those sizes, the gain, the ground's lift in Cheeseman and Bennett's, and the cells of the map.
    First row: with the model; second: without it.
    """

    axes: tuple[int, ...]
    along: tuple[int, ...]
    own: int
    mean: Array
    """(2, n) before anything is seen."""
    covariance: Array
    """(2, n, n)."""
    variance: Array
    """(2, n): its diagonal."""
    growth_1_s: Array
    """(2, n): of the variances."""

    @property
    def gain(self) -> int:
        """Place of the gain in a state; the ground's lift and the cells follow."""
        return len(self.along)


class Belief(NamedTuple):
    """What is believed of one channel: ``mean`` (2, n) and ``covariance`` (2, n, n) as in ``Channel``, and the odds."""

    mean: Array
    covariance: Array
    log_odds: float
    """Of the model against none."""
    surprised: tuple[int, ...]
    """For how many blocks in a row each axis has been far off to one side of both."""
    waited_s: float = 0.0
    """Since something was taken in."""

    @property
    def probability(self) -> float:
        """Of the model."""
        return 1.0 / (1.0 + math.exp(-self.log_odds))


@lru_cache(maxsize=8)
def channels_of(table: tuple[Size, ...]) -> tuple[Channel, ...]:
    """Lift, pull and tilt."""
    return tuple([_channel(table, own) for own in (at.LIFT, at.PULL, at.TILT)])


def _channel(table: tuple[Size, ...], own: int) -> Channel:
    along = _ALONG[own]
    calm = [_CALM_WIND if k in _WIND and own == at.PULL else 1.0 for k in along]
    steady = [table[k].mean - table[k].as_modelled for k in along]
    sds = [table[k].sd for k in along]
    a_minute = [table[k].per_minute * share for k, share in zip(along, calm, strict=True)]
    if own == at.LIFT:
        form = _GROUND_SD
    else:
        form = 0.0
    n = len(along) + 2 + CELLS
    mean = np.zeros((2, n))
    covariance = np.zeros((2, n, n))
    growth = np.zeros((2, n))
    for k, (gain, sd, ground, near) in enumerate(
        ((table[own].mean, table[own].sd, 0.0, _LEFT_SD[own]), (0.0, 0.0, form, _MAP_SD[own]))
    ):
        cell = MAP.covariance(near, of_wall=own != at.LIFT)
        mean[k, : n - CELLS] = [*steady, gain, 0.0]
        np.fill_diagonal(
            covariance[k], [*[s * s for s in sds], sd * sd, ground * ground, *[0.0] * CELLS]
        )
        covariance[k, n - CELLS :, n - CELLS :] = cell
        moves = [
            *a_minute,
            _DRIFT * sd,
            _DRIFT * ground,
            *(_DRIFT * np.sqrt(np.diagonal(cell))).tolist(),
        ]
        growth[k] = np.square(moves) / 60.0
    variance = np.array([np.diagonal(c) for c in covariance])
    return Channel(
        axes=_AXES[own],
        along=along,
        own=own,
        mean=mean,
        covariance=covariance,
        variance=variance,
        growth_1_s=growth,
    )


def initial(channel: Channel) -> Belief:
    """Before anything is seen in this flight."""
    return Belief(channel.mean, channel.covariance, 0.0, (0,) * len(channel.axes))


@dataclass(frozen=True, slots=True)
class Place:
    """What a unit of every cell and of Cheeseman and Bennett's lift does with the fans where they are [N]."""

    weights: Array
    form: float
    towards: tuple[float, float]
    """The wall in body x and y."""


def place_of(around: FanPlaces) -> Place:
    """The fans' place on the map."""
    weights = [0.0] * CELLS
    form = 0.0
    for height, gap, thrust in zip(around.heights, around.gaps, around.free_lift_n, strict=True):
        form += thrust * cheeseman_bennett(height)
        for k, weight in MAP.cells(height, gap):
            weights[k] += weight * thrust
    return Place(
        np.array(weights), form, (math.cos(around.bearing_rad), math.sin(around.bearing_rad))
    )


def rows(
    channel: Channel,
    regressors: Sequence[Sequence[float]],
    place: Place,
    radius_m: float,
    thrust_scale: float = 1.0,
) -> list[Array]:
    """What a state adds to each axis of the channel: shape (n,) each. Ground and wall act on the true thrust."""
    c, s = place.towards
    along = (c, s, -1.0, s * radius_m, -c * radius_m)
    first = channel.gain
    if channel.own == at.LIFT:
        form = -place.form * thrust_scale
    else:
        form = 0.0
    out = []
    for axis in channel.axes:
        seen = regressors[axis]
        row = np.empty(first + 2 + CELLS)
        row[: first + 2] = [
            *[seen[k] for k in channel.along],
            seen[channel.own] * thrust_scale,
            form,
        ]
        np.multiply(place.weights, along[axis] * thrust_scale, out=row[first + 2 :])
        out.append(row)
    return out


def learn(
    channel: Channel, judged: Belief, seconds: float, seen: Sequence[tuple[float, Array, float]]
) -> Belief:
    """One block on: (value, row, variance) of each axis of the channel; an axis that is not a number tells nothing."""
    covariance = judged.covariance.copy()
    diagonal = covariance.reshape(2, -1)[:, :: covariance.shape[1] + 1]
    # No variance grows beyond that before any flight.
    diagonal += np.minimum(
        channel.growth_1_s * seconds, np.maximum(channel.variance - diagonal, 0.0)
    )
    mean = judged.mean
    log_odds = judged.log_odds
    surprised = []
    sigmas = ROBUST_SIGMAS
    most = ROBUST_SIGMAS**2
    for (value, row, variance), before in zip(seen, judged.surprised, strict=True):
        if not math.isfinite(value) or not variance > 0.0:
            surprised.append(0)
            continue
        shared = covariance @ row
        (e, f), (s, t) = (mean @ row).tolist(), (shared @ row).tolist()
        i = value - e
        j = value - f
        s = s + variance
        t = t + variance
        y = abs(i) / math.sqrt(s)
        z = abs(j) / math.sqrt(t)
        if y > sigmas:
            v = sigmas / y
        else:
            v = 1.0
        if z > sigmas:
            w = sigmas / z
        else:
            w = 1.0
        if y > sigmas and z > sigmas and i * j > 0.0:
            mean = _jumped(channel, mean, covariance, shared, ((i, s, v), (j, t, w)))
            if i > 0.0:
                side = 1
            else:
                side = -1
            surprised.append(before + side if before * side > 0 else side)
            continue
        # Joseph's form with a gain that is Huber's weight, ``v`` and ``w``, of the best: one product, symmetric to the
        # last bit.
        root = math.sqrt((2.0 - v) * v / s)
        other = math.sqrt((2.0 - w) * w / t)
        by_mean, by_covariance = np.array((((i * v / s,), (j * w / t,)), ((root,), (other,))))
        mean = mean + by_mean * shared
        shared *= by_covariance
        covariance -= shared[:, :, None] * shared[:, None, :]
        likelier = 0.5 * math.log(t / s) + min(0.5 * z * z, most) - min(0.5 * y * y, most)
        log_odds += _EVIDENCE * likelier
        surprised.append(0)
    if mean is not judged.mean:
        mean[0, channel.gain] = min(max(float(mean[0, channel.gain]), 0.0), MOST)
    if max(surprised) >= SURPRISED_BLOCKS or min(surprised) <= -SURPRISED_BLOCKS:
        covariance = _opened(channel, covariance)
    log_odds = min(max(log_odds, -_MOST_LOG_ODDS), _MOST_LOG_ODDS)
    return Belief(mean, covariance, log_odds, tuple(surprised))


def _jumped(
    channel: Channel,
    mean: Array,
    covariance: Array,
    shared: Array,
    seen: tuple[tuple[float, float, float], ...],
) -> Array:
    """The mean after something that came at once, which is no surface: a load, a hand, a gust; ``covariance`` becomes
    what it then is. ``seen``: innovation, its variance, and weight, of both hypotheses.

    Joseph's form, which is right for any gain: here that of the gain on the model, the ground and the map is zero.
    """
    innovation, spread, weight = np.array(seen).T[:, :, None]
    gain = weight / spread * shared
    gain[:, channel.gain :] = 0.0
    half = gain[:, :, None] * (shared - 0.5 * spread * gain)[:, None, :]
    covariance -= half + half.transpose(0, 2, 1)
    out: Array = mean + innovation * gain
    return out


def _opened(channel: Channel, covariance: Array) -> Array:
    """Less sure of what is steady: a load, a gust front, something that shifts in a bay."""
    out = covariance.copy()
    for k in range(channel.gain):
        more = np.maximum(channel.variance[:, k] - out[:, k, k], 0.0)
        out[:, k, k] += np.minimum(_OPENED * channel.variance[:, k], more)
    return out


def believed(channel: Channel, judged: Belief) -> tuple[float, float, list[float]]:
    """Gain on the model, the ground's lift in Cheeseman and Bennett's, and the map (CELLS,): both hypotheses' mean."""
    p = judged.probability
    gain = channel.gain
    mixed = (p * judged.mean[0] + (1.0 - p) * judged.mean[1]).tolist()
    return mixed[gain], mixed[gain + 1], mixed[gain + 2 :]


def ground_measured(channel: Channel, judged: Belief) -> tuple[float, float]:
    """The ground's lift 1.6 radii above it, in Cheeseman and Bennett's, as measured without a model; and its sd."""
    row = np.zeros(channel.mean.shape[1])
    row[channel.gain + 1] = 1.0
    for k, weight in MAP.cells(_LOW_RADII, math.inf):
        row[channel.gain + 2 + k] = weight / cheeseman_bennett(_LOW_RADII)
    variance = float(row @ judged.covariance[1] @ row)
    return float(row @ judged.mean[1]), math.sqrt(max(variance, 0.0))
