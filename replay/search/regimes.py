"""Where a flight was, and how it flew: the parts of which an error is reported by itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from models.common.frames import AXES, Array
from replay.residual.grid import Mask
from replay.residual.record import Record

NEAR_GROUND = 4.0
NEAR_WALL = 3.8
"""Reach of ground (h/R) and wall (d/R) in rotor radii (Ai et al. 2020, Sensors 20, 5805)."""
STILL_M_S = 0.3
FAST_M_S = 1.0
CLIMBING_M_S = 0.3
"""Speed of a hover and of a fast flight, climb or descent of a climbing flight [m/s]."""
SURFACES = ("low", "wall", "corner")
"""Regimes beside a surface; ``far`` is away from all of them."""
LEAST_S = 3.0
"""A regime that lasts less is not reported [s]."""


def regimes(record: Record) -> dict[str, Mask]:
    """Judged samples (n,) of every regime: by motion, and by surfaces (these exclude each other)."""
    state = record.context.state
    radius = record.context.vehicle.rotor_radius_m
    velocity = state.velocity_ned
    low = _nearest(state.h_m) < NEAR_GROUND * radius
    wall = _nearest(state.d_m) < NEAR_WALL * radius
    speed = np.linalg.norm(velocity, axis=1)
    climb = np.abs(velocity[:, 2])
    out = {
        "hover": speed < STILL_M_S,
        "fast": speed > FAST_M_S,
        "climbing": climb > CLIMBING_M_S,
        "low": low & ~wall,
        "wall": wall & ~low,
        "corner": low & wall,
        "far": ~low & ~wall,
    }
    return {name: mask & record.valid for name, mask in out.items()}


def long_regimes(record: Record) -> dict[str, Mask]:
    """Those that last long enough to be reported."""
    out = {}
    for name, mask in regimes(record).items():
        if mask.sum() * record.step_s >= LEAST_S:
            out[name] = mask
    return out


def _nearest(distances: Array) -> Array:
    """Least of some distances (n, k) [m]; infinite where none is known."""
    return np.asarray(np.nan_to_num(distances, nan=np.inf, posinf=np.inf).min(axis=1))


def by_regime(record: Record, before: Array, after: Array) -> list[dict[str, Any]]:
    """RMS of residuals (n, 6) without and with the effects in every regime that lasts, by axis."""
    out = []
    for name, mask in long_regimes(record).items():
        seconds = float(mask.sum()) * record.step_s
        rms_before = _rms(before[mask])
        rms_after = _rms(after[mask])
        axes = {}
        for a in record.axes:
            axes[AXES[a]] = {"rms_before": rms_before[a], "rms_after": rms_after[a]}
        out.append({"regime": name, "seconds": seconds, "axes": axes})
    return out


def _rms(residual: Array) -> list[float]:
    mean_square = (residual**2).mean(axis=0)
    return list(np.sqrt(mean_square).tolist())
