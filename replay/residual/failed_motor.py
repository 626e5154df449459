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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from models.common.frames import GRAVITY, Array
from models.effects import Context
from models.vehicle import Vehicle
from replay.residual.grid import Mask, rate_of_change
from replay.residual.motion import Trajectory
from replay.residual.motion_faults import UPSIDE_DOWN

TRUST = 0.5
"""Power of the likelihood, as in the search: forms are not exact (Miller & Dunson 2019, JASA 114, 1113)."""
BEFORE_S = 3.0
AFTER_S = 3.0
LATER_S = 10.0
"""Time before, which gives the level; after, when a beginning is looked for; and after, when one is judged."""
TUMBLING_S = 0.6
"""Evidence after the vehicle has turned over: later its fall changes every rotor's thrust."""
MOSTLY = 0.8
"""Share of the time before a beginning that has to be flight."""
FEWEST = 3
"""Samples after the beginning: 0.3 s, in which a vehicle with a stopped motor turns over."""
LEAST_SHARE = 0.2
"""Smallest loss that is looked for: unequal propellers differ by less (0.1 is usual: ``fan_imbalance``)."""
FORM = 0.15
"""Error of declared moments, as a share of what differs between the motors: thrust curves and lag."""
LATE_S = 0.03
"""By which thrust may be off in time: a motor's lag."""
BY_SPEED = np.array([0.01, 0.01, 0.045])
"""By which moments and lift change with the speed [1 / (m/s)]: flapping, and inflow at a tip speed of 100 m/s."""
COMMON = np.array([0.0, 0.0, 0.06])
BENT = 0.1
"""What all rotors lose together is no motor's: a pack that sags, a climb (lift); and the thrust curve's slope."""
LEAST_NOISE = np.array([0.004, 0.004, 0.01])
"""Of roll, pitch and lift: no vehicle is steadier over seconds."""
RAMP = np.array([0.35, 0.85])
RAMP_DOUBT = 0.3
"""Share of a loss in the first two rows, through the low-pass and the motor's lag, and how sure it is."""
GAIN_SD = 0.3
GAIN_SD_ASSUMED = 0.6
"""Of log G: moments of inertia by the size of the vehicle; and with arms that are assumed."""
PUSHED = 0.25
STRUCK = 0.5
"""Standard deviations of a push and of blows, over weight and lever."""
IMPACT_G = 1.2
IMPACT_SIGMA = 6.0
"""Specific force beside the declared lift from which on something was struck: rotors and drag give less; and over its
usual size in this flight."""
SINCE_IMPACT_S = 1.0
"""So long after an impact nothing begins that an impact did not begin."""
CHANCE = 0.01
"""Prior probability that a motor fails in a flight that is asked about."""
CHANCE_OF_FALL = 0.2
"""And that it is why one turns over within seconds."""
SURE = 3.0
APART = 4.6
"""Log odds of a failure against none, and of one motor against another, to be said: 20 and 100 to 1."""
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
SLOWEST_GYRO_HZ = 9.0
"""A gyro from which on three samples are three."""
_GAINS = np.exp(np.linspace(-1.0, 1.0, 9))
_BY_AXIS = np.stack([_GAINS, _GAINS, np.ones(len(_GAINS))], axis=1)
"""The inertia does not change the lift."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Motors, one of which gives ``share`` less from ``since_s`` on (indices of fans); log odds against none."""

    fans: tuple[int, ...]
    since_s: float
    share: float
    share_sd: float
    log_odds: float
    explains: float
    """Share of what is left after the beginning that the loss removes."""

    @property
    def probability(self) -> float:
        """Of the failure against none: p = 1 / (1 + exp(-log odds))."""
        return float(expit(self.log_odds))


@dataclass(frozen=True, kw_only=True)
class _Signals:
    """Rows of 0.1 s: measured (n, 3) roll, pitch, lift; declared (n, fans, 3) by motor; all over weight and lever."""

    time_s: Array
    step_s: float
    measured: Array
    by_fan: Array
    declared: Array
    doubt: Array
    """Standard deviation (n, 3) of what the declared moments are off by their form."""
    velocity: Array
    """(n, 3) [m/s], body axes; zero where the log says nothing."""
    good: Mask
    struck: Mask
    over: Mask
    """Turned over."""
    flying: Mask


def failed_motor(ctx: Context, motion: Trajectory, flying: Mask) -> Failure | None:
    """The motor that fails in this flight, or two of which one does; None where nothing says so surely."""
    if not places_known(ctx.vehicle) or motion.gyro_hz < SLOWEST_GYRO_HZ:
        return None
    signals = evidence_of(ctx, motion, flying)
    noise = _noise(signals)
    if noise is None:
        return None
    if "position_m" in ctx.vehicle.assumed:
        gain_sd = GAIN_SD_ASSUMED
    else:
        gain_sd = GAIN_SD
    prior = -0.5 * (np.log(_GAINS) / gain_sd) ** 2
    prior -= np.log(np.exp(prior).sum())
    return _failure(signals, noise, prior)


def places_known(vehicle: Vehicle) -> bool:
    """Whether motors are told apart by how they turn the vehicle."""
    return len(vehicle.fans) > 2 and "order" not in vehicle.assumed


def evidence_until(ctx: Context, motion: Trajectory, flying: Mask) -> float:
    """When [s] the first impact comes, or the vehicle has turned over: what follows says nothing of a motor."""
    signals = evidence_of(ctx, motion, flying)
    aloft = np.cumsum(signals.flying) * signals.step_s > BEFORE_S
    hit = np.flatnonzero(signals.struck & aloft)
    over = np.flatnonzero(signals.over & aloft)
    if hit.size:
        ends = [signals.time_s[hit[0]]]
    else:
        ends = []
    ends += [signals.time_s[over[0]] + TUMBLING_S] if over.size else []
    return float(min(ends, default=np.inf))


def evidence_of(ctx: Context, motion: Trajectory, flying: Mask) -> _Signals:
    """What a flight shows of its rotors: measured and declared moments and lift, by rows of 0.1 s."""
    grid = motion.grid
    unit = ctx.weight * ctx.lever
    inertia = np.array(ctx.vehicle.inertia_kgm2)
    spin_up = rate_of_change(motion.gyro, grid.rate)
    turning = spin_up * inertia + np.cross(motion.gyro, motion.gyro * inertia)
    lift = -motion.force[:, 2] / GRAVITY
    measured = grid.smooth(np.column_stack([turning[:, :2] / unit, lift]))
    thrust = grid.smooth(ctx.thrust / ctx.weight)
    arms = np.asarray(ctx.vehicle.fan_positions_m) / ctx.lever
    effect = np.stack([-arms[:, 1], arms[:, 0], np.ones(len(arms))], axis=1)
    by_fan = thrust[:, :, None] * effect
    declared = by_fan.sum(axis=1)
    step_s = grid.every / grid.rate
    # Less lift than declared is no blow: a rotor may turn without its propeller.
    above = lift * GRAVITY - ctx.thrust.sum(axis=1) / ctx.vehicle.mass_kg
    upward = np.maximum(np.maximum(above, motion.force[:, 2]), 0.0)
    size = np.hypot(upward, np.linalg.norm(motion.force[:, :2], axis=1))
    # A blow may fall between two samples of the accelerometer: the velocity has changed unfelt.
    unfelt = np.linalg.norm(motion.kinematic_bias, axis=1)
    hit = _blows(size, flying) | _blows(unfelt, flying)
    with np.errstate(invalid="ignore"):
        over = motion.rotation[:, 2, 2] < UPSIDE_DOWN
    apart = np.abs(thrust - thrust.mean(axis=1, keepdims=True))
    form = FORM * np.sqrt(((apart[:, :, None] * effect) ** 2).sum(axis=1))
    late = LATE_S * np.abs(np.gradient(declared, step_s, axis=0))
    form[:, 2] = np.hypot(form[:, 2], BENT * np.abs(declared[:, 2] - 1.0))
    doubt = np.hypot(form, late)
    # Beside a gap the slope of what is declared is unknown, too.
    good = (
        np.isfinite(measured).all(axis=1)
        & np.isfinite(declared).all(axis=1)
        & np.isfinite(doubt).all(axis=1)
    )
    return _Signals(
        time_s=grid.t[:: grid.every],
        step_s=step_s,
        measured=measured,
        by_fan=by_fan,
        declared=declared,
        doubt=doubt,
        velocity=np.nan_to_num(grid.smooth(ctx.velocity)),
        good=good,
        struck=_in_blocks(hit, grid.every, len(measured)),
        over=_in_blocks(over, grid.every, len(measured)),
        flying=flying[:: grid.every],
    )


def _blows(size: Array, flying: Mask) -> Mask:
    """Where an acceleration (n,) [m/s^2] is that of an impact: more than a vehicle has, and than is usual here."""
    known = flying & np.isfinite(size)
    if not known.any():
        return np.zeros(len(size), bool)
    least = max(IMPACT_G * GRAVITY, IMPACT_SIGMA * float(np.median(size[known])))
    with np.errstate(invalid="ignore"):
        return np.asarray(size > least)


def _in_blocks(mask: Mask, every: int, count: int) -> Mask:
    """Whether it holds anywhere in the samples about each row."""
    padded = np.convolve(mask.astype(float), np.ones(every), "same") > 0.5
    return np.asarray(padded[::every][:count])


@dataclass(frozen=True)
class _Noise:
    """Standard deviations (3,): of a sample, and of the mean of one stretch against the one before."""

    fast: Array
    slow: Array


def _noise(signals: _Signals) -> _Noise | None:
    """As the flight itself shows it; None where it is too short to say."""
    left = signals.measured - signals.declared
    usable = signals.good & signals.flying & ~signals.over
    span = round(BEFORE_S / signals.step_s)
    if usable.sum() < 2 * span:
        return None
    left = np.where(usable[:, None], left, np.nan)
    fast = _spread(np.diff(left, axis=0)) / np.sqrt(2.0)
    kernel = np.ones(span) / span
    mean = np.stack([np.convolve(left[:, j], kernel, "valid") for j in range(3)], axis=1)
    change = mean[span:] - mean[:-span]
    known = np.isfinite(change).all(axis=1)
    if known.sum() < span:
        return None
    return _Noise(np.maximum(fast, LEAST_NOISE), np.maximum(_spread(change[known]), LEAST_NOISE))


def _spread(x: Array) -> Array:
    """Standard deviation (3,) of (n, 3) by the middle and by what is usually exceeded: tails count once."""
    middle, most = np.nanpercentile(np.abs(x), (50.0, 90.0), axis=0)
    return np.asarray(np.maximum(1.4826 * middle, most / 1.645))


@dataclass(frozen=True)
class _Compared:
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

    rows: NDArray[np.int_]
    left: Array
    var: Array
    slow: Array
    earlier: Array
    """Log likelihood (gains,) of the rows before."""
    ramp: Array
    doubt: Array

    def by_motor(self, signals: _Signals) -> tuple[Array, Array]:
        """What motors are declared to give (fans, gains, n, 3), and the variances beside their losses.

        Variances: (fans, n, 3).
        """
        given = signals.by_fan[self.rows].swapaxes(0, 1) * self.ramp[:, None]
        return _BY_AXIS[:, None] * given[:, None], self.var + (self.doubt[:, None] * given) ** 2


def _after(signals: _Signals, noise: _Noise, start: int, begin: int, end: int) -> _After | None:
    """Rows ``begin`` to ``end`` about the level of ``start`` to ``begin``; None where there are too few."""
    before = np.flatnonzero(signals.good[start:begin]) + start
    after = np.flatnonzero(signals.good[begin:end]) + begin
    if len(before) < 0.5 * BEFORE_S / signals.step_s or len(after) < FEWEST:
        return None
    level_a = signals.measured[before].mean(axis=0)
    level_m = signals.declared[before].mean(axis=0)
    moved = signals.measured[after] - level_a
    demanded = signals.declared[after] - level_m
    faster = np.linalg.norm(signals.velocity[after] - signals.velocity[before].mean(axis=0), axis=1)
    ramp = np.ones(len(after))
    ramp[: len(RAMP)] = RAMP
    doubt = np.zeros(len(after))
    doubt[: len(RAMP)] = RAMP_DOUBT
    var = noise.fast**2 + signals.doubt[after] ** 2 + (0.5 * BY_SPEED * faster[:, None]) ** 2
    # What is left drifts: late samples repeat each other, and are off by as much as stretches of this flight differ.
    age_s = (after - begin) * signals.step_s
    drift = np.minimum(age_s / DRIFTS_S, 1.0)
    var = var + (drift[:, None] * noise.slow) ** 2
    return _After(
        rows=after,
        left=moved[None] - _BY_AXIS[:, None] * demanded[None],
        var=var,
        slow=noise.slow**2 + COMMON**2 + (BY_SPEED * float(np.sqrt((faster**2).mean()))) ** 2,
        earlier=_before(signals, noise, before, level_a, level_m),
        ramp=ramp,
        doubt=doubt,
    )


def _compare(
    signals: _Signals, noise: _Noise, prior: Array, start: int, begin: int, end: int
) -> _Compared | None:
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
    lost = [_sum(each) for each in _evidence(rest, var, after.slow) + prior]
    return _Compared(np.array(lost), _sum(none), _sum(pushed), _sum(struck))


@dataclass(frozen=True)
class _Loss:
    """Share of its thrust that a motor loses, and the share of what is left that this explains."""

    share: float
    share_sd: float
    explains: float


def _stands(
    signals: _Signals, noise: _Noise, prior: Array, start: int, begin: int, end: int, k: int
) -> _Loss | None:
    """The loss, where it explains most of what follows: all within its noise, and no part better without it.

    A motor that failed does not recover; what does was a manoeuvre, or a blow.
    """
    after = _after(signals, noise, start, begin, end)
    if after is None:
        return None
    gone, var = (by_motor[k] for by_motor in after.by_motor(signals))
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
        mine = _evidence(rest[best : best + 1, rows], var[rows], after.slow)
        others = _evidence(after.left[free : free + 1, rows], after.var[rows], after.slow)
        if float(others[0] - mine[0]) > RECOVERS:
            return None
    before = float((after.left[best] ** 2 / var).sum())
    left = float((rest[best] ** 2 / var).sum())
    explains = 1.0 - left / max(before, 1e-12)
    if explains < LEAST_EXPLAINED:
        return None
    # Inertia that is off makes the loss by as much larger or smaller: all gains count by their posterior.
    weight = np.exp(each - _sum(each))
    mean = float(weight @ share)
    variance = float(weight @ (spread**2 + (share - mean) ** 2))
    return _Loss(share=mean, share_sd=float(np.sqrt(variance)), explains=explains)


def _before(
    signals: _Signals, noise: _Noise, rows: NDArray[np.int_], level_a: Array, level_m: Array
) -> Array:
    """Log likelihood (gains,) of the rows before a beginning, about their own mean."""
    moved = signals.measured[rows] - level_a
    demanded = signals.declared[rows] - level_m
    left = moved[None] - _BY_AXIS[:, None] * demanded[None]
    var = noise.fast**2 + signals.doubt[rows] ** 2
    return _evidence(left, var, noise.slow**2)


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


def _sum(logs: Array) -> float:
    top = float(logs.max())
    return top + float(np.log(np.exp(logs - top).sum()))


def _last(signals: _Signals, begin: int, longest_s: float) -> int:
    """Row after the last one that is evidence of what began at ``begin``."""
    end = min(begin + round(longest_s / signals.step_s), len(signals.time_s))
    hit = np.flatnonzero(signals.struck[begin:end])
    if hit.size:
        end = min(end, begin + int(hit[0]))
    over = np.flatnonzero(signals.over[begin:end])
    if over.size:
        end = min(end, begin + int(over[0]) + round(TUMBLING_S / signals.step_s))
    return end


def _beginnings(signals: _Signals) -> list[int]:
    """Rows at which something may begin: in flight, upright, and not just after an impact."""
    span = round(BEFORE_S / signals.step_s)
    recent = round(SINCE_IMPACT_S / signals.step_s)
    out = []
    for begin in range(span, len(signals.time_s) - FEWEST):
        flown = signals.flying[begin - span : begin].mean() >= MOSTLY
        hit = signals.struck[begin - recent : begin + 1].any()
        over = signals.over[begin - span : begin + 1].any()
        if flown and not hit and not over:
            out.append(begin)
    return out


def _failure(signals: _Signals, noise: _Noise, prior: Array) -> Failure | None:
    """The likeliest failure, where nothing else is about as likely."""
    begins = _beginnings(signals)
    span = round(BEFORE_S / signals.step_s)
    about = None
    most = 0.0
    # Neighbours are about as likely: every second one tells where to look at all of them.
    for begin in begins[::2]:
        end = _last(signals, begin, AFTER_S)
        compared = _compare(signals, noise, prior, begin - span, begin, end)
        if compared is not None and compared.gain > most:
            most = compared.gain
            about = begin
    if about is None:
        return None
    return _about(signals, noise, prior, [b for b in begins if abs(b - about) <= span])


def _about(signals: _Signals, noise: _Noise, prior: Array, begins: Sequence[int]) -> Failure | None:
    """The likeliest failure of all that begin at these rows, over one and the same time."""
    start = max(begins[0] - round(BEFORE_S / signals.step_s), 0)
    end = _last(signals, begins[-1], LATER_S)
    every = {begin: _compare(signals, noise, prior, start, begin, end) for begin in begins}
    rows = [begin for begin, compared in every.items() if compared is not None]
    found = [compared for compared in every.values() if compared is not None]
    if not found:
        return None
    lost = np.array([compared.lost for compared in found])
    # A beginning anywhere here: the mean over its times, for all alike.
    by_fan = np.array([_sum(column) for column in lost.T])
    none = _sum(np.array([compared.none for compared in found]))
    pushed = _sum(np.array([compared.pushed for compared in found]))
    struck = _sum(np.array([compared.struck for compared in found]))
    other = max(pushed, struck)
    windows = max(signals.flying.sum() * signals.step_s / AFTER_S, 1.0)
    shortly_after = begins[-1] + round(AFTER_S / signals.step_s)
    falls = signals.over[begins[0] : min(end, shortly_after) + 1].any()
    rare = float(np.log(CHANCE_OF_FALL if falls else CHANCE / windows))
    order = np.argsort(by_fan)[::-1]
    first = int(order[0])
    mine = float(by_fan[first]) + rare - float(np.log(len(by_fan)))
    odds = mine - max(none, other + rare)
    close = [int(k) for k in order if by_fan[first] - by_fan[k] < APART]
    # Where a flight lacks what the comparison needs, the odds are no number.
    if not odds >= SURE or not 1 <= len(close) <= 2:
        return None
    at = int(lost[:, first].argmax())
    stands = _stands(
        signals=signals, noise=noise, prior=prior, start=start, begin=rows[at], end=end, k=first
    )
    if stands is None:
        return None
    return Failure(
        fans=tuple(sorted(close)),
        since_s=float(signals.time_s[rows[at]]),
        share=stands.share,
        share_sd=stands.share_sd,
        log_odds=odds,
        explains=stands.explains,
    )
