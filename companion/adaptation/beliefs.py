"""From what is measured of the channels to what offsets follow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from companion.adaptation import judge
from companion.adaptation.adaptation import Adaptation
from companion.adaptation.apply import MOST, Applied, share_of
from companion.adaptation.channel import WITHOUT_MODEL, Channel
from companion.adaptation.corner_share import EVERYWHERE, CornerShare, low_covariance
from companion.adaptation.near_map import NearField
from companion.adaptation.sizes import FIRST_EFFECT, GAINS, LIFT, Sizes, channels
from models.common.frames import Array

_NOTHING = 0.05
"""A smaller share of the model is none."""


def believed_of(channels: Sequence[Channel], judged: Sequence[judge.Belief]) -> Applied:
    """Both hypotheses' mean of every channel."""
    found = [judge.believed(c, j) for c, j in zip(channels, judged, strict=True)]
    lift, pull, tilt = [tuple(cells) for _, _, cells in found]
    return Applied(
        tuple([gain for gain, _, _ in found]), NearField(found[LIFT][1], lift, pull, tilt)
    )


def learned_of(known: Adaptation, sizes: Sizes) -> tuple[bool, ...]:
    """A channel is measured once its sd is clearly less than the prior's."""
    known_of = zip(known.learned, channels(known.table), strict=True)
    return tuple([before or sizes.sd(k) < 0.9 * known.table[k].sd for before, k in known_of])


def wanted_of(known: Adaptation) -> Applied:
    """What is believed. An adopted effect that never was excited stays as modelled."""
    gains = known.believed.shares
    near = known.believed.near
    shares = []
    for gain in gains:
        if gain < _NOTHING:
            shares.append(0.0)
        else:
            shares.append(min(gain, MOST))
    for k, seen in zip(
        range(FIRST_EFFECT, len(known.table)), known.learned[len(GAINS) :], strict=True
    ):
        value = known.table[k].as_modelled + float(known.sizes.offset[k])
        shares.append(share_of(value, known.sizes.sd(k)) if seen else 1.0)
    corner = EVERYWHERE
    if True in known.of_walls:
        corner = corner_share(known.channels, known.judged)
    return Applied(tuple(shares), near, corner, known.of_walls)


def corner_share(channels: Sequence[Channel], judged: Sequence[judge.Belief]) -> CornerShare:
    """Of the channels of pull and tilt: ``channels`` and ``judged`` are lift, pull and tilt."""
    _, pull, tilt = [_measured_low(c, j) for c, j in zip(channels, judged, strict=True)]
    return CornerShare(pull, tilt)


def _measured_low(channel: Channel, judged: judge.Belief) -> Array:
    """(LOW, LOW): what is not known of the cells over ground, over the map's variance before the flight."""
    first = channel.gain + 2
    most = float(np.max(channel.variance[WITHOUT_MODEL, first:]))
    return low_covariance(judged.covariance[WITHOUT_MODEL][first:, first:]) / most
