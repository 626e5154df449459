"""What acts and is in no logged channel: a slow remainder above what quiet flights leave, how large, where, when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import AXES, Array
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.channel import hundredths
from replay.search.regimes import LEAST_S, SURFACES, regimes
from replay.search.swings import strongest_swing
from replay.search.thresholds import (
    FORCE_LIMIT,
    LEVEL_LEFT,
    LIFT_LEFT,
    LOUD,
    MOMENT_LEFT,
    MOMENT_LIMIT,
    SUDDEN,
    SUDDEN_S,
    SWING_LIMIT,
    SWING_SHARE,
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
    swing_hz: float | None = None
    """Where it swings at one frequency."""


def outside(record: Record, rest: Array) -> tuple[Outside, ...]:
    """Axes of the unexplained ``rest`` (n, 6) that hold more than quiet flights leave."""
    out = []
    for axis in (*record.axes, *record.blind):
        of_axis = _of_axis(record, rest[:, axis], axis)
        if of_axis is not None:
            out.append(of_axis)
    known = {one.axis for one in out}
    beside = [one for one in beside_surfaces(record, rest) if one.axis not in known]
    return (*out, *beside)


def _of_axis(record: Record, rest: Array, axis: int) -> Outside | None:
    """Where the remainder (n,) of one axis is above the limit, or sudden; None where neither."""
    valid = record.valid
    unit = float(hundredths(record.context)[axis])
    slow = _slow(record, rest)
    if axis < 3:
        limit = FORCE_LIMIT * unit
        left = rest[valid]
    else:
        limit = MOMENT_LIMIT * unit
        left = slow[valid]
    rms = float(np.sqrt(np.mean(left**2)))
    size = np.abs(slow)
    if rms > limit:
        loud = size > LOUD * limit
        return Outside(AXES[axis], rms, _intervals(record.time_s, loud))
    usual = MAD_TO_SD * float(np.median(size[valid]))
    sudden = size > max(LOUD * limit, SUDDEN * usual)
    if sudden.sum() * record.step_s > SUDDEN_S:
        return Outside(AXES[axis], rms, _intervals(record.time_s, sudden))
    if axis >= 3:
        swing = strongest_swing(record, rest)
        swing_rms = float(np.sqrt(swing.share) * rest[valid].std())
        if swing.share >= SWING_SHARE and swing_rms > SWING_LIMIT * unit:
            when = _intervals(record.time_s, valid)
            return Outside(AXES[axis], swing_rms, when, swing_hz=swing.hz)
    return None


def _slow(record: Record, rest: Array) -> Array:
    """Mean (n,) of a remainder over ``SLOW_S``; 0 where not valid."""
    width = max(round(SLOW_S / record.step_s), 1)
    kernel = np.ones(width)
    samples = np.convolve(record.valid.astype(float), kernel, "same")
    total = np.convolve(np.where(record.valid, rest, 0.0), kernel, "same")
    mean = total / np.maximum(samples, 1.0)
    return np.where(record.valid, mean, 0.0)


def beside_surfaces(record: Record, rest: Array) -> list[Outside]:
    """What is left on average beside a surface and not away from all, beyond two standard errors of that mean."""
    out = []
    forces = (LEVEL_LEFT, LEVEL_LEFT, LIFT_LEFT)
    moments = (MOMENT_LEFT, MOMENT_LEFT, MOMENT_LEFT)
    limits = hundredths(record.context) * (*forces, *moments)
    masks = regimes(record)
    away, error_away = _away(record, rest, masks["far"])
    for name in SURFACES:
        mask = masks[name]
        seconds = float(mask.sum()) * record.step_s
        if seconds < LEAST_S:
            continue
        for axis in record.axes:
            beside = rest[mask, axis]
            mean = abs(beside.mean() - away[axis])
            error = np.hypot(_standard_error(beside, seconds), error_away[axis])
            if mean > limits[axis] + 2.0 * error:
                when = _intervals(record.time_s, mask)
                out.append(Outside(AXES[axis], float(mean), when, name))
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
    for start, end in zip(index[starts], index[ends], strict=True):
        start_s = float(time_s[start])
        end_s = float(time_s[end])
        if end_s - start_s >= SHORTEST_S:
            spans.append((start_s, end_s))
    spans.sort(key=lambda span: span[0] - span[1])
    return tuple(sorted(spans[:MOST]))
