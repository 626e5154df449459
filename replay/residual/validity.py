"""Which time of a flight can be judged, and why the rest is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models.common.frames import Array
from models.effects import Context
from replay.flightlog import FlightLog
from replay.residual.grid import Grid, Mask, rate_of_change, running_mean
from replay.residual.held_down import held_down
from replay.residual.hops import ROSE_M, hops
from replay.residual.motion import Trajectory, rotor_rate_hz
from replay.residual.standing import ROTORS_OFF_SHARE, standing

AIRBORNE_SHARE = 0.5
"""Modelled lift over weight above which a vehicle flies: half leaves room for any undeclared effect."""
LIFT_S = 0.2
TAKE_OFF_S = 1.0
CONTACT_S = 0.3
JUMP_S = 0.2
CLIP_S = 0.3
"""Half width of the mean of lift; time around take-off and landing, contact, a jump and a clipped sample left out."""
NEVER_SHARE = 0.5
"""Share of the time with turning rotors in which a vehicle is held that has not flown."""
ARMED_S = 1.0
"""Time around the armed interval that is still looked at: heartbeats come once a second."""
TOUCHING_RADII = 0.1
"""Height over the ground [rotor radii] below which feet may touch; no published ground effect was measured below."""
FASTEST_GROUND_M_S = 2.5
"""Speed of the ground below the vehicle beyond which the beam has jumped to another surface."""
SHORTEST_GAP_S = 0.05
"""Time that is not worth a line among what was left out."""
CLIPPED_SHARE = 0.004
CLIPPED_SAMPLES = 20
CLIPPED_M_S2 = 0.5
BIASED_SHARE = 0.02
"""Share and number of samples at the very top from which on a sensor is at its limit; share that moves its mean."""


@dataclass(frozen=True)
class Excluded:
    """Time left out of the analysis, and why."""

    reason: str
    seconds: float


@dataclass(frozen=True)
class Airborne:
    """Samples (n,) in the air; with turning rotors; of these the ones at which the vehicle is held, or hops."""

    flying: Mask
    turning: Mask
    held: Mask
    hopping: Mask

    @property
    def never(self) -> bool:
        """Whether the rotors turned, and mostly on a vehicle that was held."""
        return bool(self.held.sum() > NEVER_SHARE * self.turning.sum())

    @property
    def hops(self) -> bool:
        """Whether the rotors turned mostly for hops."""
        return bool(self.hopping.sum() > NEVER_SHARE * self.turning.sum())


@dataclass(frozen=True)
class JudgedTime:
    """Rows that can be judged (n,), time left out by reason, axes that cannot be judged at all, and why."""

    valid: Mask
    excluded: tuple[Excluded, ...] = ()
    unjudged_axes: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    def without(self, reason: str, bad: Mask, rate: float, around_s: float = 0.0) -> JudgedTime:
        """Leave out the samples ``bad`` (n,) and the time around them."""
        if around_s > 0.0 and bad.any():
            bad = np.convolve(bad, np.ones(2 * int(around_s * rate) + 1), "same") > 0.5
        seconds = float((self.valid & bad).sum() / rate)
        new: tuple[Excluded, ...]
        if seconds >= SHORTEST_GAP_S:
            new = (Excluded(reason, seconds),)
        else:
            new = ()
        return replace(self, valid=self.valid & ~bad, excluded=self.excluded + new)


def judged_time(
    ctx: Context,
    motion: Trajectory,
    modelled: Array,
    flying: Mask,
    left_out: Sequence[tuple[str, Mask]] = (),
) -> JudgedTime:
    """The time of flight with all that is needed; ``modelled`` (n, 6) wrench, ``flying`` (n,) as by ``airborne``.

    ``left_out``: other time (n,) that is not judged, by its reason.
    """
    state = ctx.state
    grid = motion.grid
    force = motion.force
    heights = np.where(np.isfinite(state.h_m), state.h_m, np.inf)
    unknown = _incomplete(force) | _incomplete(state.rotation) | _incomplete(ctx.thrust)
    reasons: tuple[tuple[str, Any, float], ...] = (
        ("no IMU, attitude or rotor speed (gap in the log)", unknown, 0.0),
        ("on the ground, or taking off or landing", ~flying, TAKE_OFF_S),
        (
            "at the ground (closer than a tenth of a rotor radius)",
            heights.min(axis=1) < TOUCHING_RADII * ctx.vehicle.rotor_radius_m,
            CONTACT_S,
        ),
        *((reason, when, 0.0) for reason, when in left_out),
        ("the ground under the rangefinder jumped", _jumps(ctx, grid), JUMP_S),
    )
    out = JudgedTime(np.ones(len(grid.t), bool))
    for reason, bad, around_s in reasons:
        out = out.without(reason, bad, grid.rate, around_s)
    for axis in range(3):
        out = _without_clipped(out, force[:, axis], axis, grid.rate)
    return out.without("the model has no answer", _incomplete(modelled[:, :3]), grid.rate)


def _incomplete(x: Array) -> Mask:
    """Rows (n,) of (n, ...) that lack a number."""
    return np.asarray(~np.isfinite(x.reshape(len(x), -1)).all(axis=1))


def airborne(log: FlightLog, ctx: Context, motion: Trajectory) -> Airborne:
    """When the vehicle is in the air: armed, with lift, not on the ground by the autopilot, and not held."""
    grid = motion.grid
    t = grid.t
    lift = ctx.thrust.sum(axis=1)
    with np.errstate(invalid="ignore"):
        flying = running_mean(lift, int(LIFT_S * grid.rate)) > AIRBORNE_SHARE * _needed_lift(
            ctx, lift
        )
    for interval in log.landed:
        if interval.value == 1:
            flying &= ~((t >= interval.start_s) & (t < interval.end_s))
    if log.armed:
        armed = [(t >= i.start_s - ARMED_S) & (t <= i.end_s + ARMED_S) for i in log.armed]
        flying &= np.logical_or.reduce(armed)
    turning, held = held_down(ctx, motion)
    hopping = hops(ctx, motion, turning) & ~held
    flying &= ~held & ~hopping & ~standing(ctx, motion, rotor_rate_hz(log, ctx.vehicle))
    return Airborne(flying, turning, held, hopping)


def _needed_lift(ctx: Context, lift: Array) -> float:
    """The weight, or what was modelled at most where the vehicle rose with less: then the file is another vehicle's."""
    height = ctx.state.position_ned[:, 2]
    if not (np.isfinite(lift).any() and np.isfinite(height).any()):
        return ctx.weight
    most = float(np.nanquantile(lift, 0.9))
    rose = float(np.nanmax(height) - np.nanmin(height)) > ROSE_M
    if rose and ROTORS_OFF_SHARE * ctx.weight < most < AIRBORNE_SHARE * ctx.weight:
        return most
    return ctx.weight


def _jumps(ctx: Context, grid: Grid) -> Mask:
    """Samples (n,) at which the ground moves under the vehicle."""
    height = np.where(np.isfinite(ctx.state.h_m[:, 0]), ctx.state.h_m[:, 0], np.nan)
    with np.errstate(invalid="ignore"):
        of_ground = rate_of_change(height, grid.rate) + ctx.state.velocity_ned[:, 2]
        return np.asarray(np.abs(of_ground) > FASTEST_GROUND_M_S)


def _without_clipped(time: JudgedTime, force: Array, axis: int, rate: float) -> JudgedTime:
    """Leave out samples at the accelerometer's limit, or the axis where there are so many that its mean is wrong."""
    size = np.abs(force)
    if np.isfinite(size).any():
        top = float(np.nanmax(size))
    else:
        top = 0.0
    clipped = size >= top * (1.0 - 1e-6)
    if clipped.sum() < max(CLIPPED_SAMPLES, CLIPPED_SHARE * len(size)) or top <= CLIPPED_M_S2:
        return time
    share = float(np.mean(clipped))
    note = f"accelerometer {'xyz'[axis]} clipped at {top:.1f} m/s^2 in {share:.0%} of the samples"
    if share <= BIASED_SHARE:
        return replace(time, notes=(*time.notes, note)).without(
            "the accelerometer was clipped", clipped, rate, CLIP_S
        )
    distrust = f"F{'xyz'[axis]} is not judged: its mean is not to be trusted"
    return replace(
        time, notes=(*time.notes, note, distrust), unjudged_axes=(*time.unjudged_axes, axis)
    )
