"""From what is believed of a size to the share of the model's wrench that is compensated, channel by channel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.adapt_options import AdaptTuning
from companion.adaptation.near_map import NOTHING, NearField
from companion.adaptation.parts import Around, about_cg
from models.frames import Array
from models.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class Applied:
    """What offsets follow: shares of the model's lift, pull, tilt and adopted effects, and what is measured beside."""

    shares: tuple[float, ...]
    near: NearField = NOTHING

    def compensated(self, vehicle: Vehicle, above: Sequence[Sequence[float]], around: Around, effects: Array) -> Array:
        """(6,), body FRD about the CG: what is compensated of ground, wall and adopted effects.

        ``above`` (fans, 6): what the model says of ground and wall at each fan, corner frame, at its lead. Of adopted
        effects, (k, 6), what goes beyond all of them or stays below.
        """
        parts = about_cg(vehicle, self._at_fans(vehicle, above, around), around.bearing_rad)
        total: Array = np.array([a + b + c for a, b, c in zip(*parts, strict=True)])
        if effects.size:
            total += (np.array(self.shares[3:]) - 1.0) @ effects
        return total

    def _at_fans(self, vehicle: Vehicle, above: Sequence[Sequence[float]], around: Around) -> list[tuple[float, ...]]:
        """(fans, 6), corner frame."""
        of_lift, of_pull, of_tilt = self.shares[:3]
        radius = vehicle.rotor_radius_m
        return [
            (
                of_pull * x + pull * thrust,
                of_pull * y,
                of_lift * z + lift * thrust,
                of_tilt * roll,
                of_tilt * pitch + tilt * thrust * radius,
                of_tilt * yaw,
            )
            for (x, y, z, roll, pitch, yaw), (lift, pull, tilt), thrust in zip(
                above, self.near.at_fans(around), around.free_lift_n, strict=True
            )
        ]


def share_of(value: float, sd: float, most: float, form: float) -> float:
    """The share of a modelled wrench to compensate where its size is believed to be ``value`` +- ``sd``: 0 to ``most``.

    value / (1 + (sd/value)^2): Wiener's factor, which makes the expected square of what remains least for a size of
    which as much is unknown (Wiener 1949, Extrapolation of Stationary Time Series), with sd^2 + (form (value - 1))^2 in
    place of sd^2: what is wrong in size is wrong from place to place. A size of the wrong sign gives 0.
    """
    if value <= 0.0:
        return 0.0
    doubt = math.hypot(sd, form * (value - 1.0)) / value
    return min(value / (1.0 + doubt * doubt), most)


def towards(now: Applied, wanted: Applied, dt_s: float, tuning: AdaptTuning) -> Applied:
    """``now`` moved to ``wanted`` within the rates of shares and of what is measured beside the model.

    ``wanted`` itself where it is reached.
    """
    down, up = tuning.take_1_s * dt_s, tuning.give_1_s * dt_s
    shares = tuple(
        min(max(goal, share - down), share + up) for share, goal in zip(now.shares, wanted.shares, strict=True)
    )
    old, new, most = now.near, wanted.near, tuning.map_1_s * dt_s
    near = NearField(
        min(max(new.ground, old.ground - up), old.ground + up),
        _slewed(old.lift, new.lift, most),
        _slewed(old.pull, new.pull, most),
        _slewed(old.tilt, new.tilt, most),
    )
    moved = Applied(shares, near)
    return wanted if moved == wanted else moved


def _slewed(old: Sequence[float], new: Sequence[float], most: float) -> tuple[float, ...]:
    return tuple(
        [
            goal if -most <= goal - value <= most else value + most if goal > value else value - most
            for value, goal in zip(old, new, strict=True)
        ]
    )
