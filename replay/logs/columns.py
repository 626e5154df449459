"""What every format does alike: clean columns, and the parts of a FlightLog made from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.range_beams import range_verdict
from models.common.errors import LogError
from models.common.frames import GRAVITY, Array, Whole, quaternion_of_halves
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
_FEWEST_LEVELS = 10
"""Distinct values below which a grid cannot be told from chance."""
_OFF_GRID = 0.1
_ON_GRID = 0.98
"""A step that is this far from a multiple of the smallest is off the grid; this share of the steps is on one."""
_LEAST_STEP = 1e-5
_LEAST_SCALE = 1e-3
"""A grid is no finer than this share of the largest value, or of the scale where all are smaller: rounding is."""


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

    def whole(self, field: str, missing: int = 0) -> Whole:
        """A whole-number field (n,); ``missing`` where this version of the message has none."""
        return np.nan_to_num(self.column(field), nan=missing).astype(np.int64)

    def array(self, field: str, count: int) -> Array:
        """(n, count) of an array field, ``field[0]`` and on."""
        return self.columns(*[f"{field}[{i}]" for i in range(count)])

    def where(self, mask: NDArray[Any]) -> Messages:
        """Some of the messages, by a mask (n,) or by their places, in that order."""
        if mask.dtype == bool and mask.all():
            return self
        chosen = {name: picked(values, mask) for name, values in self.data.items()}
        return Messages(self.name, picked(self.t_s, mask), chosen)

    def by(self, numbers: NDArray[Any]) -> Iterator[tuple[int, Messages]]:
        """Every number of (n,), and the messages that have it."""
        for number in np.unique(numbers).tolist():
            yield int(number), self.where(numbers == number)

    def series(self, values: Array, source: str = "") -> Series | None:
        """Values (n,) or (n, k) at the times of the messages."""
        return tidy(self.t_s, values, source or self.name)


def time_span(path: Path, stamps: Sequence[Array], names: str) -> tuple[float, float]:
    """First and last believable time [s] of several columns. Raises LogError where there is none."""
    found = believable(np.concatenate([np.empty(0), *stamps]))
    known = found[np.isfinite(found)]
    if not known.size:
        raise LogError(
            f"{path}: holds no {names} with a believable time: nothing to replay or diagnose"
        )
    return float(known.min()), float(known.max())


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
        verdict = range_verdict(value, low, high, int(share), True)
        verdicts.append(verdict)
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
        angles = euler[rows]
        halves = np.where(np.isfinite(angles), angles, np.nan).T / 2.0
        components = quaternion_of_halves(np.cos(halves), np.sin(halves))
        out.append(np.stack(components, axis=-1))
    return out.array()


def clipped_at_extreme(values: Array) -> int:
    """Samples of (n, 3) that stand exactly at an axis' extreme, where that is above 3 g and hit three times or more."""
    total = 0
    for axis in np.abs(values).T:
        extreme = np.max(axis, where=np.isfinite(axis), initial=0.0)
        hits = int(np.sum(axis == extreme))
        if extreme >= _CLIP_AT_M_S2 and hits >= _CLIP_HITS:
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


def joined(parts: Sequence[Series]) -> Series | None:
    """Samples of several records in order of time; None without a record."""
    if not parts:
        return None
    t_s = np.concatenate([part.t_s for part in parts])
    values = np.concatenate([part.values for part in parts])
    return tidy(t_s, values, parts[0].source)


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
    if distinct.size < _FEWEST_LEVELS:
        return 0.0
    steps = np.diff(distinct)
    step = float(steps.min())
    multiples = steps / step
    on_grid = np.abs(multiples - np.rint(multiples)) < _OFF_GRID
    largest = max(float(np.abs(distinct).max()), _LEAST_SCALE)
    if step > _LEAST_STEP * largest and on_grid.mean() > _ON_GRID:
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
    begins = np.append(True, np.diff(values) != 0)
    starts = t_s[begins].tolist()
    ends = [*starts[1:], max(end_s, float(t_s[-1]))]
    held = values[begins].astype(int).tolist()
    return tuple(map(Interval, starts, ends, held))


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
        signs = np.cumprod(np.append(sign, flips))
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
