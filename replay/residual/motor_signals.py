"""What a flight shows of its rotors: measured and declared roll, pitch and lift, impacts, and how unsteady it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import GRAVITY, Array
from models.effects import Context
from replay.residual.grid import Grid, Mask, rate_of_change
from replay.residual.motion import Trajectory
from replay.residual.motion_faults import UPSIDE_DOWN

TUMBLING_S = 0.6
"""Evidence after the vehicle has turned over: later its fall changes every rotor's thrust."""
FORM = 0.15
"""Error of declared moments, as a share of what differs between the motors: thrust curves and lag."""
LATE_S = 0.03
"""By which thrust may be off in time: a motor's lag."""
BENT = 0.1
"""Error of the slope of the thrust curve, which all rotors share."""
LEAST_NOISE = np.array([0.004, 0.004, 0.01])
"""Of roll, pitch and lift: no vehicle is steadier over seconds."""
IMPACT_G = 1.2
IMPACT_SIGMA = 6.0
"""Specific force beside the declared lift from which on something was struck: rotors and drag give less; and over its
usual size in this flight."""
BEFORE_S = 3.0
"""Time before a beginning, which gives the level [s]."""


@dataclass(frozen=True, kw_only=True)
class Signals:
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


@dataclass(frozen=True)
class Noise:
    """Standard deviations (3,): of a sample, and of the mean of one stretch against the one before."""

    fast: Array
    slow: Array


def evidence_until(ctx: Context, motion: Trajectory, flying: Mask) -> float:
    """When [s] the first impact comes, or the vehicle has turned over: what follows says nothing of a motor."""
    signals = evidence_of(ctx, motion, flying)
    aloft = np.cumsum(signals.flying) * signals.step_s > BEFORE_S
    hit_s = signals.time_s[signals.struck & aloft]
    over_s = signals.time_s[signals.over & aloft] + TUMBLING_S
    ends_s = [*hit_s[:1], *over_s[:1]]
    return float(min(ends_s, default=np.inf))


def evidence_of(ctx: Context, motion: Trajectory, flying: Mask) -> Signals:
    """What a flight shows of its rotors: measured and declared moments and lift, by rows of 0.1 s."""
    grid = motion.grid
    step_s = grid.every / grid.rate
    measured = grid.smooth(_measured(ctx, motion))
    thrust = grid.smooth(ctx.thrust / ctx.weight)
    arms = np.asarray(ctx.vehicle.fan_positions_m) / ctx.lever
    of_thrust = np.stack([-arms[:, 1], arms[:, 0], np.ones(len(arms))], axis=1)
    by_fan = thrust[:, :, None] * of_thrust
    declared = by_fan.sum(axis=1)
    doubt = _doubt(thrust, of_thrust, declared, step_s)
    with np.errstate(invalid="ignore"):
        over = motion.rotation[:, 2, 2] < UPSIDE_DOWN
    # Beside a gap the slope of what is declared is unknown, too.
    needed = np.hstack([measured, declared, doubt])
    good = np.isfinite(needed).all(axis=1)
    return Signals(
        time_s=grid.t[:: grid.every],
        step_s=step_s,
        measured=measured,
        by_fan=by_fan,
        declared=declared,
        doubt=doubt,
        velocity=np.nan_to_num(grid.smooth(ctx.velocity)),
        good=good,
        struck=_in_blocks(_impacts(ctx, motion, flying), grid),
        over=_in_blocks(over, grid),
        flying=flying[:: grid.every],
    )


def _measured(ctx: Context, motion: Trajectory) -> Array:
    """Roll and pitch moment over weight and lever, and lift over the weight, (n, 3); I dw/dt + w x I w."""
    inertia = np.array(ctx.vehicle.inertia_kgm2)
    spin_up = rate_of_change(motion.gyro, motion.grid.rate)
    gyroscopic = np.cross(motion.gyro, motion.gyro * inertia)
    moment = spin_up * inertia + gyroscopic
    unit = ctx.weight * ctx.lever
    lift = -motion.force[:, 2] / GRAVITY
    return np.column_stack([moment[:, :2] / unit, lift])


def _doubt(thrust: Array, of_thrust: Array, declared: Array, step_s: float) -> Array:
    """Standard deviation (n, 3) of what is ``declared``: thrust curves between motors and as a whole, and lag."""
    apart = np.abs(thrust - thrust.mean(axis=1, keepdims=True))
    of_each = apart[:, :, None] * of_thrust
    form = FORM * np.sqrt((of_each**2).sum(axis=1))
    form[:, 2] = np.hypot(form[:, 2], BENT * np.abs(declared[:, 2] - 1.0))
    late = LATE_S * np.abs(np.gradient(declared, step_s, axis=0))
    return np.asarray(np.hypot(form, late))


def _impacts(ctx: Context, motion: Trajectory, flying: Mask) -> Mask:
    """Where something was struck (n,): by the accelerometer, or by the velocity where it fell between two samples."""
    lift = -motion.force[:, 2] / GRAVITY
    # Less lift than declared is no blow: a rotor may turn without its propeller.
    above = lift * GRAVITY - ctx.thrust.sum(axis=1) / ctx.vehicle.mass_kg
    upward = np.maximum(np.maximum(above, motion.force[:, 2]), 0.0)
    level = np.linalg.norm(motion.force[:, :2], axis=1)
    unfelt = np.linalg.norm(motion.kinematic_bias, axis=1)
    return _blows(np.hypot(upward, level), flying) | _blows(unfelt, flying)


def _blows(size: Array, flying: Mask) -> Mask:
    """Where an acceleration (n,) [m/s^2] is that of an impact: more than a vehicle has, and than is usual here."""
    known = flying & np.isfinite(size)
    if not known.any():
        return np.zeros(len(size), bool)
    least = max(IMPACT_G * GRAVITY, IMPACT_SIGMA * float(np.median(size[known])))
    with np.errstate(invalid="ignore"):
        return np.asarray(size > least)


def _in_blocks(mask: Mask, grid: Grid) -> Mask:
    """Whether it holds anywhere in the samples about each row."""
    samples = np.ones(grid.every)
    near = np.convolve(mask.astype(float), samples, "same") > 0.5
    rows = len(mask[:: grid.every])
    return np.asarray(near[:: grid.every][:rows])


def noise_of(signals: Signals) -> Noise | None:
    """As the flight itself shows it; None where it is too short to say."""
    usable = signals.good & signals.flying & ~signals.over
    span = round(BEFORE_S / signals.step_s)
    if usable.sum() < 2 * span:
        return None
    left = signals.measured - signals.declared
    left = np.where(usable[:, None], left, np.nan)
    fast = _spread(np.diff(left, axis=0)) / np.sqrt(2.0)
    kernel = np.ones(span) / span
    means = [np.convolve(of_axis, kernel, "valid") for of_axis in left.T]
    mean = np.stack(means, axis=1)
    change = mean[span:] - mean[:-span]
    known = np.isfinite(change).all(axis=1)
    if known.sum() < span:
        return None
    slow = _spread(change[known])
    return Noise(np.maximum(fast, LEAST_NOISE), np.maximum(slow, LEAST_NOISE))


def _spread(x: Array) -> Array:
    """Standard deviation (3,) of (n, 3) by the middle and by what is usually exceeded: tails count once."""
    middle, most = np.nanpercentile(np.abs(x), (50.0, 90.0), axis=0)
    return np.asarray(np.maximum(1.4826 * middle, most / 1.645))
