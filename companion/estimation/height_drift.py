"""Notices that the autopilot's height drifts against the ground range, and holds the height by the range meanwhile.

Over level ground, range and height change alike. Their difference is where the ground lies in the estimator's frame:
a constant while both are right. A step of it is a step of the ground or of the estimate, and is left to others; a slope
is only met by moving level. What is left is a drift. The vehicle would follow it, into the ground where it drifts
upward: near the ground the range is the better witness, because it measures what the vehicle may hit.

With two witnesses and no third, the lower of both heights counts: the vehicle is held up by the range, and is not led
down by it. Down it is led only where the estimator's own vertical velocity agrees with the range against its height.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

from companion.estimation.range_doubt import GROUND_USED_M
from companion.estimation.surfaces import Seen, Surface
from companion.mavlink.samples import LocalPosition
from models.common.frozen_copy import with_changes

LOW_M = GROUND_USED_M
"""Higher than this nothing is compared: a beam spreads, and the ground is far."""
FADE_M_S = 0.05
"""A faster drift makes one of the two sensors a broken one: offsets, which are looked up by the range, go away."""
_MARK_S = 0.1
_WINDOWS = (4, 8, 16, 32, 64, 128)
"""In marks: from 0.4 s, for a drift that reaches the ground within a second, to 12.8 s, for one of 0.01 m/s."""
_RATE_MARKS = 12
_LEAST_M = 0.10
"""Differences below this are noise of the range, a mat on the floor, or an estimator's wander."""
_HALF_SHARE = 0.25
"""Of a window's change, in each half of it: all of it in one half is a step."""
_SLOPE = 0.35
_RANGE_SCALE = 0.1
"""What a slope explains per metre flown level, and a range that is a tenth too long per metre of height."""
_STEP_M = 0.1
"""A leap of the estimate from one position to the next that its velocity does not explain."""
_NEXT_S = 0.5
_MOVES_M_S = 0.3
"""Faster than this over ground the range says nothing about the estimate: what differs is taken for terrain."""
_BACK_M_S = 0.4
"""The vehicle is brought back to its height at most this fast."""
_CALM_S = 5.0
_CALM_M_S = 0.02
"""After so long with less drift than this the comparison is over; what was corrected stays corrected."""


class Mark(NamedTuple):
    """One comparison: the ground in the estimator's frame, also corrected and by velocity, and where it was."""

    t_s: float
    ground_m: float
    corrected_m: float
    ground_by_velocity_m: float
    north_m: float
    east_m: float
    height_m: float


@dataclass(frozen=True, kw_only=True)
class HeightDrift:
    """What is known of the drift. NED: a correction above zero says that the vehicle is lower than estimated."""

    marks: tuple[Mark, ...] = ()
    correction_m: float = 0.0
    """Added to the down coordinate of positions."""
    velocity_m_s: float = 0.0
    """Added to the down velocity while it drifts along with the height."""
    since_s: float = math.inf
    """Since when it drifts; inf while it does not."""
    rate_m_s: float = 0.0
    """Of the height estimate against the range; above zero: it climbs, the vehicle does not."""
    level_m: float = 0.0
    """The ground in the corrected frame, to be kept."""
    led_down: bool = False
    """Whether the velocity agrees with the range."""
    calm_since_s: float = math.inf
    sunk_m: float = 0.0
    """Integral of the down velocity."""
    compared_s: float = -math.inf
    down: tuple[float, float, float] = (-math.inf, 0.0, 0.0)
    """Time, down coordinate and velocity of the newest position, as received."""
    reading_m: float = math.nan
    """The ground range's newest reading, as sent."""
    changed_correction_m: float = 0.0
    """The correction when that reading came first: what it is set back to if the reading turns out to be frozen."""

    @property
    def drifts(self) -> bool:
        """Whether the estimate is drifting."""
        return self.since_s < math.inf


NO_DRIFT = HeightDrift()


def hear(drift: HeightDrift, sample: LocalPosition) -> tuple[HeightDrift, LocalPosition]:
    """One position of the autopilot, and the same as it is flown by."""
    (north, east, down), (vn, ve, vd) = sample.position_ned, sample.velocity_ned
    before_s, before_m, before_m_s = drift.down
    dt = sample.t_s - before_s
    marks = drift.marks
    correction = drift.correction_m
    sunk = drift.sunk_m
    if 0.0 < dt <= _NEXT_S:
        moved = 0.5 * (vd + before_m_s) * dt
        sunk += moved
        leap = down - before_m - moved
        if (
            abs(leap) > _STEP_M
        ):  # the estimator set its height anew: what it takes back needs no correction any more
            marks = ()
            if drift.drifts or leap * correction > 0.0:
                correction -= (
                    leap if drift.drifts else math.copysign(min(abs(leap), abs(correction)), leap)
                )
    elif marks:
        marks = ()
    drift = with_changes(
        drift, marks=marks, correction_m=correction, sunk_m=sunk, down=(sample.t_s, down, vd)
    )
    if correction == 0.0 and drift.velocity_m_s == 0.0:
        return drift, sample
    place = (north, east, down + correction)
    velocity = (vn, ve, vd + drift.velocity_m_s)
    return drift, dataclasses.replace(sample, position_ned=place, velocity_ned=velocity)


def compare(drift: HeightDrift, ground: Surface, position: LocalPosition) -> HeightDrift:
    """Compare the ground range with the newest position; ``position`` as flown by, at the same instant."""
    if ground.seen is Seen.FROZEN and not math.isnan(drift.reading_m):
        return with_changes(
            NO_DRIFT, correction_m=drift.changed_correction_m, sunk_m=drift.sunk_m, down=drift.down
        )
    if ground.seen is Seen.SURFACE and ground.slant_m != drift.reading_m:
        drift = with_changes(
            drift, reading_m=ground.slant_m, changed_correction_m=drift.correction_m
        )
    t_s = position.t_s
    marks = drift.marks
    (north, east, _), (vn, ve, _) = position.position_ned, position.velocity_ned
    if (
        ground.seen is not Seen.SURFACE
        or ground.distance_m > LOW_M
        or math.hypot(vn, ve) > _MOVES_M_S
    ):
        return (
            with_changes(drift, marks=(), compared_s=t_s) if marks else drift
        )  # the correction stays as it is
    height = ground.distance_m
    level = height + drift.down[1]
    now = Mark(
        t_s=t_s,
        ground_m=level,
        corrected_m=level + drift.correction_m,
        ground_by_velocity_m=height + drift.sunk_m,
        north_m=north,
        east_m=east,
        height_m=height,
    )
    if marks and ground.stepped_s > marks[0].t_s:
        marks = ()
    if drift.drifts:
        if marks:
            drift = _followed(drift, now)
        else:
            drift = with_changes(drift, level_m=now.ground_m + drift.correction_m)
    drift = with_changes(drift, compared_s=t_s)
    if marks and t_s - marks[-1].t_s < _MARK_S - 1e-6:
        return drift
    marks = (*marks, now)[-_WINDOWS[-1] - 1 :]
    drift = with_changes(drift, marks=marks)
    if drift.drifts:
        return _calmed(drift)
    return _noticed(drift)


def _noticed(drift: HeightDrift) -> HeightDrift:
    marks = drift.marks
    for length in _WINDOWS:
        if len(marks) <= length:
            break
        first = marks[-1 - length]
        half = marks[-1 - length // 2]
        last = marks[-1]
        change = last.corrected_m - first.corrected_m
        early = half.corrected_m - first.corrected_m
        travel = max(
            math.hypot(m.north_m - last.north_m, m.east_m - last.east_m) for m in (first, half)
        )
        climb = max(abs(m.height_m - last.height_m) for m in (first, half))
        if abs(change) < _LEAST_M + _SLOPE * travel + _RANGE_SCALE * climb:
            continue
        if not _HALF_SHARE <= early / change <= 1.0 - _HALF_SHARE:
            continue
        seconds = last.t_s - first.t_s
        by_velocity = last.ground_by_velocity_m - first.ground_by_velocity_m
        alone = abs(by_velocity) < 0.5 * abs(change)
        return with_changes(
            drift,
            since_s=last.t_s,
            rate_m_s=-change / seconds,
            level_m=first.corrected_m,
            led_down=alone,
            velocity_m_s=0.0 if alone or change > 0.0 else -by_velocity / seconds,
            calm_since_s=math.inf,
        )
    return drift


def _followed(drift: HeightDrift, now: Mark) -> HeightDrift:
    """The correction one step on: the ground stays where it was."""
    wanted = drift.level_m - now.ground_m
    if wanted < drift.correction_m and not drift.led_down:
        # The range would have the vehicle sink, and is alone with that: the ground is where both agree to put it.
        return with_changes(drift, level_m=now.ground_m + drift.correction_m)
    step = _BACK_M_S * min(max(now.t_s - drift.compared_s, 0.0), _MARK_S)
    correction = min(max(wanted, drift.correction_m - step), drift.correction_m + step)
    return with_changes(drift, correction_m=correction)


def _calmed(drift: HeightDrift) -> HeightDrift:
    """The present rate, and whether the drift is over."""
    marks = drift.marks
    if len(marks) <= _RATE_MARKS:
        return drift
    first = marks[-1 - _RATE_MARKS]
    last = marks[-1]
    rate = -(last.ground_m - first.ground_m) / (last.t_s - first.t_s)
    if abs(rate) < _CALM_M_S:
        since = min(drift.calm_since_s, last.t_s)
    else:
        since = math.inf
    if last.t_s - since >= _CALM_S:
        return with_changes(
            drift, since_s=math.inf, rate_m_s=0.0, velocity_m_s=0.0, calm_since_s=math.inf
        )
    return with_changes(drift, rate_m_s=rate, calm_since_s=since)
