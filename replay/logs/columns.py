"""What every format does alike: clean columns, and the parts of a FlightLog made from them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.range_beams import range_verdict
from models.common.errors import LogError
from models.common.frames import GRAVITY, Array, quaternion_of_halves
from replay.flightlog import Beam, ImuRecord, Interval, Series
from replay.logs.tlog import outliers
from replay.spill import Spool, blocks, picked, spilled

_NEVER_S = 1e10
"""No clock of a vehicle shows this: 317 years."""
_DAY_S = 86_400.0
"""No flight lasts a day: a stamp further from the median of its column is damaged."""
_STRAY_US = 1_000_000
"""A stamp one second off the median of its neighbours is damaged: columns are faster than 1 Hz, and a step of the clock
moves the neighbours too."""
_SPARSE_S = 0.5
"""Median step above which neighbours say nothing about a stamp."""
_CLIP_AT_M_S2 = 3.0 * GRAVITY
"""No multirotor in a hover or a gentle flight reaches 3 g by moving; vibration that does is near the sensor's range."""
_CLIP_HITS = 3
"""One sample at the extreme is the extreme; exactly the same value three times is a stop."""
_UNIT = 0.1
"""A quaternion whose length is further from 1 is none."""
_STEP_SAMPLES = 20_000
"""Samples that show a grid; more change nothing."""


@dataclass(frozen=True)
class Messages:
    """All messages of one kind: boot times (n,) and fields (n,) by name; a field that this version lacks is NaN."""

    name: str
    t_s: Array
    data: Mapping[str, NDArray[Any]]

    def __len__(self) -> int:
        return len(self.t_s)

    def __contains__(self, field: str) -> bool:
        return field in self.data

    def __getitem__(self, field: str) -> NDArray[Any]:
        return self.data[field]

    def column(self, field: str) -> Array:
        """One field (n,)."""
        if field not in self.data:
            return np.full(len(self), np.nan)
        with np.errstate(invalid="ignore"):  # damage may make a NaN of the kind that signals
            return np.asarray(self.data[field], dtype=float)

    def columns(self, *fields: str) -> Array:
        """(n, k)."""
        return np.stack([self.column(f) for f in fields], axis=-1)

    def array(self, field: str, count: int) -> Array:
        """(n, count) of an array field, ``field[0]`` and on."""
        return self.columns(*[f"{field}[{i}]" for i in range(count)])

    def where(self, mask: NDArray[Any]) -> Messages:
        """Some of the messages, by a mask (n,) or by their places, in that order."""
        if mask.dtype == bool and mask.all():
            return self
        chosen = {name: picked(values, mask) for name, values in self.data.items()}
        return Messages(self.name, picked(self.t_s, mask), chosen)

    def series(self, values: Array, source: str = "") -> Series | None:
        """Values (n,) or (n, k) at the times of the messages."""
        return tidy(self.t_s, values, source or self.name)


def time_span(path: Path, stamps: Sequence[Array], names: str) -> tuple[float, float]:
    """First and last believable time [s] of several columns. Raises LogError where there is none."""
    if stamps:
        known = believable(np.concatenate(stamps))
    else:
        known = np.empty(0)
    if not np.isfinite(known).any():
        raise LogError(
            f"{path}: holds no {names} with a believable time: nothing to replay or diagnose"
        )
    return float(np.nanmin(known)), float(np.nanmax(known))


def imu_record(
    source: str,
    force: Series | None,
    gyro: Series | None,
    counted: int,
    step: float | None = None,
    *,
    instance: int = 0,
    healthy: bool | None = None,
) -> ImuRecord | None:
    """An accelerometer with its gyro, or None without either. ``counted``: clipped samples by the autopilot's counter.

    ``step`` [m/s^2] is the grid that the format stores; None: as the samples show it.
    """
    if force is None or gyro is None:
        return None
    if step is None:
        step = smallest_step(force.values.ravel())
    return ImuRecord(
        source=source,
        specific_force=force,
        gyro=gyro,
        force_step=step,
        clipped=max(counted, clipped_at_extreme(force.values)),
        instance=instance,
        healthy=healthy,
    )


def range_beam(
    direction: tuple[float, float, float],
    sensor: tuple[int, int, int],
    readings: Series,
    limits: tuple[float, float] = (math.nan, math.nan),
    quality: NDArray[Any] | None = None,
    sigma_m: float = math.nan,
    step_m: float | None = None,
) -> Beam:
    """A rangefinder. ``sensor``: component, id, orientation; ``readings`` (n, 1) slant [m]; ``limits`` min, max [m].

    ``quality`` (n,) as on MAVLink: 0 unknown, 1 none. ``step_m``: the grid of the format; None: as
    the readings show it.
    """
    distance = readings.values[:, 0]
    low, high = limits
    if not high > 0.0:
        low = high = math.nan
    if quality is None:
        quality = np.zeros(len(distance), int)
    if step_m is None:
        step_m = smallest_step(distance)
    verdicts = []
    for value, share in zip(distance.tolist(), quality.tolist(), strict=True):
        verdicts.append(range_verdict(value, low, high, int(share), True))
    component, sensor_id, orientation = sensor
    return Beam(
        direction_frd=direction,
        component=component,
        sensor_id=sensor_id,
        orientation=orientation,
        source=readings.source,
        distance=readings,
        verdicts=tuple(verdicts),
        min_m=low,
        max_m=high,
        sigma_m=sigma_m,
        step_m=step_m,
    )


def quaternions(euler: Array) -> Array:
    """Quaternions (n, 4) of roll, pitch, yaw (n, 3) [rad], aerospace 3-2-1; an angle that is no number makes NaN."""
    out = Spool(np.float64, (4,))
    for rows in blocks(len(euler)):
        halves = np.where(np.isfinite(euler[rows]), euler[rows], np.nan) / 2.0
        out.append(np.stack(quaternion_of_halves(np.cos(halves).T, np.sin(halves).T), axis=-1))
    return out.array()


def clipped_at_extreme(values: Array) -> int:
    """Samples of (n, 3) that stand exactly at an axis' extreme, where that is above 3 g and hit three times or more."""
    total = 0
    for k in range(values.shape[1]):
        axis = np.abs(values[:, k])
        known = axis[np.isfinite(axis)]
        if known.size and known.max() >= _CLIP_AT_M_S2:
            hits = int((known == known.max()).sum())
            if hits >= _CLIP_HITS:
                total += hits
    return total


def tidy(t_s: Array, values: Array, source: str) -> Series | None:
    """A Series sorted by time, repeats of a stamp and samples without a number dropped; None where nothing is left."""
    if values.ndim == 1:
        values = values[:, None]
    keep = np.isfinite(t_s) & ~np.isnan(values).all(axis=1)
    if not keep.all():  # else no copy: columns of one message share their times
        t_s = t_s[keep]
        values = values[keep]
    if t_s.size > 1 and not (np.diff(t_s) > 0.0).all():
        t_s, first = np.unique(t_s, return_index=True)
        values = values[first]
    if t_s.size:
        return Series(spilled(t_s), spilled(values), source)
    return None


def first_of(found: Iterable[Series | None]) -> Series | None:
    """The first that holds a sample."""
    return next((series for series in found if series is not None), None)


def believable(t_s: Array) -> Array:
    """Times (n,) with NaN where one cannot be true: a day off the middle, or a second off its neighbours' median.

    Messages that come once in a while (modes, events) have no neighbours to compare with.
    """
    out = np.where((t_s >= 0.0) & (t_s < _NEVER_S), t_s, np.nan)
    known = np.flatnonzero(~np.isnan(out))
    if not known.size:
        return out
    far = np.abs(out[known] - np.median(out[known])) > _DAY_S
    out[known[far]] = np.nan
    known = known[~far]
    if known.size < 2 or np.median(np.abs(np.diff(out[known]))) > _SPARSE_S:
        return out
    stamps_us = np.rint(out[known] * 1e6).astype(np.int64)
    out[known[outliers(stamps_us, _STRAY_US)]] = np.nan
    return out


def smallest_step(values: Array) -> float:
    """The grid that (n,) values stand on, 0 where there is none to be seen."""
    known = np.empty(0)
    for rows in blocks(len(values)):
        part = values[rows]
        known = np.concatenate([known, part[np.isfinite(part)]])
        if len(known) >= _STEP_SAMPLES:
            break
    distinct = np.unique(known[:_STEP_SAMPLES])
    if distinct.size < 10:
        return 0.0  # too few to tell a grid from chance
    steps = np.diff(distinct)
    step = float(steps.min())
    on_grid = np.abs(steps / step - np.rint(steps / step)) < 0.1
    scale = float(np.abs(distinct).max())
    if step > 1e-5 * max(scale, 1e-3) and on_grid.mean() > 0.98:
        return step
    return 0.0


def runs(t_s: Array, values: NDArray[Any], end_s: float) -> tuple[Interval, ...]:
    """Intervals over which whole-number ``values`` (n,) stay the same; the last ends at ``end_s``. NaN times
    are left out."""
    known = np.isfinite(t_s)
    t_s = t_s[known]
    values = values[known]
    if not len(t_s):
        return ()
    starts = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0) + 1])
    ends = np.append(t_s[starts[1:]], max(end_s, t_s[-1]))
    out = []
    for start, end in zip(starts, ends, strict=True):
        out.append(Interval(float(t_s[start]), float(end), int(values[start])))
    return tuple(out)


def mounting(q: Array) -> tuple[float, float, float, float]:
    """The first quaternion of (n, 4) that is one, zeros where none is: some senders give a sensor's only once."""
    with np.errstate(invalid="ignore"):
        sound = np.abs(np.linalg.norm(q, axis=1) - 1.0) < _UNIT
    if not sound.any():
        return (0.0, 0.0, 0.0, 0.0)
    w, x, y, z = q[sound.argmax()].tolist()
    return (w, x, y, z)


def unflipped(q: Array) -> Array:
    """Quaternions (n, 4) of length 1 without sign jumps from one to the next, so that they can be interpolated."""
    out = Spool(np.float64, (4,))
    last = np.empty((0, 4))
    sign = 1.0
    for rows in blocks(len(q)):
        own = _of_length_1(q[rows])
        known = ~np.isnan(own[:, 0])
        # With the last one before them, so that the sign goes on.
        chain = np.concatenate([last, own[known]])
        dots = np.einsum("ij,ij->i", chain[1:], chain[:-1])
        flips = np.where(dots < 0.0, -1.0, 1.0)
        signs = sign * np.concatenate([[1.0], np.cumprod(flips)])
        if known.any():
            own[known] *= signs[len(last) :, None]
            last = chain[-1:]
            sign = float(signs[-1])
        out.append(own)
    return out.array()


def _of_length_1(q: Array) -> Array:
    """Quaternions (n, 4) of length 1, NaN for what is none."""
    believable_q = np.where(np.abs(q) < 2.0, q, np.nan)
    norm = np.linalg.norm(believable_q, axis=1, keepdims=True)
    sound = (norm > 0.9) & (norm < 1.1)
    return np.where(sound, q / np.where(sound, norm, 1.0), np.nan)
