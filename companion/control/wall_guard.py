"""A vehicle that a gust drives into a wall leans further away than it otherwise may, and away from the wall first."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.disturbance.records import Disturbance
from companion.estimation.surfaces import Seen
from models.vehicle import Vector3

_ANSWER_S = 0.25
"""A setpoint is answered so much later: the lag of ArduCopter's attitude loop."""
_BRAKE_M_S2 = 1.0
"""What the ordinary tilt of the hold leaves for braking in a wind that takes 1.6 m/s^2 of it."""
_ROOM_M = 0.05
"""Lips this near to a wall are about to touch it, however slowly."""
_CLEAR_M = 0.20
"""So far from it the danger is over."""
_BLIND_S = 3.0
"""At the wall itself a range sensor sees nothing, being too near: for so long its word is not waited for."""
_LEVEL_SHARE = 0.1
"""A plane whose normal is more upright than this has no level direction."""


@dataclass(frozen=True, slots=True)
class WallAhead:
    """A wall that the vehicle could not stop before: level unit vector towards it, and when that was last seen."""

    north: float
    east: float
    seen_s: float


def level_wall(disturbance: Disturbance | None) -> tuple[float, float] | None:
    """Level unit vector towards the wall that is seen."""
    if disturbance is None:
        wall = None
    else:
        wall = disturbance.wall
    if wall is None or wall.seen is not Seen.SURFACE or wall.normal_ned is None:
        return None
    north, east, _ = wall.normal_ned
    size = math.hypot(north, east)
    if size < _LEVEL_SHARE:
        return None
    return (north / size, east / size)


def watch_wall(
    before: WallAhead | None, disturbance: Disturbance | None, velocity: Vector3, t_s: float
) -> WallAhead | None:
    """Whether a wall is about to be hit, or was and is not yet clear of the vehicle. ``velocity``: NED, m/s."""
    towards = level_wall(disturbance)
    if disturbance is None or towards is None:
        if before is not None and 0.0 <= t_s - before.seen_s < _BLIND_S:
            return before
        return None
    north, east = towards
    closing = max(north * velocity[0] + east * velocity[1], 0.0)
    reach_m = closing * _ANSWER_S + closing * closing / (2.0 * _BRAKE_M_S2) + _ROOM_M
    if min(disturbance.d_m) < (reach_m if before is None else max(reach_m, _CLEAR_M)):
        return WallAhead(north, east, t_s)
    return None
