"""The hold beside a wall whose pull grows towards it: how steep a pull the loop holds.

A pull a(d) makes the level plant x'' = u + k x, with the stiffness k = -da/dd > 0 [1/s^2]: 1 / (s^2 - k) instead of
1 / s^2. The characteristic function is affine in k, F(s) = A(s) - k B(s), without poles. Its roots right of the line
s = -sigma + j omega are counted by its phase along the line (Mikhailov's criterion, for quasi-polynomials of retarded
type: Bellman and Cooke, Differential-Difference Equations, 1963, chapter 12). Where k grows from 0, the first root
crosses the line at the least k = A / B > 0 that is real (D-decomposition: Neimark 1949).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from companion.control.plant import (
    FULL,
    SHARES,
    TILT_LEAD_SHARE,
    TILT_MEAN_S,
    AttitudeLoop,
    Frequencies,
    HoldGains,
    HoldTuning,
    Margin,
    horizontal_loop,
    margin_of,
    soften,
)
from companion.disturbance.wall_law import WallLaw
from models.common.frozen_copy import with_changes

DECAY_1_S = 0.1
"""Wanted: whatever a nudge leaves dies out at least so fast, to a third within ten seconds."""
_BESIDE_WALL = Margin(gain=1.4, phase_deg=12.0)
"""Enough there: softer gains have more phase and are drawn to the wall."""
_SOFTEST = 0.35
"""Share of the full gains: softer, the hold is refused."""
_ALONG = np.concatenate([np.arange(1e-4, 20.0, 0.02), np.geomspace(20.0, 400.0, 150)])
"""rad/s: from beside the pole at 0, fine where roots may be, on to where only the poles count."""
_DEGREE = 6
"""Of F: two lags, the integral, place and velocity, the mean of the tilt."""


def beside_wall(tuned: HoldTuning, softer: float, law: WallLaw, lip_m: float) -> HoldTuning:
    """``tuned`` for free air as it is flown beside a wall that the nearest lip is, or is sent to, ``lip_m`` from.

    The gains stay where they hold the pull. Otherwise they are the hardest with a margin of ``_BESIDE_WALL`` that hold
    it, or those that hold most. ``least_wall_m``: nearer, none hold it.
    """
    own = stiffness_held(tuned.gains, tuned.loop, tuned.age_s)
    if own >= law.steepest(0.0):
        return tuned
    choices = _choices(tuned.loop, tuned.age_s, softer, tuned.climb_share)
    most = max([own, *(choice.held_1_s2 for choice in choices)])
    least_m = law.least_m(most)
    needed = min(law.steepest(max(lip_m, least_m)), most)
    tuned = with_changes(tuned, least_wall_m=least_m)
    if own >= needed:
        return tuned
    chosen = next(choice for choice in choices if choice.held_1_s2 >= needed)
    phase_deg = min(tuned.margin.phase_deg, chosen.margin.phase_deg)
    margin = Margin(min(tuned.margin.gain, chosen.margin.gain), phase_deg)
    return with_changes(tuned, gains=chosen.gains, margin=margin, share=chosen.share)


class Choice(NamedTuple):
    """Gains, the margin that they have in free air, and the steepest pull that they hold."""

    share: float
    gains: HoldGains
    margin: Margin
    held_1_s2: float


@lru_cache(maxsize=16)
def _choices(
    loop: AttitudeLoop, age_s: float, softer: float, climb_share: float
) -> tuple[Choice, ...]:
    """From hard to soft, those with a margin of ``_BESIDE_WALL``."""
    led = with_changes(FULL, tilt_lead_s=TILT_LEAD_SHARE * loop.lag_s)
    out = []
    for share in SHARES:
        gains = soften(led, share * softer, climb_share)
        margin = margin_of(horizontal_loop(gains, loop, age_s))
        if share * softer >= _SOFTEST and margin.meets(_BESIDE_WALL):
            held = stiffness_held(gains, loop, age_s)
            out.append(Choice(share * softer, gains, margin, held))
    return tuple(out)


@lru_cache(maxsize=512)
def stiffness_held(gains: HoldGains, loop: AttitudeLoop, age_s: float) -> float:
    """The steepest pull [1/s^2] beside which every root has a real part below -``DECAY_1_S``.

    0 where even free air has a slower root; infinite where no pull takes that away.
    """
    if roots_right_of(-DECAY_1_S, gains, loop, age_s) > 0:
        return 0.0
    s = -DECAY_1_S + 1j * _ALONG
    free = _characteristic(s, gains, loop, age_s, 0.0)
    change = free - _characteristic(s, gains, loop, age_s, 1.0)
    k = free / change
    real = k.real
    across = np.flatnonzero(k.imag[1:] * k.imag[:-1] < 0.0)
    share = k.imag[across] / (k.imag[across] - k.imag[across + 1])
    crossings = [float(real[0]), *(real[across] + share * (real[across + 1] - real[across]))]
    return min([crossing for crossing in crossings if crossing > 0.0], default=math.inf)


def roots_right_of(
    real_1_s: float,
    gains: HoldGains,
    loop: AttitudeLoop,
    age_s: float,
    stiffness_1_s2: float = 0.0,
) -> int:
    """How many roots of the closed loop have a real part above ``real_1_s``."""
    values = _characteristic(real_1_s + 1j * _ALONG, gains, loop, age_s, stiffness_1_s2)
    turned = float(np.sum(np.angle(values[1:] / values[:-1])))
    return round(0.5 * _DEGREE - turned / math.pi)


def _characteristic(
    s: Frequencies, gains: HoldGains, loop: AttitudeLoop, age_s: float, stiffness_1_s2: float
) -> Frequencies:
    """F(s): 1 + L(s), times the poles of the open loop L."""
    poles = s * (s**2 - stiffness_1_s2) * (1.0 + s * loop.tau_s) ** 2 * (1.0 + s * TILT_MEAN_S)
    out: Frequencies = poles * (1.0 + horizontal_loop(gains, loop, age_s, s, stiffness_1_s2))
    return out
