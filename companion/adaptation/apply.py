"""From what is believed of a size to the share of the model's wrench that is compensated, channel by channel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.adaptation.corner_share import EVERYWHERE, CornerShare
from companion.adaptation.near_map import NOTHING, NearField
from companion.disturbance.about_cg import about_cg
from companion.disturbance.records import FanPlaces
from models.common.frames import Array
from models.vehicle import Vehicle

MOST = 1.5
"""Of the model's wrench, in any channel."""
GIVE_1_S = 0.25
"""How fast a channel's share may grow: from nothing to all in four seconds, slower than the hold's integrators."""
_TAKE_1_S = 1.0
"""How fast it may shrink: a fade like others."""
_MAP_1_S = 0.02
"""How fast what is applied of the map may change, of a fan's thrust: 0.08 in four seconds, as shares grow."""
_FORM = 0.5
"""A model whose size is wrong is wrong in form too: sd of the gain from place to place, by its distance from 1."""


@dataclass(frozen=True, slots=True)
class Applied:
    """What offsets follow: shares of the model's lift, pull, tilt and adopted effects, and what is measured beside."""

    shares: tuple[float, ...]
    near: NearField = NOTHING
    corner: CornerShare = EVERYWHERE
    """Of the adopted effects that know only walls."""
    of_walls: tuple[bool, ...] = ()
    """Which of the adopted effects these are."""

    def compensated(
        self, vehicle: Vehicle, above: Sequence[Sequence[float]], around: FanPlaces, effects: Array
    ) -> Array:
        """(6,), body FRD about the CG: what is compensated of ground, wall and adopted effects.

        ``above`` (fans, 6): what the model says of ground and wall at each fan, corner frame, at its lead. Of adopted
        effects, (k, 6), what goes beyond all of them or stays below.
        """
        of_lift, of_pull, of_tilt = self.shares[:3]
        shares = (of_pull, of_pull, of_lift, of_tilt, of_tilt, of_tilt)
        at_fans = []
        for fan, beside in zip(above, self.near.wrenches(vehicle, around), strict=True):
            at_fans.append(
                [
                    share * modelled + left
                    for share, modelled, left in zip(shares, fan, beside, strict=True)
                ]
            )
        parts = about_cg(vehicle, at_fans, around.bearing_rad)
        total: Array = np.array([a + b + c for a, b, c in zip(*parts, strict=True)])
        if effects.size:
            total += (np.array(self.shares[3:]) - 1.0) @ effects
        if True in self.of_walls:
            missing = 1.0 - self.corner.of_wrench(around)
            for share, wrench, of_wall in zip(self.shares[3:], effects, self.of_walls, strict=True):
                if of_wall:
                    total -= missing * share * wrench
        return total

    def pull_change_n(self, modelled_n: float, around: FanPlaces, step_radii: float) -> float:
        """How much weaker the pull to the wall gets ``step_radii`` further off [N]; ``modelled_n`` by the model."""
        beside_model = self.near.pull_change_n(around, step_radii)
        return self.shares[1] * modelled_n + beside_model


def share_of(value: float, sd: float) -> float:
    """The share of a modelled wrench to compensate where its size is believed to be ``value`` +- ``sd``: 0 to ``MOST``.

    value / (1 + (sd/value)^2): Wiener's factor, which makes the expected square of what remains least for a size of
    which as much is unknown (Wiener 1949, Extrapolation of Stationary Time Series), with sd^2 + (_FORM (value - 1))^2
    in place of sd^2: what is wrong in size is wrong from place to place. A size of the wrong sign gives 0.
    """
    if value <= 0.0:
        return 0.0
    doubt = math.hypot(sd, _FORM * (value - 1.0)) / value
    return min(value / (1.0 + doubt * doubt), MOST)


def towards(now: Applied, wanted: Applied, dt_s: float) -> Applied:
    """``now`` moved to ``wanted`` within the rates of shares and of what is measured beside the model.

    ``wanted`` itself where it is reached.
    """
    down = _TAKE_1_S * dt_s
    up = GIVE_1_S * dt_s
    shares = tuple(
        min(max(goal, share - down), share + up)
        for share, goal in zip(now.shares, wanted.shares, strict=True)
    )
    old = now.near
    new = wanted.near
    most = _MAP_1_S * dt_s
    near = NearField(
        min(max(new.ground, old.ground - up), old.ground + up),
        _slewed(old.lift, new.lift, most),
        _slewed(old.pull, new.pull, most),
        _slewed(old.tilt, new.tilt, most),
    )
    corner = now.corner.moved(wanted.corner, up)
    moved = replace(wanted, shares=shares, near=near, corner=corner)
    if moved == wanted:
        return wanted
    return moved


def _slewed(old: Sequence[float], new: Sequence[float], most: float) -> tuple[float, ...]:
    return tuple(
        [
            goal
            if -most <= goal - value <= most
            else value + most
            if goal > value
            else value - most
            for value, goal in zip(old, new, strict=True)
        ]
    )
