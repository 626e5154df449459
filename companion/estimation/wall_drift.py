"""Notices that the autopilot's position drifts against the range to a wall: vision that froze or drifts, flow, GPS.

Range and position along the wall's normal change by opposite amounts while both are right. With dw/dt the change of
their sum, e' = dw/dt - e / T is watched: T times the speed of a drift. Which of the two is wrong cannot be told.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.estimation.surfaces import Seen, Surface
from companion.estimation.vectors import minus
from companion.mavlink.range_beams import dot
from companion.mavlink.samples import LocalPosition
from models.vehicle import Vector3

_T_S = 10.0
_LEAST_M = 0.12
"""A drift of 0.012 m/s that lasts. Less is noise of the range, and an estimator's wander."""
_SLOPE = 0.35
"""What a wall that is not flat, or not square to the beam, explains per metre flown along it."""
_SAME_COS = math.cos(math.radians(15.0))
"""A normal that turned further between two positions is another wall's."""
_NEXT_S = 0.5


class WallDrift(NamedTuple):
    """What the comparison has come to. ``apart_m`` above zero: the range grows, the position says otherwise."""

    t_s: float = -math.inf
    distance_m: float = math.nan
    normal_ned: Vector3 = (0.0, 0.0, 0.0)
    position_ned: Vector3 = (0.0, 0.0, 0.0)
    apart_m: float = 0.0
    travel_m: float = 0.0
    """Flown along the wall, forgotten as ``apart_m`` is."""
    drifts: bool = False


NO_WALL_DRIFT = WallDrift()


def compare_wall(
    before: WallDrift, wall: Surface, position: LocalPosition, near_m: float, reset_s: float
) -> WallDrift:
    """One position and the wall at the same instant; ``reset_s``: when the estimator last set its position anew."""
    if wall.seen is not Seen.SURFACE or wall.normal_ned is None or wall.distance_m > near_m:
        return NO_WALL_DRIFT
    now = WallDrift(position.t_s, wall.distance_m, wall.normal_ned, position.position_ned)
    dt = now.t_s - before.t_s
    same = dot(wall.normal_ned, before.normal_ned) > _SAME_COS
    if not 0.0 < dt <= _NEXT_S or not same or wall.stepped_s > before.t_s:
        return now
    moved = minus(now.position_ned, before.position_ned)
    toward = dot(moved, wall.normal_ned)
    along = math.sqrt(max(moved[0] * moved[0] + moved[1] * moved[1] - toward * toward, 0.0))
    change = wall.distance_m - before.distance_m + toward
    if before.t_s < reset_s <= now.t_s:  # a leap of the frame, known as such
        change = 0.0
        along = 0.0
    kept = max(1.0 - dt / _T_S, 0.0)
    apart = before.apart_m * kept + change
    travel = before.travel_m * kept + along
    most = _LEAST_M + _SLOPE * travel
    return now._replace(
        apart_m=apart, travel_m=travel, drifts=abs(apart) > (0.5 * most if before.drifts else most)
    )
