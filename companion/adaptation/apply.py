"""From what is believed of a size to the share of the model's wrench that is compensated, channel by channel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.adaptation.near_map import NOTHING, NearField
from companion.adaptation.options import AdaptTuning
from companion.adaptation.parts import Around
from models.frames import Array
from models.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class Applied:
    """What offsets follow: shares of the model's lift, pull, tilt and adopted effects, and what is measured beside."""

    shares: tuple[float, ...]
    near: NearField = NOTHING
    gate: bool = False
    """Whether offsets may only become smaller than the model's."""

    def change(self, vehicle: Vehicle, ahead: Sequence[Sequence[float]], around: Around, effects: Array) -> list[float]:
        """(6,): what is compensated minus what is modelled, body FRD about the CG.

        ``ahead``: the model's lift, pull and tilt (3, 6) at their leads; ``effects`` (k, 6).
        """
        out = [0.0] * 6
        for share, modelled, beside in zip(self.shares, ahead, self.near.rows(vehicle, around), strict=False):
            if self.gate:
                # The part of what is measured that points as the model does, and no more than the model.
                size = sum([a * a for a in modelled])
                along = sum([a * b for a, b in zip(modelled, beside, strict=True)]) / size if size > 1e-12 else 0.0
                kept = min(max(share + along, 0.0), 1.0) - 1.0
                out = [v + kept * a for v, a in zip(out, modelled, strict=True)]
            else:
                out = [v + (share - 1.0) * a + b for v, a, b in zip(out, modelled, beside, strict=True)]
        if len(effects):
            more = (np.array(self.shares[3:]) - 1.0) @ effects
            out = [v + a for v, a in zip(out, more.tolist(), strict=True)]
        return out


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
    """``now`` moved to ``wanted`` within the rates of shares and of what is measured beside the model."""
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
    return Applied(shares, near, wanted.gate)


def _slewed(old: Sequence[float], new: Sequence[float], most: float) -> tuple[float, ...]:
    return tuple([min(max(goal, value - most), value + most) for value, goal in zip(old, new, strict=True)])
