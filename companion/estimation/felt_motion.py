"""How far the accelerometers have carried the vehicle: a witness beside position and range.

Acceleration is summed twice, and forgotten at each sum with the time T: a bias b leaves b T^2 at
most. What lasts longer than a mean of 10 s, as the trim of an attitude does, leaves nothing.
``passed`` does the same to a way: it takes the high pass s T / (1 + s T) twice.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.estimation.vectors import Level, lagged, turned
from companion.mavlink.samples import Imu
from models.common.frames import Rows

_T_S = 2.0
_MEAN_S = 10.0
_NEXT_S = 0.5


class Felt(NamedTuple):
    """North and east: mean acceleration [m/s^2], velocity [m/s] and way [m] since a moment ago."""

    t_s: float = -math.inf
    mean: Level = (0.0, 0.0)
    velocity: Level = (0.0, 0.0)
    place: Level = (0.0, 0.0)
    gained: Level = (0.0, 0.0)
    """The velocity gained since the beginning: its differences count."""


UNFELT = Felt()


def feel(felt: Felt, rows: Rows | None, sample: Imu) -> Felt:
    """One reading of an accelerometer more; ``rows``: the attitude."""
    force = sample.specific_force_frd
    if rows is None or not all(map(math.isfinite, force)):
        return felt
    north, east, _ = turned(rows, force)
    dt = sample.t_s - felt.t_s
    if not 0.0 < dt <= _NEXT_S:
        return Felt(sample.t_s, (north, east))
    mean = lagged(felt.mean, (north, east), dt / _MEAN_S)
    step = ((north - mean[0]) * dt, (east - mean[1]) * dt)
    first = _passed(felt.velocity, step, dt)
    return Felt(
        t_s=sample.t_s,
        mean=mean,
        velocity=first,
        place=_passed(felt.place, (first[0] * dt, first[1] * dt), dt),
        gained=(felt.gained[0] + step[0], felt.gained[1] + step[1]),
    )


def _passed(old: Level, step: Level, dt: float) -> Level:
    kept = 1.0 - dt / _T_S
    return (old[0] + step[0]) * kept, (old[1] + step[1]) * kept


def passed(old: Level, step: float, dt: float) -> Level:
    """A way high-passed once and twice, after one ``step`` [m] more."""
    once = (old[0] + step) * (1.0 - dt / _T_S)
    return once, (old[1] + once - old[0]) * (1.0 - dt / _T_S)
