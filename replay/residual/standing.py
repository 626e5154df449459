"""Standing on the ground with turning rotors: no flight, whatever the rotors say.

An autopilot that has not noticed its landing, or that fell and fights on, keeps its rotors near hover for minutes. The
ground then carries what the rotors do not, and every model of the air is wrong by that.
"""

from __future__ import annotations

import numpy as np

from models.common.frames import Array
from models.effects import Context
from replay.residual.grid import Mask, band, rate_of_change, running_mean
from replay.residual.motion import Trajectory

ROTORS_OFF_SHARE = 0.1
"""Modelled lift over weight below which the rotors are off, or idle."""
UPRIGHT = 0.9
"""Cosine of the tilt above which a height at rest is one of the feet on the ground."""
REST_S = 1.0
"""Time at rest, or of unanswered thrust, from which on it counts."""
NEAR_RADII = 0.1
NEAR_SIGMA = 2.0
"""Margin over the height at rest: the share of the rotor radius within which feet may touch, and the range's noise."""
FAST_S = 0.1
SLOW_S = 1.0
"""Half widths of the running means between which thrust and acceleration are compared: about 0.5 to 4 Hz."""
FASTEST_HZ = 8.0
"""Rate of rotor speeds from which on they show that band (Nyquist)."""
EXCITED_SHARE = 0.003
"""RMS of lift over weight (moment over weight and lever) from which on a vehicle in the air would visibly move."""
UNANSWERED = 0.2
STILL = 0.01
"""Share of the modelled acceleration below which nothing in the air moves (flights measured so far: 0.26 and more), and
size over the weight (times the lever) that it may have: a file of another vehicle models too much, not a standstill."""


def standing(ctx: Context, motion: Trajectory, rotor_hz: float) -> Mask:
    """Samples (n,) on the ground. ``rotor_hz``: rate of rotor speeds, or of outputs where they declare the thrust."""
    grid = motion.grid
    lift = ctx.thrust.sum(axis=1)
    height = ctx.state.h_m.mean(axis=1)
    with np.errstate(invalid="ignore"):
        off = (lift < ROTORS_OFF_SHARE * ctx.weight) & (ctx.state.rotation[:, 2, 2] > UPRIGHT)
    if rotor_hz >= FASTEST_HZ:
        held = _unanswered(ctx, motion, lift)
    else:
        held = np.zeros(len(lift), bool)
    resting = off | held
    at_rest = height[resting & np.isfinite(height)]
    if len(at_rest) < REST_S * grid.rate:
        if held.sum() >= REST_S * grid.rate:
            return held
        return np.zeros(len(held), bool)
    level = float(np.median(at_rest))
    noise = 1.4826 * float(np.median(np.abs(at_rest - level)))
    margin = NEAR_RADII * ctx.vehicle.rotor_radius_m + NEAR_SIGMA * noise
    with np.errstate(invalid="ignore"):
        return np.asarray((running_mean(height, int(FAST_S * grid.rate)) < level + margin) | held)


def _unanswered(ctx: Context, motion: Trajectory, lift: Array) -> Mask:
    """Samples (n,) around which lift and moments vary and neither the accelerometer nor the gyro follows."""
    vehicle = ctx.vehicle
    rate = motion.grid.rate
    unit = ctx.weight * ctx.lever
    pairs = [(lift / ctx.weight, -vehicle.mass_kg * motion.force[:, 2] / ctx.weight)]
    turning = rate_of_change(motion.gyro, rate)
    pairs += [
        (ctx.rotor_moment[:, a] / unit, vehicle.inertia_kgm2[a] * turning[:, a] / unit)
        for a in (0, 1)
    ]
    out = np.ones(len(lift), bool)
    for modelled, measured in pairs:
        asked, answered = (_unsteady(x, rate) for x in (modelled, measured))
        with np.errstate(invalid="ignore"):
            out &= (asked > EXCITED_SHARE) & (answered < np.minimum(UNANSWERED * asked, STILL))
    return out


def _unsteady(x: Array, rate: float) -> Array:
    """RMS (n,) of what varies between ``FAST_S`` and ``SLOW_S``, over the latter."""
    return np.sqrt(running_mean(band(x, rate, FAST_S, SLOW_S) ** 2, int(SLOW_S * rate)))
