"""Notices that position and wall range part, and holds the place across the wall by the range.

While both are right, range d and position p along the wall's normal n change by opposite amounts:
w = d + p n stays.
With dw/dt, e' = dw/dt - e / T is watched: T times the speed of a drift.

Which of the two is wrong is told by what the accelerometers have felt: two that agree win. Where
they cannot tell, the nearer wall counts. The vehicle is held off by the range, and is not led to
the wall by it.
"""

from __future__ import annotations

import dataclasses
import math
from enum import Enum
from typing import NamedTuple

from companion.estimation.felt_motion import UNFELT, Felt, passed
from companion.estimation.surfaces import Seen, Surface
from companion.estimation.vectors import clipped, minus, plus, scaled
from companion.mavlink.range_beams import dot
from companion.mavlink.samples import LocalPosition
from models.vehicle import Vector3

_T_S = 10.0
_LEAST_M = 0.12
"""A drift of 0.012 m/s that lasts. Less is noise of the range, and an estimator's wander."""
_SURE_M = 0.08
"""So much is enough where the accelerometers say as well that the position is wrong."""
_SLOPE = 0.35
"""What a wall that is not flat, or not square to the beam, explains per metre flown along it."""
_SAME_COS = math.cos(math.radians(15.0))
"""A normal that turned further between two positions is another wall's."""
_NEXT_S = 0.5
_LEAP_M = 0.2
"""No vehicle beside a wall moves so far from one reading to the next: the range itself leapt."""
_BESIDE_M = 0.12
"""Two readings of one wall: at 0.5 m/s and ten readings a second, with their noise."""
_LEAPS_S = 0.5
_LEAPS_M = 0.06
"""The same for a position that leaps or is pulled away: forgotten sooner, noticed sooner."""
_SEEN_1_S = 3.0
"""Bandwidth [rad/s] with which range and accelerometers make one motion."""
_BACK_M_S = 0.4
"""What came apart before it was noticed is taken back at most this fast."""
_TELLS_M = 0.03
"""By so much one witness must be nearer to what was felt than the other."""
_REVISES_M = 0.1
"""The same, to take back that the position is wrong: the first word is of a few centimetres of motion."""
_AGREED_S = 2.0
"""Mean over which a bias of the accelerometer is seen while range and position agree."""
_FELT_AGE_S = 0.2
_MOST_UNFELT_M = 0.5
"""Where no accelerometer is heard, a range that repeats itself would drive the vehicle off without end."""
_STILL = (0.0, 0.0)


class Wrong(Enum):
    """Which of the two the accelerometers contradict."""

    POSITION = "position"
    RANGE = "range"


class WallDrift(NamedTuple):
    """What the comparison has come to. ``apart_m`` above zero: the range grows, the position says otherwise."""

    t_s: float = -math.inf
    met_ned: Vector3 | None = None
    """Where the last reading ended, from the CG, carried on by the position."""
    range_m: float = math.nan
    """The distance by that."""
    read_m: float = math.nan
    """The last reading that counts."""
    outlier_m: float = math.nan
    """A newer one that is far from it: it counts if the next is beside it."""
    heard_s: float = -math.inf
    """When the newest came."""
    way_m: float = 0.0
    """Of the position towards the wall since the last reading that counts."""
    normal_ned: Vector3 = (0.0, 0.0, 0.0)
    position_ned: Vector3 = (0.0, 0.0, 0.0)
    """As the autopilot sent it."""
    apart_m: float = 0.0
    leapt_m: float = 0.0
    """The same, sooner forgotten."""
    travel_m: tuple[float, float] = _STILL
    """Flown along the wall north and east, forgotten as ``apart_m`` is."""
    drifts: bool = False
    wrong: Wrong | None = None
    """As long as it drifts; None: it could not be told."""
    by_range: tuple[float, float] = _STILL
    by_position: tuple[float, float] = _STILL
    """Towards the wall, high-passed once and twice: see ``felt``."""
    seen: tuple[float, float] = _STILL
    """Minus the range [m], and its rate [m/s], by range and accelerometers."""
    gained_m_s: float = math.nan
    """The velocity towards the wall gained so far: as felt, else as the position has it."""
    felt_off_m: float = math.nan
    """What was felt beyond both while they agreed: a bias of the accelerometer."""
    owed_m: float = 0.0
    """What had come apart before, and is still to be taken back."""
    anchor_m: float = math.nan
    """While the range counts: the place across the wall is this plus ``seen``."""
    began_m: float = 0.0
    """The correction across the wall when the drift began."""
    correction_ned: Vector3 = (0.0, 0.0, 0.0)
    """Added to positions."""

    @property
    def holds_off(self) -> bool:
        """Whether the place across the wall is held by the range."""
        return self.drifts and self.wrong is not Wrong.RANGE


NO_WALL_DRIFT = WallDrift()


def corrected(
    drift: WallDrift, sample: LocalPosition, felt: Felt = UNFELT
) -> tuple[WallDrift, LocalPosition]:
    """A position of the autopilot, and the same as it is flown by."""
    velocity = sample.velocity_ned
    dt = sample.t_s - drift.t_s
    if not math.isnan(drift.anchor_m) and 0.0 <= dt <= _NEXT_S:
        normal = drift.normal_ned
        seen_m, rate = drift.seen
        unfelt = abs(sample.t_s - felt.t_s) > _FELT_AGE_S
        if not unfelt:
            rate += felt.gained[0] * normal[0] + felt.gained[1] * normal[1] - drift.gained_m_s
        old = dot(drift.correction_ned, normal)
        wanted = drift.anchor_m + seen_m + rate * dt - dot(sample.position_ned, normal)
        if drift.wrong is None:
            # The range would have the vehicle fly to the wall, and is alone with that.
            wanted = max(wanted, min(old, 0.0))
            if unfelt:
                wanted = min(wanted, max(old, _MOST_UNFELT_M))
        by = plus(drift.correction_ned, scaled(normal, wanted - old))
        drift = drift._replace(correction_ned=by)
        velocity = plus(velocity, scaled(normal, rate - dot(velocity, normal)))
    if drift.correction_ned == NO_WALL_DRIFT.correction_ned:
        return drift, sample
    place = plus(sample.position_ned, drift.correction_ned)
    return drift, dataclasses.replace(sample, position_ned=place, velocity_ned=velocity)


def compare_wall(
    before: WallDrift,
    wall: Surface,
    position: LocalPosition,
    near_m: float,
    reset_s: float,
    felt: Felt = UNFELT,
) -> WallDrift:
    """One position and the wall at the same instant; ``position`` is the one that is flown by.

    ``reset_s``: when the estimator last set its position anew.
    """
    dt = position.t_s - before.t_s
    if wall.seen is not Seen.SURFACE and 0.0 < dt <= _NEXT_S:
        return before
    if wall.seen is not Seen.SURFACE or wall.normal_ned is None or wall.distance_m > near_m:
        return NO_WALL_DRIFT._replace(correction_ned=before.correction_ned)
    now = _sighted(before.correction_ned, wall, wall.normal_ned, position, felt)
    same = 0.0 < dt <= _NEXT_S and dot(now.normal_ned, before.normal_ned) > _SAME_COS
    if not same or before.met_ned is None:
        return now
    met_ned = before.met_ned
    before = _turned(before, met_ned, now.normal_ned)
    now = _parted(before, met_ned, now, dt, leapt=before.t_s < reset_s <= now.t_s)
    if not now.drifts and abs(now.apart_m) > _SURE_M + _bent_m(now):
        surely = _wrong(before, now, felt, _TELLS_M) is Wrong.POSITION
        now = now._replace(drifts=surely)
    if not now.drifts:
        off = _felt_m(now, felt) - 0.5 * (now.by_range[1] + now.by_position[1])
        if not math.isnan(before.felt_off_m):
            off = before.felt_off_m + (off - before.felt_off_m) * min(dt / _AGREED_S, 1.0)
        return now._replace(felt_off_m=off, began_m=dot(now.correction_ned, now.normal_ned))
    return _anchored(before, now, dot(position.position_ned, now.normal_ned), felt, dt)


def _sighted(
    correction: Vector3, wall: Surface, normal: Vector3, position: LocalPosition, felt: Felt
) -> WallDrift:
    """A wall seen for the first time."""
    # The track of the range is led by the velocity, which may be wrong: the reading itself counts.
    range_m = math.nan if wall.met_ned is None else dot(wall.met_ned, normal)
    velocity = dot(position.velocity_ned, normal)
    if abs(position.t_s - felt.t_s) <= _FELT_AGE_S:
        gained = felt.gained[0] * normal[0] + felt.gained[1] * normal[1]
    else:
        gained = velocity
    return WallDrift(
        t_s=position.t_s,
        met_ned=wall.met_ned,
        range_m=range_m,
        read_m=range_m,
        heard_s=wall.heard_s,
        normal_ned=normal,
        position_ned=minus(position.position_ned, correction),
        seen=(-range_m, velocity),
        gained_m_s=gained,
        correction_ned=correction,
    )


def _turned(before: WallDrift, met_ned: Vector3, normal: Vector3) -> WallDrift:
    """The same with ``met_ned`` on a wall that is now known to run square to ``normal``: nothing moved by that."""
    range_m = dot(met_ned, normal)
    nearer_m = before.range_m - range_m
    place_m, rate = before.seen
    return before._replace(
        range_m=range_m,
        read_m=before.read_m - nearer_m,
        outlier_m=before.outlier_m - nearer_m,
        seen=(place_m + nearer_m, rate),
    )


def _parted(
    before: WallDrift, met_ned: Vector3, now: WallDrift, dt: float, *, leapt: bool
) -> WallDrift:
    """How far both have come apart since a reading that ended at ``met_ned``.

    ``leapt``: the position was set anew, and that is known.
    """
    normal = now.normal_ned
    moved = minus(now.position_ned, before.position_ned)
    toward = dot(moved, normal)
    along = (moved[0] - toward * normal[0], moved[1] - toward * normal[1])
    if leapt:
        toward = 0.0
        along = _STILL
    seen = before.seen
    way = before.way_m + toward
    reading = now.range_m
    # Too near, no echo, nothing new, or perhaps an outlier: the position carries the range on.
    closed = toward
    if math.isnan(reading) or now.heard_s == before.heard_s:
        counts = False
        now = now._replace(read_m=before.read_m, outlier_m=before.outlier_m)
    elif min(abs(reading - before.read_m), abs(reading - before.outlier_m)) <= _BESIDE_M:
        counts = True
        closed = before.range_m - reading
    else:
        counts = False
        now = now._replace(read_m=before.read_m, outlier_m=reading)
    if counts and abs(way) <= _LEAP_M < abs(closed - toward):
        seen = (seen[0] + closed - toward, seen[1])
        closed = toward
    if counts:
        place = -reading
    else:
        place = math.nan
        now = now._replace(
            met_ned=minus(met_ned, scaled(normal, toward)),
            range_m=before.range_m - toward,
            way_m=way,
        )
    kept = max(1.0 - dt / _T_S, 0.0)
    apart = before.apart_m * kept + toward - closed
    travel = (before.travel_m[0] * kept + along[0], before.travel_m[1] * kept + along[1])
    sooner = before.leapt_m * max(1.0 - dt / _LEAPS_S, 0.0) + toward - closed
    now = now._replace(apart_m=apart, leapt_m=sooner, travel_m=travel)
    bent_m = _bent_m(now)
    if before.drifts:
        drifts = abs(apart) > 0.5 * (_LEAST_M + bent_m)
    else:
        drifts = abs(apart) > _LEAST_M + bent_m or abs(sooner) > _LEAPS_M + bent_m
    return now._replace(
        drifts=drifts,
        by_range=passed(before.by_range, closed, dt),
        by_position=passed(before.by_position, toward, dt),
        seen=_watched(
            seen=seen,
            gained=now.gained_m_s - before.gained_m_s,
            place=place,
            dt=dt,
            unread_s=min(now.heard_s - before.heard_s, _NEXT_S),
        ),
    )


def _anchored(
    before: WallDrift, now: WallDrift, flown_m: float, felt: Felt, dt: float
) -> WallDrift:
    """Who is wrong, and the place across the wall by the range; ``flown_m``: the place flown by."""
    if before.wrong is Wrong.POSITION:
        least_m = _REVISES_M
    else:
        least_m = _TELLS_M
    wrong = _wrong(before, now, felt, least_m) or before.wrong
    now = now._replace(felt_off_m=before.felt_off_m, began_m=before.began_m, wrong=wrong)
    if wrong is Wrong.RANGE:
        return now
    if math.isnan(before.anchor_m):
        given_m = dot(now.correction_ned, now.normal_ned) - now.began_m
        return now._replace(anchor_m=flown_m - now.seen[0], owed_m=_owed(-now.apart_m, given_m))
    step = clipped(before.owed_m, _BACK_M_S * dt)
    return now._replace(anchor_m=before.anchor_m + step, owed_m=before.owed_m - step)


def _owed(parted_m: float, given_m: float) -> float:
    """What is still to be taken back, where the correction has grown by ``given_m`` since they parted."""
    if parted_m > 0.0:
        owed_m = max(parted_m - given_m, 0.0)
    else:
        owed_m = min(parted_m - given_m, 0.0)
    return owed_m


def _felt_m(now: WallDrift, felt: Felt) -> float:
    """The way towards the wall that was felt."""
    return felt.place[0] * now.normal_ned[0] + felt.place[1] * now.normal_ned[1]


def _bent_m(now: WallDrift) -> float:
    """What a wall that is not flat explains on the way along it."""
    return _SLOPE * math.hypot(*now.travel_m)


def _wrong(before: WallDrift, now: WallDrift, felt: Felt, least_m: float) -> Wrong | None:
    """Which of both is further from what was felt, by ``least_m`` and more; None: it cannot be told."""
    if abs(now.t_s - felt.t_s) > _FELT_AGE_S:
        return None
    felt_m = _felt_m(now, felt) - before.felt_off_m
    range_off = abs(now.by_range[1] - felt_m)
    position_off = abs(now.by_position[1] - felt_m)
    if range_off + least_m < position_off:
        return Wrong.POSITION
    if position_off + least_m < range_off:
        return Wrong.RANGE
    return None


def _watched(
    *, seen: tuple[float, float], gained: float, place: float, dt: float, unread_s: float
) -> tuple[float, float]:
    """One step on: x' = v + 1.4 w e, v' = a + w^2 e with the error e = ``place`` - x.

    A place that is read only now counts for the time ``unread_s`` since the last one.
    """
    x, v = seen
    x += (v + 0.5 * gained) * dt
    v += gained
    if math.isfinite(place):
        error = (place - x) * unread_s
        x += 1.4 * _SEEN_1_S * error
        v += _SEEN_1_S**2 * error
    return x, v
