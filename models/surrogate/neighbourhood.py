"""A surrogate about one point a fan, as a polynomial in plain floats: what a hover asks for again and again.

A hovering vehicle asks for nearly the same points 25 times a second. Within ``REACH_M`` of a point the wrench over the
free-air lift is a smooth function of both distances and of the rotor speed. A polynomial through eight points of the
surrogate (quadratic in height, cubic in wall distance, linear in speed) differs from it by less than 0.4 % of the lift
anywhere, and by less than 0.04 % in 98 of 100 places (``tests/models/test_neighbourhood.py``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.frames import Array
from models.surrogate.fan_surrogate import FanSurrogate

STEP_M, SPEED_STEP = 0.02, 0.03
"""Where the surrogate is asked beside the centre: distances, and speed as a share of the centre's."""
REACH_M, SPEED_REACH = 0.015, 0.03
"""How far from the centre a form holds."""
TRUST = 6
"""Place of the trust in a form, behind the six components; without its factor of the speed (``Domain.at_speed``)."""
_MOST_TRUST_CHANGE = 0.05
"""Between the points of one form: where trust changes faster, it has kinks."""
_STEPS = np.array(
    [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 2, 0), (1, 1, 0), (0, 0, 1)], dtype=float
)
"""Points of a form in steps of height, wall distance and speed. Two off walls: for how their pull changes."""

Place = tuple[Sequence[float], Sequence[float]]
"""Height and wall distance of every fan [m]; inf: none."""
Offset = tuple[float, float, float]
"""From a fan's centre: height [m], wall distance [m], speed [rpm]."""


def _fit() -> Array:
    """(8, 8): from values at ``_STEPS`` to the coefficients of 1, x, y, r, x^2, y^2, x y, y^3 in metres and shares."""
    x, y, r = (_STEPS * (STEP_M, STEP_M, SPEED_STEP)).T
    out: Array = np.linalg.inv(np.stack([np.ones_like(x), x, y, r, x * x, y * y, x * y, y**3], axis=1))
    return out


_FIT = _fit()
_BY_SPEED = 3
"""Place of r among the coefficients."""


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """One form a fan. ``centres``: speed [rpm], height [m], wall distance [m] (inf: none)."""

    centres: tuple[tuple[float, float, float], ...]
    forms: tuple[tuple[tuple[float, ...], ...], ...]
    """By fan, for each component over the free-air lift and for the trust: eight coefficients. Empty: not smooth."""

    def offsets(self, rpm: Sequence[float], *places: Place) -> list[list[Offset]] | None:
        """Where every fan is in its neighbourhood, by place; None where one has left it."""
        out = []
        for h_m, d_m in places:
            here = []
            for (rpm0, h0, d0), speed, h, d in zip(self.centres, rpm, h_m, d_m, strict=True):
                # Without a ground or wall both are inf.
                x, y, r = 0.0 if h == h0 else h - h0, 0.0 if d == d0 else d - d0, speed - rpm0
                reach = SPEED_REACH * rpm0
                if not (-REACH_M <= x <= REACH_M and -REACH_M <= y <= REACH_M and -reach <= r <= reach):
                    return None
                here.append((x, y, r))
            out.append(here)
        return out

    def values(self, quantity: int, offsets: Sequence[Offset], further_m: float = 0.0) -> list[float]:
        """A component over the free-air lift, or the trust, of every fan; ``further_m``: so much further off walls."""
        out = []
        for form, (x, y, r) in zip(self.forms, offsets, strict=True):
            one, by_x, by_y, by_r, by_xx, by_yy, by_xy, by_yyy = form[quantity]
            y += further_m
            out.append(one + x * (by_x + by_xx * x + by_xy * y) + y * (by_y + y * (by_yy + y * by_yyy)) + by_r * r)
        return out


def expand(model: FanSurrogate, rpm: Sequence[float], h_m: Sequence[float], d_m: Sequence[float]) -> Neighbourhood:
    """The forms about one point a fan, from one query; without forms where the surrogate is not smooth there.

    It has kinks at the nearest distances of its data, and where trust fades.
    """
    centres, c = tuple(zip(rpm, h_m, d_m, strict=True)), model.coordinates
    if not all([_clear(h, c.h_near) and _clear(d, c.d_near) for _, h, d in centres]):
        return Neighbourhood(centres, ())
    x, y, r = (_STEPS * (STEP_M, STEP_M, SPEED_STEP)).T[:, :, None]
    speeds = np.array(rpm) * (1.0 + r)
    by_speed = model.domain.at_speeds(speeds)
    if not by_speed.all():
        return Neighbourhood(centres, ())
    answer, lift = model.query(np.array(h_m) + x, np.array(d_m) + y, speeds), model.free_air_law.lift(speeds)
    trust = answer.trust / by_speed
    if (np.ptp(trust, axis=0) > _MOST_TRUST_CHANGE).any():
        return Neighbourhood(centres, ())
    shares = np.concatenate([answer.wrench / lift[..., None], trust[..., None]], axis=-1)
    forms = np.einsum("cp,pfq->fqc", _FIT, shares)
    forms[:, :, _BY_SPEED] /= np.array(rpm)[:, None]
    return Neighbourhood(centres, tuple(tuple(map(tuple, fan)) for fan in forms.tolist()))


def _clear(distance_m: float, near_m: float) -> bool:
    """Whether all points lie above 0 and on one side of the nearest data."""
    return math.isinf(distance_m) or (distance_m > STEP_M and abs(distance_m - near_m) > STEP_M)
