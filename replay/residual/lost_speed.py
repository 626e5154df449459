"""A rotor whose speed leaves its output from a time on: it stops, or its ESC has lost step; or telemetry was lost.

Speeds follow outputs: omega^2 = c f(u), with one c for each motor and one parabola f for all. A motor that stands, or
turns far slower than its output asks, while the others follow theirs, gives no thrust; where its output does not rise,
its telemetry was lost instead. A motor whose output falls below what the autopilot gives one in flight was switched
off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import Array
from models.effects import Context
from replay.flightlog import FlightLog
from replay.residual.grid import Mask

SLOW_SHARE = 0.55
"""Speed over what its output asks, below which a motor does not follow: its thrust is below a third."""
FAST_SHARE = 1.25
"""And above which it turns without load: a propeller takes a third of the no-load speed."""
FOLLOWS = (0.7, 1.3)
"""Within which the others do."""
LAG_S = 0.06
LEAST_EXPECTED = 0.35
"""A motor's lag; and the least speed, over the usual, at which a ratio is formed."""
LASTS_S = 0.2
"""Time from which on it counts: three telegrams of an ESC at 10 to 25 Hz, slower than any motor's lag."""
FALLS_S = 1.0
"""So long after a vehicle flew by its lift, it is still in the air."""
STAYS_S = 1.0
MOSTLY = 0.8
"""What comes back within the first was a swing of the outputs; share of that time."""
FASTER_S = 0.3
"""Of a rotor that turns faster: longer than a motor takes to slow down."""
FLOWN_S = 5.0
"""Flight before, by which the law of speed over output is known."""
BELOW = 0.5
"""Share of MOT_SPIN_MIN below which no autopilot drives a motor in flight."""
OUTPUTS = 16
"""Of an autopilot, as records hold them."""
ARDUPILOT = 3
"""MAV_AUTOPILOT."""


@dataclass(frozen=True)
class Lost:
    """Motor (index of its rotor), when [s], and whether it is faster than its output asks, or slower."""

    rotor: int
    since_s: float
    faster: bool


def lost_speed(ctx: Context, flying: Mask, until_s: float) -> Lost | None:
    """The first motor whose speed leaves its output before ``until_s``; None without speeds or outputs in the log."""
    rpm = ctx.state.rpm
    outputs = _outputs_of_rotors(ctx)
    if outputs is None:
        return None
    rate = 1.0 / ctx.state.step_s
    # Where a rotor stops, the declared lift may no longer be that of a flight.
    while_falling = np.ones(round(FALLS_S * rate) + 1)
    aloft = np.convolve(flying, while_falling)[: len(flying)] > 0.5
    seen = np.isfinite(outputs).all(axis=1) & np.isfinite(rpm).all(axis=1)
    seen &= ctx.state.time_s < until_s
    known = aloft & seen
    rows = np.flatnonzero(known)
    # The law is of the whole log, idle on the ground included.
    turning = seen & (rpm > 0.0).all(axis=1)
    if len(rows) < 2.0 * FLOWN_S * rate or not turning.any():
        return None
    expected = _expected(outputs, rpm, turning, rate)
    least = LEAST_EXPECTED * np.median(rpm[known])
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = rpm / np.maximum(expected, least)
    following = np.where(known[:, None] & (ratio > SLOW_SHARE), ratio, np.nan)
    ever_follows = np.isfinite(following).any(axis=0)
    if not ever_follows.all():
        return None  # a speed in another unit, which others notice
    ratio = ratio / np.nanmedian(following, axis=0)
    start = int(rows[0] + FLOWN_S * rate)
    lost = [_lost(ctx, ratio, known, rotor=k, start=start) for k in range(rpm.shape[1])]
    found = [one for one in lost if one is not None]
    return min(found, key=lambda one: one.since_s, default=None)


def _outputs_of_rotors(ctx: Context) -> Array | None:
    """Outputs (n, rotors) of the numbers of the rotors' ESCs; None without speeds or outputs in the log."""
    numbers = [rotor.esc for rotor in ctx.vehicle.rotors]
    if not np.isfinite(ctx.state.rpm).any() or None in numbers:
        return None
    columns = [n - 1 for n in numbers if n is not None and n <= OUTPUTS]
    if len(columns) != ctx.state.rpm.shape[1]:
        return None
    return np.asarray(ctx.state.servo_us[:, columns])


def _expected(outputs: Array, rpm: Array, turning: Mask, rate: float) -> Array:
    """Speeds (n, rotors) that the outputs ask: omega^2 = f(u) behind a lag.

    f is a parabola for all motors: one that fails is one of many.
    """
    u = outputs[turning].ravel()
    squared_speed = rpm[turning].ravel() ** 2
    law = np.polyfit(u, squared_speed, 2)
    squared = np.polyval(law, outputs)
    steady = np.sqrt(np.maximum(squared, 0.0))
    return _lagged(steady, LAG_S * rate)


def _lost(ctx: Context, ratio: Array, known: Mask, *, rotor: int, start: int) -> Lost | None:
    """When a rotor's speed leaves its output after ``start``, by speeds over what outputs ask (n, rotors)."""
    rate = 1.0 / ctx.state.step_s
    rpm = ctx.state.rpm[:, rotor]
    own = ratio[:, rotor]
    others = np.delete(ratio, rotor, axis=1)
    least, most = FOLLOWS
    with np.errstate(invalid="ignore"):
        usual = np.median(others, axis=1)
        follow = (usual > least) & (usual < most) & known
        above_usual = rpm > np.nanmedian(rpm[known])
        slow = (own < SLOW_SHARE) & follow
        fast = (own > FAST_SHARE) & above_usual & follow
    for off, faster, lasts_s in ((slow, False, LASTS_S), (fast, True, FASTER_S)):
        count = max(round(lasts_s * rate), 2)
        first = _first_that_stays(off[start:], follow[start:], count, round(STAYS_S * rate))
        if first is not None:
            return Lost(rotor, float(ctx.state.time_s[start + first]), faster)
    return None


def _first_that_stays(off: Mask, judged: Mask, count: int, following: int) -> int | None:
    """First sample from which on it is off for ``count`` samples, and mostly so in those judged that follow it."""
    for first in np.flatnonzero(_lasting(off, count)).tolist():
        span = slice(first, first + following)
        if off[span].sum() > MOSTLY * judged[span].sum():
            return int(first)
    return None


def _lasting(off: Mask, count: int) -> Mask:
    """Samples (n - count + 1,) from which on something holds for ``count`` samples."""
    return np.asarray(np.convolve(off.astype(float), np.ones(count), "valid") > count - 0.5)


def _lagged(x: Array, samples: float) -> Array:
    """Columns (n, k) through a first-order lag; what is unknown stays as it is."""
    keep = float(np.exp(-1.0 / max(samples, 1e-6)))
    out = x.copy()
    for k in range(1, len(x)):
        before = np.where(np.isfinite(out[k - 1]), out[k - 1], x[k])
        out[k] = keep * before + (1.0 - keep) * x[k]
    return out


def switched_off(log: FlightLog, ctx: Context, flying: Mask, until_s: float) -> Lost | None:
    """The first motor whose output falls below what ArduPilot gives one in flight, while the others fly on.

    In flight that is MOT_SPIN_MIN of the range of pulses at least (AP_MotorsMulticopter::output_to_pwm).
    """
    least = log.parameters.get("MOT_SPIN_MIN", 0.0)
    low_us = log.parameters.get("MOT_PWM_MIN", 0.0)
    range_us = log.parameters.get("MOT_PWM_MAX", 0.0) - low_us
    if log.autopilot != ARDUPILOT or least <= 0.0 or low_us <= 0.0 or range_us <= 0.0:
        return None
    columns = [(rotor.servo or rotor.esc or 1) - 1 for rotor in ctx.vehicle.rotors]
    if max(columns) >= ctx.state.servo_us.shape[1]:
        return None
    t = ctx.state.time_s
    share = (ctx.state.servo_us[:, columns] - low_us) / range_us
    count = max(round(LASTS_S / ctx.state.step_s), 2)
    aloft = flying & (t < until_s)
    for k in range(share.shape[1]):
        others = np.delete(share, k, axis=1)
        with np.errstate(invalid="ignore"):
            off = share[:, k] < BELOW * least
            others_on = others.min(axis=1) > BELOW * least
        alone = off & others_on & aloft
        lasting = _lasting(alone, count)
        if lasting.any():
            return Lost(k, float(t[int(np.argmax(lasting))]), faster=False)
    return None
