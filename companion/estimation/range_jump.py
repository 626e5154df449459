"""A range that jumps while the vehicle stays where it is: the surface may have moved, or the sensor is wrong.

The vehicle cannot tell which, so no offset uses the new distance. A real edge is left behind by moving on. A wrong
reading comes back by itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from models.vehicle import Vector3

_JUMP_M = 0.25
"""A shorter jump is an object on the ground or an uneven wall."""
_BACK_M = 0.10
"""So near to its old place the surface is back: by so much the outliers of a track may differ."""
_MOVED_M = 0.3
"""Having moved so far along the surface, the vehicle has left an edge of a table or of a wall behind."""
_TURNED_COS = math.cos(math.radians(15.0))
"""A beam that turned further looks at another place."""


class OldPlace(NamedTuple):
    """Where a surface was before its range jumped (distance [m], direction NED), and the vehicle then (NED [m])."""

    distance_m: float
    normal_ned: Vector3
    position_ned: Vector3


def jumped(old: OldPlace, distance_m: float) -> OldPlace | None:
    """``old`` where a reading of ``distance_m`` from the same position is a jump."""
    return old if abs(distance_m - old.distance_m) > _JUMP_M else None


def remembered(old: OldPlace, distance_m: float, normal_ned: Vector3, position_ned: Vector3) -> OldPlace | None:
    """``old`` until the reading is back, or the vehicle has moved along the surface or turned."""
    moved = [now - before for now, before in zip(position_ned, old.position_ned, strict=True)]
    nearer = sum([m * n for m, n in zip(moved, old.normal_ned, strict=True)])
    along = math.sqrt(max(sum([m * m for m in moved]) - nearer * nearer, 0.0))
    turned = sum([a * b for a, b in zip(normal_ned, old.normal_ned, strict=True)]) < _TURNED_COS
    back = abs(distance_m - (old.distance_m - nearer)) < _BACK_M
    return None if back or turned or along > _MOVED_M else old
