"""What acts and is in no logged channel: a slow remainder above what quiet flights leave, how large, where, when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import AXES, Array
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.channel import hundredths
from replay.search.regimes import LEAST_S, SURFACES, regimes
from replay.search.thresholds import (
    FORCE_LIMIT,
    LEVEL_LEFT,
    LIFT_LEFT,
    LOUD,
    MOMENT_LEFT,
    MOMENT_LIMIT,
    SUDDEN,
    SUDDEN_S,
)

SLOW_S = 1.0
"""The remainder is averaged over this time [s]."""
JOIN_S = 2.0
SHORTEST_S = 0.5
MOST = 12
"""Gaps up to this are bridged [s]; shorter intervals are left out [s]; intervals that are listed, the longest first."""
MAD_TO_SD = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""

INDEPENDENT_S = 2.0
"""Time after which a remainder counts as a new sample of its mean [s]."""


@dataclass(frozen=True)
class Outside:
    """A slow remainder of one axis [N or N m]; ``regime``: its mean there, where it is small over the whole flight."""

    axis: str
    rms: float
    intervals_s: tuple[tuple[float, float], ...]
    regime: str = ""


def outside(record: Record, rest: Array) -> tuple[Outside, ...]:
    """Axes of the unexplained ``rest`` (n, 6) that hold more than quiet flights leave."""
    out = []
    valid = record.valid
    width = max(round(SLOW_S / record.step_s), 1)
    kernel = np.ones(width)
    weight = np.convolve(valid.astype(float), kernel, "same")
    for a in (*record.axes, *record.blind):
        unit = float(hundredths(record.context)[a])
        total = np.convolve(np.where(valid, rest[:, a], 0.0), kernel, "same")
        slow = np.where(valid, total / np.maximum(weight, 1.0), 0.0)
        if a < 3:
            limit = FORCE_LIMIT * unit
            left = rest[valid, a]
        else:
            limit = MOMENT_LIMIT * unit
            left = slow[valid]
        rms = float(np.sqrt(np.mean(left**2)))
        usual = MAD_TO_SD * float(np.median(np.abs(slow[valid])))
        struck = np.abs(slow) > max(LOUD * limit, SUDDEN * usual)
        if rms > limit:
            loud = np.abs(slow) > LOUD * limit
            out.append(Outside(AXES[a], rms, _intervals(record.time_s, loud)))
        elif struck.sum() * record.step_s > SUDDEN_S:
            out.append(Outside(AXES[a], rms, _intervals(record.time_s, struck)))
    known = {o.axis for o in out}
    return (*out, *(o for o in beside_surfaces(record, rest) if o.axis not in known))


def beside_surfaces(record: Record, rest: Array) -> list[Outside]:
    """What is left on average beside a surface and not away from all, beyond two standard errors of that mean."""
    out = []
    limits = hundredths(record.context) * (*[LEVEL_LEFT] * 2, LIFT_LEFT, *[MOMENT_LEFT] * 3)
    masks = regimes(record)
    away, doubt = _away(record, rest, masks["far"])
    for name in SURFACES:
        mask = masks[name]
        seconds = float(mask.sum()) * record.step_s
        if seconds < LEAST_S:
            continue
        for a in record.axes:
            limit = limits[a]
            mean = rest[mask, a].mean() - away[a]
            error = np.hypot(_standard_error(rest[mask, a], seconds), doubt[a])
            if abs(mean) > limit + 2.0 * error:
                when = _intervals(record.time_s, mask)
                out.append(Outside(AXES[a], float(abs(mean)), when, name))
    return out


def _away(record: Record, rest: Array, far: Mask) -> tuple[Array, Array]:
    """Mean (6,) away from all surfaces and its standard error; zeros where the flight was not there."""
    seconds = float(far.sum()) * record.step_s
    if seconds < LEAST_S:
        return np.zeros(6), np.zeros(6)
    errors = [_standard_error(rest[far, a], seconds) for a in range(6)]
    return rest[far].mean(axis=0), np.array(errors)


def _standard_error(x: Array, seconds: float) -> float:
    """Of the mean of some samples (n,) that last so long."""
    return float(x.std() / np.sqrt(max(seconds / INDEPENDENT_S, 1.0)))


def _intervals(time_s: Array, loud: Mask) -> tuple[tuple[float, float], ...]:
    """The longest runs of ``loud``, short gaps bridged, in the order of time."""
    index = np.flatnonzero(loud)
    if not index.size:
        return ()
    breaks = np.flatnonzero(np.diff(time_s[index]) > JOIN_S)
    starts = np.concatenate([[0], breaks + 1])
    ends = np.concatenate([breaks, [len(index) - 1]])
    spans = []
    for start_s, end_s in zip(time_s[index[starts]], time_s[index[ends]], strict=True):
        if end_s - start_s >= SHORTEST_S:
            spans.append((float(start_s), float(end_s)))
    spans.sort(key=lambda span: span[0] - span[1])
    return tuple(sorted(spans[:MOST]))
