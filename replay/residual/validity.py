"""Which time of a flight can be judged, and why the rest is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.effects import Context
from models.frames import Array
from replay.flightlog import FlightLog
from replay.residual.grid import Grid, Mask, rate_of_change, running_mean

AIRBORNE_SHARE = 0.5


@dataclass(frozen=True)
class Excluded:
    """Time left out of the analysis, and why."""

    reason: str
    seconds: float


def judged_time(
    log: FlightLog, ctx: Context, grid: Grid, force: Array, modelled: Array, notes: list[str], axes: list[int]
) -> tuple[Mask, list[Excluded]]:
    """Rows that can be judged (n,), and the time left out by reason; adds to ``notes``, takes unusable axes away."""
    state, rate, t = ctx.state, grid.rate, grid.t
    valid = np.ones(len(t), bool)
    excluded: list[Excluded] = []

    def leave_out(reason: str, bad: Any, around_s: float = 0.0) -> None:
        if around_s > 0.0 and bad.any():
            bad = np.convolve(bad, np.ones(2 * int(around_s * rate) + 1), "same") > 0.5
        new = valid & bad
        if new.sum() / rate >= 0.05:
            excluded.append(Excluded(reason, float(new.sum() / rate)))
        valid[bad] = False

    leave_out("no IMU, attitude or rotor speed (gap in the log)", ~np.isfinite(force).all(axis=1)
              | ~np.isfinite(state.rotation).all(axis=(1, 2)) | ~np.isfinite(ctx.thrust).all(axis=1))  # fmt: skip
    with np.errstate(invalid="ignore"):
        lift = ctx.thrust.sum(axis=1)
        flying = running_mean(lift, int(0.2 * rate)) > AIRBORNE_SHARE * ctx.weight
    for interval in log.landed:
        if interval.value == 1:
            flying &= ~((t >= interval.start_s) & (t < interval.end_s))
    if log.armed:
        armed = np.zeros(len(t), bool)
        for interval in log.armed:
            armed |= (t >= interval.start_s - 1.0) & (t <= interval.end_s + 1.0)
        flying &= armed
    leave_out("on the ground, or taking off or landing", ~flying, 1.0)
    touching = np.nanmin(np.where(np.isfinite(state.h_m), state.h_m, np.inf), axis=1) < 0.1 * ctx.vehicle.rotor_radius_m
    leave_out("at the ground (closer than a tenth of a rotor radius)", touching, 0.3)
    leave_out("no height over ground", np.isnan(state.h_m).any(axis=1))
    leave_out("no distance to the wall", np.isnan(state.d_m).any(axis=1))
    finite_h = np.where(np.isfinite(state.h_m[:, 0]), state.h_m[:, 0], np.nan)
    if np.isfinite(finite_h).any() and np.isfinite(state.velocity_ned[:, 2]).any():
        with np.errstate(invalid="ignore"):
            jump = np.abs(rate_of_change(finite_h[:, None], rate)[:, 0] + state.velocity_ned[:, 2]) > 2.5
        leave_out("the ground under the rangefinder jumped", jump, 0.2)
    for axis in range(3):
        size = np.abs(force[:, axis])
        top = np.nanmax(size) if np.isfinite(size).any() else 0.0
        clipped = size >= top * (1.0 - 1e-6)
        if clipped.sum() >= max(20, 0.004 * len(size)) and top > 0.5:
            share = float(np.mean(clipped))
            notes.append(f"accelerometer {'xyz'[axis]} clipped at {top:.1f} m/s^2 in {share:.0%} of the samples")
            if share > 0.02 and axis in axes:
                axes.remove(axis)
                notes.append(f"F{'xyz'[axis]} is not judged: its mean is not to be trusted")
            else:
                leave_out("the accelerometer was clipped", clipped, 0.3)
    leave_out("the model has no answer", ~np.isfinite(modelled[:, :3]).all(axis=1))
    return valid, excluded
