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
    numbers = [rotor.esc for rotor in ctx.vehicle.rotors]
    if not np.isfinite(rpm).any() or None in numbers:
        return None
    outputs = ctx.state.servo_us[:, [n - 1 for n in numbers if n is not None and n <= 16]]
    if outputs.shape[1] != rpm.shape[1]:
        return None
    rate = 1.0 / ctx.state.step_s
    # Where a rotor stops, the declared lift may no longer be that of a flight.
    aloft = np.convolve(flying, np.ones(round(FALLS_S * rate) + 1))[: len(flying)] > 0.5
    seen = np.isfinite(outputs).all(axis=1) & np.isfinite(rpm).all(axis=1)
    seen &= ctx.state.time_s < until_s
    known = aloft & seen
    first = np.flatnonzero(known)
    if len(first) < 2.0 * FLOWN_S * rate:
        return None
    # A law of all motors and of the whole log, idle on the ground included: one that fails is one of many, and late.
    turning = seen & (rpm > 0.0).all(axis=1)
    if not turning.any():
        return None
    law = np.polyfit(outputs[turning].ravel(), rpm[turning].ravel() ** 2, 2)
    squared = np.polyval(law, outputs)
    expected = _lagged(np.sqrt(np.maximum(squared, 0.0)), LAG_S * rate)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = rpm / np.maximum(expected, LEAST_EXPECTED * np.median(rpm[known]))
    following = np.where(known[:, None] & (ratio > SLOW_SHARE), ratio, np.nan)
    ratio = ratio / np.nanmedian(following, axis=0)
    start = int(first[0] + FLOWN_S * rate)
    lost = []
    for k in range(rpm.shape[1]):
        found = _leaves(ctx, ratio, known, k, start, rate)
        if found is not None:
            lost.append(found)
    return min(lost, key=lambda found: found.since_s, default=None)


def _leaves(
    ctx: Context, ratio: Array, known: Mask, k: int, start: int, rate: float
) -> Lost | None:
    others = np.delete(ratio, k, axis=1)
    with np.errstate(invalid="ignore"):
        usual = np.median(others, axis=1)
        follow = (usual > FOLLOWS[0]) & (usual < FOLLOWS[1]) & known
        slow = (ratio[:, k] < SLOW_SHARE) & follow
        rpm = ctx.state.rpm[:, k]
        above_usual = rpm > np.nanmedian(rpm[known])
        fast = (ratio[:, k] > FAST_SHARE) & above_usual & follow
    for off, faster, lasts_s in ((slow, False, LASTS_S), (fast, True, FASTER_S)):
        count = max(round(lasts_s * rate), 2)
        stays = _stays(off[start:], follow[start:], count, round(STAYS_S * rate))
        if stays is not None:
            return Lost(k, float(ctx.state.time_s[start + stays]), faster)
    return None


def _stays(off: Mask, judged: Mask, count: int, later: int) -> int | None:
    """First sample from which on it is off for ``count`` samples, and mostly so in those judged of the ``later``."""
    for first in np.flatnonzero(_lasting(off, count)).tolist():
        span = slice(first, first + later)
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
            alone = (share[:, k] < BELOW * least) & (others.min(axis=1) > BELOW * least) & aloft
        lasting = _lasting(alone, count)
        if lasting.any():
            return Lost(k, float(t[int(np.argmax(lasting))]), faster=False)
    return None
