"""Hops of decimetres: feet that touch again and again, or a vehicle that is tipped, are no flight.

Where no sensor sees the ground, a vehicle that never rises by half a metre is next to it all the time. If it then
stands in between, or stands with as much lift as it moves with, the ground or a hand carries part of it.
"""

from __future__ import annotations

import numpy as np

from models.common.frames import GRAVITY, Array
from models.effects import Context
from replay.residual.grid import Mask, running_mean
from replay.residual.motion import Trajectory

NOT_CLEAR = (
    "did not fly long enough clear of the ground: it stands between hops, or is tipped, and never "
    "rises by half a metre"
)
ROSE_M = 0.5
"""Change of height that proves a flight."""
SMOOTH_S = 0.1
REST_S = 0.25
"""Half widths of the mean over noise, and of the time in which a vehicle rests that stands."""
STILL_RAD_S = 0.02
STILL_G = 0.01
"""Rate of turning, and change of the felt force, of what stands. The calmest half second of 13 measured flights of nano
quadrotors within half a metre turns by 0.022 rad/s; what stands with turning rotors by 0.002 to 0.015."""
STOOD_S = 1.0
AS_MUCH = 0.97
"""Time for which a vehicle stands with some lift, and share of the lift in flight from which on that is as much."""


def hops(ctx: Context, motion: Trajectory, turning: Mask) -> Mask:
    """Samples (n,) of the runs of the rotors ``turning`` (n,) in which the vehicle hops, or is tipped."""
    out = np.zeros(len(turning), bool)
    still = _still(motion)
    lift = ctx.thrust.sum(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], turning, [False]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        run = slice(first, last)
        if np.isfinite(ctx.state.h_m[run]).any() or not _low(motion.position[run, 2]):
            continue
        if _touches(still[run], lift[run], motion.grid.rate):
            out[run] = True
    return out


def _low(down: Array) -> bool:
    """Whether a vehicle is known to stay within ``ROSE_M`` above the place where a run of the rotors begins."""
    known = down[np.isfinite(down)]
    return bool(known.size) and float(known[0] - known.min()) < ROSE_M


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


def _touches(still: Mask, lift: Array, rate: float) -> bool:
    """Whether a run (m,) of the rotors stands in its middle, or with as much lift as it moves with."""
    moving = np.flatnonzero(~still)
    if not moving.size:
        return False
    if still[moving[0] : moving[-1]].any():
        return True
    width = 2 * round(0.5 * STOOD_S * rate) + 1
    stood = np.convolve(still.astype(float), np.ones(width), "same") > width - 0.5
    if not stood.any():
        return False
    most = float(np.nanmax(running_mean(lift, width // 2)[stood]))
    return most > AS_MUCH * float(np.nanmedian(lift[moving]))


def _mean(x: Array, half: int) -> Array:
    """Running means (n, k) of the columns of ``x``."""
    return np.stack([running_mean(column, half) for column in x.T], axis=1)
