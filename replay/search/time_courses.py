"""What an unknown force may do in time, with no other channel: a swing of one frequency, and a change that lasts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import Array
from replay.residual.record import Record
from replay.search.beginnings import BESIDE_S
from replay.search.swings import LINES, Swing, strongest_swing

ONSET_S = 8.0
"""How long a change may take to come [s]."""
MOST = 0.5
"""More than this share of an axis's energy is in what is called its swing. The same of a velocity: it is flown so."""


@dataclass(frozen=True)
class TimeCourse:
    """What a reader is told of a force that follows time alone: its frequency, or the time from which on it acts."""

    swing_hz: float | None = None
    since_s: float | None = None

    @property
    def in_words(self) -> str:
        """``a swing at 0.7 Hz`` or ``a change at 102 s that lasts``."""
        if self.swing_hz is not None:
            return f"a swing at {self.swing_hz:.2g} Hz"
        return f"a change at {self.since_s:.0f} s that lasts"

    @property
    def to_look_for(self) -> str:
        """What a person may look for: ``what swings at 0.7 Hz`` or ``what began at 102 s and stayed``."""
        if self.swing_hz is not None:
            return f"what swings at {self.swing_hz:.2g} Hz"
        return f"what began at {self.since_s:.0f} s and stayed"

    def as_json(self) -> dict[str, float]:
        """Frequency or beginning."""
        if self.swing_hz is not None:
            return {"swing_hz": self.swing_hz}
        if self.since_s is not None:
            return {"since_s": self.since_s}
        return {}


def time_courses(record: Record, axis: int) -> tuple[tuple[TimeCourse, Array], ...]:
    """The swing that has most of the energy of an axis, and the best change, each with its columns (n, k).

    None where the flight is too short.
    """
    courses = (_swing(record, axis), _change(record, axis))
    return tuple(course for course in courses if course is not None)


def _swing(record: Record, axis: int) -> tuple[TimeCourse, Array] | None:
    """cos and sin of the strongest line of the periodogram and of its neighbours; None where the vehicle flies so.

    A frequency between two lines is the sum of all three.
    """
    swing = strongest_swing(record, record.residual[:, axis])
    if swing.share <= MOST or _flown(record, swing):
        return None
    columns = []
    for line in LINES:
        phase = 2.0 * np.pi * (swing.hz + line * swing.line_hz) * record.time_s
        columns += [np.cos(phase), np.sin(phase)]
    return TimeCourse(swing_hz=swing.hz), np.stack(columns, axis=1)


def _flown(record: Record, swing: Swing) -> bool:
    """Whether the vehicle itself swings so: what then goes with time goes with its motion, too."""
    for velocity in record.context.state.velocity_ned.T:
        flown = strongest_swing(record, velocity)
        near = abs(flown.hz - swing.hz) < 1.5 * swing.line_hz
        if near and flown.share > MOST:
            return True
    return False


def _change(record: Record, axis: int) -> tuple[TimeCourse, Array] | None:
    """1 and exp(-(t - t0) / ONSET_S) from t0 on: a change at once, or one that comes slowly."""
    since_s = _change_at(record, record.residual[:, axis])
    if since_s is None:
        return None
    after_s = record.time_s - since_s
    begun = after_s >= 0.0
    slowly = np.where(begun, np.exp(-np.maximum(after_s, 0.0) / ONSET_S), 0.0)
    columns = np.stack([begun.astype(float), slowly], axis=1)
    return TimeCourse(since_s=since_s), columns


def _change_at(record: Record, x: Array) -> float | None:
    """The time at which x (n,) is best cut into two levels; None where no time has enough flight on both sides.

    With S_k the sum of the first k of n samples, less k times the mean, the cut takes S_k^2 n / (k (n - k)) off the sum
    of squares (Page 1955, Biometrika 42, 523).
    """
    judged = np.flatnonzero(record.valid)
    count = len(judged)
    beside = int(np.ceil(BESIDE_S / record.step_s))
    if count <= 2 * beside:
        return None
    of_judged = x[judged]
    cut_sum = np.cumsum(of_judged - of_judged.mean())[:-1]
    before = np.arange(1, count)
    gain = cut_sum**2 * count / (before * (count - before))
    inside = slice(beside, count - beside)
    first_after = beside + int(np.argmax(gain[inside])) + 1
    return float(record.time_s[judged[first_after]])
