"""Hops of decimetres: feet that touch again and again, or a vehicle that is tipped, are no flight.

Where no sensor sees the ground, a vehicle that takes off, never rises by half a metre, and does not stay clear of the
ground for long, may touch it all the time. If it lands hard, stands in between, or leans on something, it does.
"""

from __future__ import annotations

import numpy as np

from models.common.frames import GRAVITY, Array
from models.common.runs import runs_of
from models.effects import Context
from replay.residual.grid import Mask, running_mean
from replay.residual.motion import ENOUGH_S, Trajectory

NOT_CLEAR = (
    "did not fly long enough clear of the ground to judge: it touches, or is tipped, and never "
    "rises by half a metre"
)
ROSE_M = 0.5
CLEAR_M = 0.1
"""Change of height that proves a flight, and one above which feet that stay there for long do not touch."""
SANK_M = 1.5
"""Change of height downwards that proves a flight. On a bench the rotors' wash raises the pressure, and the height
seems to sink by up to 0.8 m."""
SPUN_UP = 0.5
"""Share of the usual lift above which a run does not begin on the ground, and what moves may be in the air."""
SMOOTH_S = 0.1
REST_S = 0.25
SLOW_S = 0.5
"""Half widths of the means over noise, over the time in which a vehicle rests that stands, and of its height."""
STILL_RAD_S = 0.02
STILL_G = 0.01
"""Rate of turning, and change of the felt force, of what stands. The calmest half second of 13 measured flights of nano
quadrotors within half a metre turns by 0.022 rad/s; what stands with turning rotors by 0.002 to 0.015."""
STOOD_S = 1.0
LESS = 0.92
AS_MUCH = 0.9
"""Time for which a vehicle stands; shares of the usual lift below which that is less, and above which it is as much."""
LEANS_G = 0.1
HARD_G = 1.8
"""Force across the rotors' axis that no drag of less than 8 m/s of wind makes, and any force of a landing."""
TURNS_G = 1.2
"""A vehicle that feels more for half of the time flies turns. On the ground it feels its weight, and more in blows."""


def hops(ctx: Context, motion: Trajectory, turning: Mask) -> Mask:
    """Samples (n,) of the runs of the rotors ``turning`` (n,) in which the vehicle hops, or is tipped."""
    out = np.zeros(len(turning), bool)
    still = _still(motion)
    lift = ctx.thrust.sum(axis=1)
    for run in runs_of(turning):
        begins_in_air = lift[run.start] > SPUN_UP * np.nanmedian(lift[run])
        if begins_in_air or np.isfinite(ctx.state.h_m[run]).any():
            continue
        rate = motion.grid.rate
        if not stays_low(motion.position[run, 2], rate):
            continue
        if touches(still[run], lift[run], motion.force[run] / GRAVITY, rate):
            out[run] = True
    return out


def stays_low(down: Array, rate: float) -> bool:
    """Whether a run of the rotors is known to stay low, and not to stay clear of the ground for long.

    ``down`` (m,): place along the axis down [m], NaN where unknown, ``rate`` [Hz]. What sinks far flew, too.
    """
    known = np.isfinite(down)
    if not known.any():
        return False
    rise = down[known][0] - running_mean(down, round(SLOW_S * rate))
    if np.nanmax(rise) > ROSE_M or np.nanmin(rise) < -SANK_M:
        return False
    longest = max((run.stop - run.start for run in runs_of(rise > CLEAR_M)), default=0)
    return bool(longest < ENOUGH_S * rate)


def _still(motion: Trajectory) -> Mask:
    """Samples (n,) around which the vehicle neither turns nor feels a change."""
    half = round(SMOOTH_S * motion.grid.rate)
    around = round(REST_S * motion.grid.rate)
    gyro = _mean(motion.gyro, half)
    force = _mean(motion.force, half)
    change = force - _mean(force, around)
    with np.errstate(invalid="ignore"):
        calm = running_mean((gyro**2).sum(axis=1), around) < STILL_RAD_S**2
        even = running_mean((change**2).sum(axis=1), around) < (STILL_G * GRAVITY) ** 2
    return np.asarray(calm & even)


def touches(still: Mask, lift: Array, felt: Array, rate: float) -> bool:
    """Whether in a run (m,) of the rotors a vehicle stands, lands hard before its end, or leans.

    A calm hover may look still, but its lift is that of the rest of the flight. Wind makes a vehicle lean, but not
    one that stands with the same lift. ``felt`` (m, 3): force over the weight.
    """
    moving = np.flatnonzero(~still & (lift > SPUN_UP * np.nanmedian(lift)))
    if not moving.size:
        return bool(still.sum() > STOOD_S * rate)
    usual = float(np.nanmedian(lift[moving]))
    between = slice(moving[0], moving[-1])
    stands = (still[between] & (lift[between] < LESS * usual)).sum() > STOOD_S * rate
    size = np.sqrt((felt[between] ** 2).sum(axis=1))
    if np.nanmedian(size) > TURNS_G:
        return False
    # A blow in the last second is the landing that ends a flight.
    before_landing = size[: -round(STOOD_S * rate)]
    if stands or (before_landing > HARD_G).any():
        return True
    width = 2 * round(0.5 * STOOD_S * rate) + 1
    stood = np.convolve(still.astype(float), np.ones(width), "same") > width - 0.5
    if not stood.any():
        return False
    most = float(np.nanmax(running_mean(lift, width // 2)[stood]))
    leans = float(np.sqrt(np.nanmean((felt[moving, :2] ** 2).sum(axis=1)))) > LEANS_G
    return leans and most > AS_MUCH * usual


def _mean(x: Array, half: int) -> Array:
    """Running means (n, k) of the columns of ``x``."""
    return np.stack([running_mean(column, half) for column in x.T], axis=1)
