"""The hold is sent no nearer to a wall than its loop holds the pull there: targets end at the least distance."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.control.position_hold import Hold
from companion.control.position_target import way_to_stop
from companion.control.wall_guard import level_wall
from companion.disturbance.records import Disturbance
from companion.estimation.surfaces import Seen
from companion.mavlink.samples import LocalPosition
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3

_BLIND_S = 3.0
"""A wall that is not seen any more, as it is too near, is where it was for so long."""
_BAND_M = 0.02
"""A place is moved once it is so much too near: less is the range's noise."""


class WallPlane(NamedTuple):
    """A wall in NED: level unit vector towards it, and how far the vehicle can go along it until a lip touches."""

    north: float
    east: float
    reach_m: float
    seen_s: float

    def shifted(self, by_ned: Vector3) -> WallPlane:
        """The same wall after the origin of positions moved."""
        north, east, _ = by_ned
        return self._replace(reach_m=self.reach_m + self.north * north + self.east * east)

    def lip_m(self, place: Vector3) -> float:
        """Distance of the nearest lip of a vehicle at ``place``."""
        return self.reach_m - self.north * place[0] - self.east * place[1]


def see_wall(
    before: WallPlane | None, disturbance: Disturbance | None, position: LocalPosition, t_s: float
) -> WallPlane | None:
    """The wall that is seen now, or was a moment ago."""
    towards = level_wall(disturbance)
    if disturbance is None or towards is None:
        gone = disturbance is not None and disturbance.wall.seen is Seen.NOTHING
        if gone or before is None or t_s - before.seen_s > _BLIND_S:
            return None
        return before
    north, east = towards
    age_s = t_s - position.t_s
    here_n = position.position_ned[0] + position.velocity_ned[0] * age_s
    here_e = position.position_ned[1] + position.velocity_ned[1] * age_s
    reach = min(disturbance.d_m) + north * here_n + east * here_e
    return WallPlane(north, east, reach, t_s)


def sent_to_m(hold: Hold, wall: WallPlane) -> float:
    """How far from the wall the hold goes: its target, or where it can stop."""
    return wall.lip_m(_place(hold))


def kept_off(hold: Hold, wall: WallPlane, least_m: float) -> Hold:
    """The hold with a target that ends ``least_m`` from the wall, where it led nearer."""
    place = _place(hold)
    short_m = least_m - wall.lip_m(place)
    if short_m <= _BAND_M:
        return hold
    north = place[0] - short_m * wall.north
    east = place[1] - short_m * wall.east
    target = hold.target
    down = target.position[2]
    speed = (0.0, 0.0, target.velocity[2])
    return hold._replace(target=with_changes(target, position=(north, east, down), velocity=speed))


def _place(hold: Hold) -> Vector3:
    """Where the target leads, axis by axis; a velocity alone: where the hold would stop."""
    axes = zip(
        hold.target.position,
        hold.reference.position,
        way_to_stop(hold.target.velocity),
        strict=True,
    )
    north, east, down = (_along_axis(*axis) for axis in axes)
    return north, east, down


def _along_axis(wanted: float, here: float, further: float) -> float:
    if math.isnan(wanted):
        return here + further
    return wanted
