"""Lift, pull and tilt as states of a filter: what each holds, what it is worth before a flight, and what it does where.

Two hypotheses share the state. ``WITH_MODEL``: ground and wall act as the model says, times a gain, but for a small map
of what is left. ``WITHOUT_MODEL``: there is no model, and a large map and the ground's lift by Cheeseman and Bennett
hold all. What steady things add is estimated along in both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from companion.adaptation import sizes as at
from companion.adaptation.near_map import CELLS, MAP, cheeseman_bennett
from companion.adaptation.sizes import Size
from companion.disturbance.records import FanPlaces
from models.common.frames import Array

WITH_MODEL = 0
WITHOUT_MODEL = 1
"""Rows of every array that holds both hypotheses."""
_ALONG = ((at.THRUST, at.INFLOW), (at.NORTH, at.EAST, at.DRAG), (at.CG_X, at.CG_Y, at.DRAG_ARM))
_AXES = ((2,), (0, 1), (3, 4))
_WIND = (at.NORTH, at.EAST)
_MAP_SD = (0.05, 0.02, 0.05)
"""Prior sd of what is measured of lift, pull (of a fan's thrust) and tilt (of that times the radius) without a model,
within two rotor radii: of lift and tilt half of the largest that is published, of pull most of it
(Ai et al. 2020; docs/lab/adaptation.md)."""
_LEFT_SD = (0.015, 0.004, 0.015)
"""The same of what a right model leaves: its law is 10 to 30 % off."""
_GROUND_SD = 1.0
"""Prior sd of the ground's lift in Cheeseman and Bennett's; its mean is 0, so that nothing is applied unseen."""
_DRIFT = 0.3
"""Change of gain, ground's lift and map in a minute, of their prior sd."""
_CALM_WIND = 0.25
"""Change of the wind in a minute while the pull is judged, of what it may change otherwise: a gust is a jump."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One of lift, pull and tilt: the axes it is seen in, the sizes estimated along, and the column of its gain.

    A state (n,) holds those sizes, the gain, the ground's lift in Cheeseman and Bennett's, and the cells of the map.
    Arrays hold a row for each hypothesis, ``WITH_MODEL`` and ``WITHOUT_MODEL``.
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


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What one hypothesis believes of ground and wall before a flight."""

    gain: float
    """On the model."""
    gain_sd: float
    ground_sd: float
    """Of the ground's lift, whose mean is 0."""
    map_sd: float
    """Of a cell of the map, whose mean is 0."""


@dataclass(frozen=True, slots=True)
class Steady:
    """What both believe of the sizes that are estimated along: means, standard deviations, and change in a minute."""

    mean: list[float]
    sd: list[float]
    per_minute: list[float]


@lru_cache(maxsize=8)
def channels_of(table: tuple[Size, ...]) -> tuple[Channel, ...]:
    """Lift, pull and tilt."""
    return tuple([_channel(table, own) for own in (at.LIFT, at.PULL, at.TILT)])


def _channel(table: tuple[Size, ...], own: int) -> Channel:
    along = _ALONG[own]
    if own == at.LIFT:
        ground_sd = _GROUND_SD
    else:
        ground_sd = 0.0
    steady = _steady(table, own)
    right = Hypothesis(table[own].mean, table[own].sd, 0.0, _LEFT_SD[own])
    none = Hypothesis(0.0, 0.0, ground_sd, _MAP_SD[own])
    priors = [_prior(one, steady, of_wall=own != at.LIFT) for one in (right, none)]
    mean, covariance, growth_1_s = (np.stack(both) for both in zip(*priors, strict=True))
    return Channel(
        axes=_AXES[own],
        along=along,
        own=own,
        mean=mean,
        covariance=covariance,
        variance=np.array([np.diagonal(one) for one in covariance]),
        growth_1_s=growth_1_s,
    )


def _steady(table: tuple[Size, ...], own: int) -> Steady:
    sizes = [table[k] for k in _ALONG[own]]
    per_minute = []
    for k, size in zip(_ALONG[own], sizes, strict=True):
        if own == at.PULL and k in _WIND:
            per_minute.append(size.per_minute * _CALM_WIND)
        else:
            per_minute.append(size.per_minute)
    return Steady(
        [size.mean - size.as_modelled for size in sizes], [size.sd for size in sizes], per_minute
    )


def _prior(here: Hypothesis, steady: Steady, *, of_wall: bool) -> tuple[Array, Array, Array]:
    """Mean (n,), covariance (n, n) and growth of the variances in a second (n,)."""
    cells = MAP.covariance(here.map_sd, of_wall=of_wall)
    sds = [*steady.sd, here.gain_sd, here.ground_sd]
    known = len(sds)
    mean = np.zeros(known + CELLS)
    mean[:known] = [*steady.mean, here.gain, 0.0]
    covariance = np.zeros((known + CELLS, known + CELLS))
    np.fill_diagonal(covariance, [*[sd * sd for sd in sds], *[0.0] * CELLS])
    covariance[known:, known:] = cells
    per_minute = [
        *steady.per_minute,
        _DRIFT * here.gain_sd,
        _DRIFT * here.ground_sd,
        *(_DRIFT * np.sqrt(np.diagonal(cells))).tolist(),
    ]
    return mean, covariance, np.square(per_minute) / 60.0


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
    wall_x, wall_y = place.towards
    by_axis = (wall_x, wall_y, -1.0, wall_y * radius_m, -wall_x * radius_m)
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
        np.multiply(place.weights, by_axis[axis] * thrust_scale, out=row[first + 2 :])
        out.append(row)
    return out
