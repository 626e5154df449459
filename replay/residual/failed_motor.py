"""The motor that fails in a flight: beginnings of a loss are looked for, and the likeliest is judged.

What is compared, and by which likelihood: motor_loss.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from models.common.frames import Array
from models.effects import Context
from models.vehicle import Vehicle
from replay.residual.grid import Mask
from replay.residual.motion import Trajectory
from replay.residual.motor_loss import FEWEST, GAINS, compare, log_sum, loss_that_explains
from replay.residual.motor_signals import (
    BEFORE_S,
    TUMBLING_S,
    Noise,
    Signals,
    evidence_of,
    noise_of,
)

AFTER_S = 3.0
LATER_S = 10.0
"""Time after a beginning [s]: when one is looked for, and when it is judged."""
MOSTLY = 0.8
"""Share of the time before a beginning that has to be flight."""
GAIN_SD = 0.3
GAIN_SD_ASSUMED = 0.6
"""Of log G: moments of inertia by the size of the vehicle; and with arms that are assumed."""
SINCE_IMPACT_S = 1.0
"""So long after an impact nothing begins that an impact did not begin."""
CHANCE = 0.01
"""Prior probability that a motor fails in a flight that is asked about."""
CHANCE_OF_FALL = 0.2
"""And that it is why one turns over within seconds."""
SURE = 3.0
APART = 4.6
"""Log odds of a failure against none, and of one motor against another, to be said: 20 and 100 to 1."""
SLOWEST_GYRO_HZ = 9.0
"""A gyro from which on three samples are three."""


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


def failed_motor(ctx: Context, motion: Trajectory, flying: Mask) -> Failure | None:
    """The motor that fails in this flight, or two of which one does; None where nothing says so surely."""
    if not places_known(ctx.vehicle) or motion.gyro_hz < SLOWEST_GYRO_HZ:
        return None
    signals = evidence_of(ctx, motion, flying)
    noise = noise_of(signals)
    if noise is None:
        return None
    if "position_m" in ctx.vehicle.assumed:
        gain_sd = GAIN_SD_ASSUMED
    else:
        gain_sd = GAIN_SD
    prior = -0.5 * (np.log(GAINS) / gain_sd) ** 2
    prior -= np.log(np.exp(prior).sum())
    return _failure(signals, noise, prior)


def places_known(vehicle: Vehicle) -> bool:
    """Whether motors are told apart by how they turn the vehicle."""
    return len(vehicle.fans) > 2 and "order" not in vehicle.assumed


def _last(signals: Signals, begin: int, longest_s: float) -> int:
    """Row after the last one that is evidence of what began at ``begin``."""
    end = min(begin + round(longest_s / signals.step_s), len(signals.time_s))
    hit = np.flatnonzero(signals.struck[begin:end])
    if hit.size:
        end = min(end, begin + int(hit[0]))
    over = np.flatnonzero(signals.over[begin:end])
    if over.size:
        end = min(end, begin + int(over[0]) + round(TUMBLING_S / signals.step_s))
    return end


def _beginnings(signals: Signals) -> list[int]:
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


def _failure(signals: Signals, noise: Noise, prior: Array) -> Failure | None:
    """The likeliest failure, where nothing else is about as likely."""
    begins = _beginnings(signals)
    span = round(BEFORE_S / signals.step_s)
    about = None
    most = 0.0
    # Neighbours are about as likely: every second one tells where to look at all of them.
    for begin in begins[::2]:
        end = _last(signals, begin, AFTER_S)
        compared = compare(signals, noise, prior, start=begin - span, begin=begin, end=end)
        if compared is not None and compared.gain > most:
            most = compared.gain
            about = begin
    if about is None:
        return None
    near = [begin for begin in begins if abs(begin - about) <= span]
    return _about(signals, noise, prior, near)


def _about(signals: Signals, noise: Noise, prior: Array, begins: Sequence[int]) -> Failure | None:
    """The likeliest failure of all that begin at these rows, over one and the same time."""
    start = max(begins[0] - round(BEFORE_S / signals.step_s), 0)
    end = _last(signals, begins[-1], LATER_S)
    found = {}
    for begin in begins:
        compared = compare(signals, noise, prior, start=start, begin=begin, end=end)
        if compared is not None:
            found[begin] = compared
    if not found:
        return None
    lost = np.array([compared.lost for compared in found.values()])
    # A beginning anywhere here: the mean over its times, for all alike.
    by_fan = np.array([log_sum(of_fan) for of_fan in lost.T])
    none = log_sum(np.array([compared.none for compared in found.values()]))
    pushed = log_sum(np.array([compared.pushed for compared in found.values()]))
    struck = log_sum(np.array([compared.struck for compared in found.values()]))
    log_chance = _log_chance(signals, begins, end)
    order = np.argsort(by_fan)[::-1]
    first = int(order[0])
    mine = float(by_fan[first]) + log_chance - float(np.log(len(by_fan)))
    odds = mine - max(none, max(pushed, struck) + log_chance)
    close = [int(k) for k in order if by_fan[first] - by_fan[k] < APART]
    # Where a flight lacks what the comparison needs, the odds are no number.
    if not odds >= SURE or not 1 <= len(close) <= 2:
        return None
    likeliest = int(lost[:, first].argmax())
    begin = list(found)[likeliest]
    loss = loss_that_explains(signals, noise, prior, start=start, begin=begin, end=end, motor=first)
    if loss is None:
        return None
    return Failure(
        fans=tuple(sorted(close)),
        since_s=float(signals.time_s[begin]),
        share=loss.share,
        share_sd=loss.share_sd,
        log_odds=odds,
        explains=loss.explains,
    )


def _log_chance(signals: Signals, begins: Sequence[int], end: int) -> float:
    """Log prior that something happens at these rows: larger where the vehicle turns over shortly after."""
    shortly_after = begins[-1] + round(AFTER_S / signals.step_s)
    last = min(end, shortly_after)
    if signals.over[begins[0] : last + 1].any():
        return float(np.log(CHANCE_OF_FALL))
    windows = max(signals.flying.sum() * signals.step_s / AFTER_S, 1.0)
    return float(np.log(CHANCE / windows))
