"""A motor that gives less thrust from a time on, by how the vehicle turns and sinks; or something else, or nothing.

At each time t of a flight these are compared, on the seconds after it, with the mean of the seconds before as level:

    none      a = G M + b                        as before
    lost k    a = G (M - s m_k) + b              motor k gives the share s less, 0.2 to 1
    pushed    a = G M + b + c                    a constant push: a gust, a load that shifts or drops
    struck    a = anything of that size          an impact, the ground, a wall

a: measured roll and pitch moment over weight and lever, and lift over the weight. M: the same by the thrusts that
outputs or rotor speeds declare, m_k what motor k is declared to give. G: what the moments of inertia are off, with a
log-normal prior. All are Gaussian; the likelihood counts by ``TRUST``. What an impact follows is no evidence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array
from replay.residual.motor_signals import BEFORE_S, Noise, Signals

TRUST = 0.5
"""Power of the likelihood, as in the search: forms are not exact (Miller & Dunson 2019, JASA 114, 1113)."""
FEWEST = 3
"""Samples after the beginning: 0.3 s, in which a vehicle with a stopped motor turns over."""
LEAST_SHARE = 0.2
"""Smallest loss that is looked for: unequal propellers differ by less (0.1 is usual: ``fan_imbalance``)."""
BY_SPEED = np.array([0.01, 0.01, 0.045])
"""By which moments and lift change with the speed [1 / (m/s)]: flapping, and inflow at a tip speed of 100 m/s."""
RAMP = np.array([0.35, 0.85])
RAMP_DOUBT = 0.3
"""Share of a loss in the first two rows, through the low-pass and the motor's lag, and how sure it is."""
PUSHED = 0.25
STRUCK = 0.5
"""Standard deviations of a push and of blows, over weight and lever."""
DRIFTS_S = 0.5
"""Over which what is left of a flight hangs together."""
WORST_MISFIT = 2.5
"""Mean square over the variance above which a loss does not explain what follows."""
LEAST_EXPLAINED = 0.5
"""Share of what is left after a beginning that a loss has to remove. Real losses in simulated flights remove 0.96 or
more; a steady lean after a take-off removed nothing: its level before was that on the ground."""
PART_S = 0.5
RECOVERS = 2.0
"""Parts of what follows, and log likelihood by which one may be better without the loss."""
COMMON = np.array([0.0, 0.0, 0.06])
"""What all rotors lose together is no motor's: a pack that sags, a climb (lift)."""
GAINS = np.exp(np.linspace(-1.0, 1.0, 9))
_BY_AXIS = np.stack([GAINS, GAINS, np.ones(len(GAINS))], axis=1)
"""The inertia does not change the lift."""
Rows = NDArray[np.int_]


@dataclass(frozen=True)
class Compared:
    """Log likelihoods on the rows after a beginning: by motor, and of what else there is."""

    lost: Array
    none: float
    pushed: float
    struck: float

    @property
    def gain(self) -> float:
        """Of the likeliest motor over all else."""
        return float(self.lost.max()) - max(self.none, self.pushed, self.struck)


@dataclass(frozen=True, kw_only=True)
class _After:
    """Rows after a beginning: what is left without a failure (gains, n, 3), its variances, and the rows' numbers."""

    rows: Rows
    left: Array
    var: Array
    slow: Array
    earlier: Array
    """Log likelihood (gains,) of the rows before."""
    ramp: Array
    doubt: Array

    def by_motor(self, signals: Signals) -> tuple[Array, Array]:
        """What motors are declared to give (fans, gains, n, 3), and the variances beside their losses.

        Variances: (fans, n, 3).
        """
        given = signals.by_fan[self.rows].swapaxes(0, 1) * self.ramp[:, None]
        by_gain = _BY_AXIS[:, None] * given[:, None]
        doubt = self.doubt[:, None] * given
        return by_gain, self.var + doubt**2


def _after(signals: Signals, noise: Noise, start: int, begin: int, end: int) -> _After | None:
    """Rows ``begin`` to ``end`` about the level of ``start`` to ``begin``; None where there are too few."""
    before = np.flatnonzero(signals.good[start:begin]) + start
    after = np.flatnonzero(signals.good[begin:end]) + begin
    if len(before) < 0.5 * BEFORE_S / signals.step_s or len(after) < FEWEST:
        return None
    usual_velocity = signals.velocity[before].mean(axis=0)
    faster = np.linalg.norm(signals.velocity[after] - usual_velocity, axis=1)
    ramp = np.ones(len(after))
    ramp[: len(RAMP)] = RAMP
    doubt = np.zeros(len(after))
    doubt[: len(RAMP)] = RAMP_DOUBT
    by_speed = 0.5 * BY_SPEED * faster[:, None]
    var = noise.fast**2 + signals.doubt[after] ** 2 + by_speed**2
    # What is left drifts: late samples repeat each other, and are off by as much as stretches of this flight differ.
    age_s = (after - begin) * signals.step_s
    drift = np.minimum(age_s / DRIFTS_S, 1.0)
    var = var + (drift[:, None] * noise.slow) ** 2
    rms_faster = float(np.sqrt((faster**2).mean()))
    var_before = noise.fast**2 + signals.doubt[before] ** 2
    left_before = _left(signals, before, before)
    return _After(
        rows=after,
        left=_left(signals, after, before),
        var=var,
        slow=noise.slow**2 + COMMON**2 + (BY_SPEED * rms_faster) ** 2,
        earlier=_evidence(left_before, var_before, noise.slow**2),
        ramp=ramp,
        doubt=doubt,
    )


def _left(signals: Signals, rows: Rows, level: Rows) -> Array:
    """What is left (gains, n, 3) of some rows without a failure, about the mean of the rows of the ``level``."""
    moved = signals.measured[rows] - signals.measured[level].mean(axis=0)
    demanded = signals.declared[rows] - signals.declared[level].mean(axis=0)
    return np.asarray(moved[None] - _BY_AXIS[:, None] * demanded[None])


def compare(
    signals: Signals, noise: Noise, prior: Array, *, start: int, begin: int, end: int
) -> Compared | None:
    """Rows ``begin`` to ``end`` against ``start`` to ``begin``, which are as before under all of these."""
    after = _after(signals, noise, start, begin, end)
    if after is None:
        return None
    prior = prior + after.earlier
    wide = after.slow + PUSHED**2
    none = _evidence(after.left, after.var, after.slow) + prior
    pushed = _evidence(after.left, after.var, wide) + prior
    struck = _evidence(after.left, after.var + STRUCK**2, after.slow) + prior
    gone, var = after.by_motor(signals)
    var = var[:, None]
    share, _ = _share(after.left, gone, var, after.slow)
    rest = after.left + share[..., None, None] * gone
    lost = [log_sum(each) for each in _evidence(rest, var, after.slow) + prior]
    return Compared(np.array(lost), log_sum(none), log_sum(pushed), log_sum(struck))


@dataclass(frozen=True)
class Loss:
    """Share of its thrust that a motor loses, and the share of what is left that this explains."""

    share: float
    share_sd: float
    explains: float


def loss_that_explains(
    signals: Signals, noise: Noise, prior: Array, *, start: int, begin: int, end: int, motor: int
) -> Loss | None:
    """The loss, where it explains most of what follows: all within its noise, and no part better without it.

    A motor that failed does not recover; what does was a manoeuvre, or a blow.
    """
    after = _after(signals, noise, start, begin, end)
    if after is None:
        return None
    given, variances = after.by_motor(signals)
    gone = given[motor]
    var = variances[motor]
    share, spread = _share(after.left, gone, var, after.slow)
    rest = after.left + share[:, None, None] * gone
    each = _evidence(rest, var, after.slow) + after.earlier + prior
    best = int(each.argmax())
    misfit = float((rest[best] ** 2 / (var + after.slow)).mean())
    if misfit > WORST_MISFIT:
        return None
    without = _evidence(after.left, after.var, after.slow) + after.earlier + prior
    free = int(without.argmax())
    part = max(round(PART_S / signals.step_s), FEWEST)
    for first in range(0, len(after.rows), part):
        rows = slice(first, first + part)
        with_loss = _evidence(rest[best, rows], var[rows], after.slow)
        without_loss = _evidence(after.left[free, rows], after.var[rows], after.slow)
        if float(without_loss - with_loss) > RECOVERS:
            return None
    before = float((after.left[best] ** 2 / var).sum())
    left = float((rest[best] ** 2 / var).sum())
    explains = 1.0 - left / max(before, 1e-12)
    if explains < LEAST_EXPLAINED:
        return None
    # Inertia that is off makes the loss by as much larger or smaller: all gains count by their posterior.
    probability = np.exp(each - log_sum(each))
    mean = float(probability @ share)
    squares = spread**2 + (share - mean) ** 2
    variance = float(probability @ squares)
    return Loss(share=mean, share_sd=float(np.sqrt(variance)), explains=explains)


def _evidence(left: Array, var: Array, slow: Array) -> Array:
    """Log likelihood (..., gains) of what is left (..., gains, n, 3).

    White noise of variance ``var`` (..., n, 3) and one offset of variance ``slow``.
    """
    weight = 1.0 / var
    square = (left**2 * weight).sum(axis=-2)
    mean = (left * weight).sum(axis=-2)
    total = weight.sum(axis=-2)
    square -= mean**2 * slow / (1.0 + slow * total)
    log_det = np.log(var).sum(axis=-2) + np.log1p(slow * total)
    return np.asarray(-0.5 * TRUST * (square + log_det).sum(axis=-1))


def _share(left: Array, gone: Array, var: Array, slow: Array) -> tuple[Array, Array]:
    """Likeliest share (..., gains) within its bounds, and its standard deviation."""
    weight = 1.0 / var
    total = weight.sum(axis=-2)
    shrink = slow / (1.0 + slow * total)
    gone_mean = (gone * weight).sum(axis=-2)
    cross = (left * gone * weight).sum(axis=-2)
    cross -= (left * weight).sum(axis=-2) * gone_mean * shrink
    own = (gone**2 * weight).sum(axis=-2)
    own -= gone_mean**2 * shrink
    known = np.maximum(own.sum(axis=-1), 1e-12)
    share = np.clip(-cross.sum(axis=-1) / known, LEAST_SHARE, 1.0)
    return np.asarray(share), np.asarray(1.0 / np.sqrt(TRUST * known))


def log_sum(logs: Array) -> float:
    """Log of the sum of exp(``logs``)."""
    top = float(logs.max())
    return top + float(np.log(np.exp(logs - top).sum()))
