"""From what is believed of a size to the share of the model's wrench that is compensated, channel by channel."""

from __future__ import annotations

import math
from collections.abc import Sequence

from companion.adaptation.options import Adapt, AdaptTuning


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


def wanted_shares(
    adapt: Adapt, values: Sequence[float], sds: Sequence[float], learned: Sequence[bool], tuning: AdaptTuning
) -> tuple[float, ...]:
    """The share of every channel. One that never was excited stays as modelled: without evidence nothing changes."""
    highest = 1.0 if adapt is Adapt.GATE else tuning.most
    return tuple(
        share_of(value, sd, highest, tuning.form) if seen else 1.0
        for value, sd, seen in zip(values, sds, learned, strict=True)
    )


def towards(
    shares: tuple[float, ...], wanted: tuple[float, ...], dt_s: float, tuning: AdaptTuning
) -> tuple[float, ...]:
    """``shares`` moved to ``wanted`` within their rates."""
    down, up = tuning.take_1_s * dt_s, tuning.give_1_s * dt_s
    return tuple(min(max(goal, share - down), share + up) for share, goal in zip(shares, wanted, strict=True))
