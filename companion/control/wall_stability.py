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

import numpy as np

from companion.control.plant import (
    TILT_MEAN_S,
    AttitudeLoop,
    Frequencies,
    HoldGains,
    HoldTuning,
    horizontal_loop,
)
from companion.disturbance.wall_law import WallLaw
from models.common.frozen_copy import with_changes

DECAY_1_S = 0.1
"""Wanted: whatever a nudge leaves dies out at least so fast, to a third within ten seconds."""
_ALONG = np.concatenate([np.arange(1e-4, 20.0, 0.02), np.geomspace(20.0, 400.0, 150)])
"""rad/s: from beside the pole at 0, fine where roots may be, on to where only the poles count."""
_DEGREE = 6
"""Of F: two lags, the integral, place and velocity, the mean of the tilt."""


def beside_wall(tuned: HoldTuning, law: WallLaw) -> HoldTuning:
    """``tuned`` with the least distance from a wall at which it holds its pull: 0 where it holds it at any."""
    held_1_s2 = stiffness_held(tuned.gains, tuned.loop, tuned.age_s)
    return with_changes(tuned, least_wall_m=law.least_m(held_1_s2))


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
