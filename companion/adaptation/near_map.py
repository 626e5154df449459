"""What ground and wall do where no model is right: a form from the literature, and a map over height and distance.

The map is bilinear over the logarithms of height and distance to the wall, both in rotor radii; its prior is a Gaussian
process with a squared-exponential kernel (Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, 4.2).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.adaptation.parts import Around, about_cg
from models.frames import Array
from models.vehicle import Vehicle

HEIGHTS = (0.8, 1.13, 1.6, 2.26, 3.2, 4.5)
"""Reference point to ground, rotor radii; the last stands for every greater one."""
GAPS = (0.35, 0.8, 1.6, 4.0)
"""Lip to wall, rotor radii; the last stands for every greater one: there is no wall."""
CELLS = len(HEIGHTS) * len(GAPS)
_LENGTH = 0.5
"""Correlation length of the prior, in logarithms: a factor of 1.65 in distance."""
_NEAR = 2.0
"""Rotor radii: from here on the prior's sd falls with the distance."""
_LOG_HEIGHTS, _LOG_GAPS = tuple(map(math.log, HEIGHTS)), tuple(map(math.log, GAPS))


def cheeseman_bennett(height_radii: float) -> float:
    """Lift that the ground adds, as a share of the lift in free air at equal power: 1 / (1 - (R / 4 z)^2) - 1.

    Cheeseman and Bennett 1955, ARC R&M 3021: a source under the ground. Valid above half a radius; nothing beyond 4.
    """
    if height_radii >= 4.0:
        return 0.0
    q = 1.0 / (4.0 * max(height_radii, 0.5)) ** 2
    return q / (1.0 - q)


def cells(height_radii: float, gap_radii: float) -> list[tuple[int, float]]:
    """Up to four cells around a place and their weights, which add up to 1."""
    across = _between(gap_radii, GAPS, _LOG_GAPS)
    return [
        (row * len(GAPS) + column, a * b)
        for row, a in _between(height_radii, HEIGHTS, _LOG_HEIGHTS)
        for column, b in across
    ]


def _between(value: float, knots: Sequence[float], logs: Sequence[float]) -> tuple[tuple[int, float], ...]:
    if value <= knots[0]:
        return ((0, 1.0),)
    if value >= knots[-1]:
        return ((len(knots) - 1, 1.0),)
    k = bisect_right(knots, value)
    share = (math.log(value) - logs[k - 1]) / (logs[k] - logs[k - 1])
    return (k - 1, 1.0 - share), (k, share)


def prior_covariance(sd: float, *, of_wall: bool) -> Array:
    """(CELLS, CELLS) for a map whose sd is ``sd`` close by; zero in free air, and with ``of_wall`` without a wall."""
    place = np.array([(h, d) for h in _LOG_HEIGHTS for d in _LOG_GAPS])
    apart = ((place[:, None] - place[None]) ** 2).sum(axis=2)
    size = sd * np.minimum(1.0, _NEAR / np.exp(place.min(axis=1)))
    size[-1] = 0.0
    if of_wall:
        size[len(GAPS) - 1 :: len(GAPS)] = 0.0
    out: Array = size[:, None] * size[None] * np.exp(-0.5 * apart / _LENGTH**2)
    return out


@dataclass(frozen=True, slots=True)
class NearField:
    """Forces as shares of a fan's lift in free air, moments over that times the rotor radius.

    ``ground``: times Cheeseman and Bennett's lift. ``lift``, ``pull``, ``tilt``: (CELLS,), lift, attraction to the wall
    and moment that tilts towards it, beyond that and beyond the model's share.
    """

    ground: float
    lift: tuple[float, ...]
    pull: tuple[float, ...]
    tilt: tuple[float, ...]

    def at_fan(self, height_radii: float, gap_radii: float) -> tuple[float, float, float]:
        """Lift, pull and tilt at one fan, as shares."""
        if height_radii >= HEIGHTS[-1] and gap_radii >= GAPS[-1]:
            return 0.0, 0.0, 0.0
        lift, pull, tilt = self.ground * cheeseman_bennett(height_radii), 0.0, 0.0
        for k, weight in cells(height_radii, gap_radii):
            lift += weight * self.lift[k]
            pull += weight * self.pull[k]
            tilt += weight * self.tilt[k]
        return lift, pull, tilt

    def at_fans(self, around: Around) -> list[tuple[float, float, float]]:
        """The same at all fans."""
        return [self.at_fan(height, gap) for height, gap in zip(around.heights, around.gaps, strict=True)]

    def pull_change_n(self, around: Around, further_radii: float) -> float:
        """How much less all fans are drawn to the wall further off [N]."""
        out, pull = 0.0, self.pull
        for thrust, height, gap in zip(around.free_lift_n, around.heights, around.gaps, strict=True):
            if gap < GAPS[-1]:
                rows = _between(height, HEIGHTS, _LOG_HEIGHTS)
                for sign, across in ((thrust, gap), (-thrust, gap + further_radii)):
                    columns = _between(across, GAPS, _LOG_GAPS)
                    out += sign * sum([a * b * pull[i * len(GAPS) + k] for i, a in rows for k, b in columns])
        return out

    def rows(self, vehicle: Vehicle, around: Around) -> list[list[float]]:
        """Lift, pull and tilt (3, 6) of all fans, body FRD about the CG."""
        radius = vehicle.rotor_radius_m
        at_fans = [
            (pull * thrust, 0.0, lift * thrust, 0.0, tilt * thrust * radius, 0.0)
            for thrust, (lift, pull, tilt) in zip(around.free_lift_n, self.at_fans(around), strict=True)
        ]
        return about_cg(vehicle, at_fans, around.bearing_rad)


NOTHING = NearField(0.0, (0.0,) * CELLS, (0.0,) * CELLS, (0.0,) * CELLS)
"""Before anything is measured."""
