"""Readings of a rangefinder that its own vehicle's motion contradicts: a lost echo, a frozen value, a jump.

One rule for flight and replay. A near surface does not vanish while the vehicle stays where it is, and a reading does
not stay the same to the millimetre while the vehicle moves along the beam.

Where a range jumps while the vehicle stays where it is, the surface may have moved, or the sensor is wrong. The vehicle
cannot tell which, so no offset uses the new distance. A real edge is left behind by moving on. A wrong reading comes
back by itself.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from companion.estimation.vectors import minus, plus, scaled
from companion.mavlink.range_beams import dot
from models.vehicle import Vector3

_SAME_READING_M = 0.0005
"""Half a millimetre: readings are sent in centimetres or, on some links, in millimetres."""
_FROZEN_MOVE_M = 0.10
"""Ten of the centimetres in which ranges are sent: a reading that did not change over this motion is frozen."""
_TURNED_COS = math.cos(math.radians(15.0))
"""A beam that turned further looks at another place: half of the 30 degrees at which an echo is lost."""
GROUND_USED_M = 4.0
"""Up to here the ground range may correct the height (``height_drift``): so far a frozen one is looked for. One that
was taken for true held a vehicle up without end: 4 m too high on a real PX4."""
PAST_EDGE_M = 0.3
"""A wall may end this far to the side ..."""
_OVER_EDGE_M = 1.0
"""... and the ground at an edge this far on; nearer than that an echo that is gone is lost."""

_JUMP_M = 0.25
"""A shorter jump is an object on the ground or an uneven wall."""
_BACK_M = 0.10
"""So near to its old place the surface is back: by so much the outliers of a track may differ."""
_MOVED_M = 0.3
"""Having moved so far along the surface, the vehicle has left an edge of a table or of a wall behind."""


class Why(Enum):
    """Why a reading is not used."""

    LOST = "lost its echo"
    FROZEN = "frozen"


class Sighting(NamedTuple):
    """Where the vehicle was and where the beam looked (NED) when it read ``slant_m`` (inf: nothing within range)."""

    slant_m: float
    position_ned: Vector3
    beam_ned: Vector3


class Doubt(NamedTuple):
    """Whether the newest reading is doubted, and the readings that the next one is compared with."""

    why: Why | None
    same_since: Sighting | None
    """The first of the present run of readings that are equal to the millimetre."""
    sight: Sighting | None
    """The newest reading that was used."""


UNREAD = Doubt(None, None, None)
"""Before the first reading."""


def doubt(here: Sighting, before: Doubt, near_m: float, target: str) -> Doubt:
    """The doubt about reading ``here`` after ``before``. Only surfaces nearer than ``near_m`` are looked at, and of a
    ground that is used further away, whether its reading is frozen."""
    last = before.sight
    run = before.same_since
    if (
        last is not None
        and last.slant_m < near_m < here.slant_m - last.slant_m
        and not _left(last, here, near_m, target)
    ):
        return Doubt(Why.LOST, None, last)
    if run is None or abs(here.slant_m - run.slant_m) > _SAME_READING_M:
        run = here
    if target == "ground":
        used_m = max(near_m, GROUND_USED_M)
    else:
        used_m = near_m
    # Back at the height where it froze, a reading that never changed is no truer.
    still = before.why is Why.FROZEN and run is before.same_since
    moved_m = abs(dot(minus(here.position_ned, run.position_ned), run.beam_ned))
    if here.slant_m < used_m and (still or moved_m > _FROZEN_MOVE_M):
        return Doubt(Why.FROZEN, run, last)
    return Doubt(None, run, here)


def _left(last: Sighting, here: Sighting, near_m: float, target: str) -> bool:
    """Whether the vehicle's own motion explains that a near surface is out of sight."""
    moved = minus(here.position_ned, last.position_ned)
    beam = last.beam_ned
    away = -dot(moved, beam)
    aside = math.hypot(*plus(moved, scaled(beam, away)))
    turned = dot(here.beam_ned, beam) < _TURNED_COS
    return (
        turned
        or last.slant_m + away > near_m
        or aside > (_OVER_EDGE_M if target == "ground" else PAST_EDGE_M)
    )


class OldPlace(NamedTuple):
    """Where a surface was before its range jumped (distance [m], direction NED), and the vehicle then (NED [m]).

    ``facing_ned``: the direction in which it looked.
    """

    distance_m: float
    normal_ned: Vector3
    facing_ned: Vector3
    position_ned: Vector3


def jumped(old: OldPlace, distance_m: float, near_m: float) -> OldPlace | None:
    """``old`` where a reading of ``distance_m`` from the same position is a jump from or to where it matters."""
    near = min(old.distance_m, distance_m) <= near_m
    if near and abs(distance_m - old.distance_m) > _JUMP_M:
        return old
    return None


def remembered(
    old: OldPlace, distance_m: float, facing_ned: Vector3, position_ned: Vector3
) -> OldPlace | None:
    """``old`` until the reading is back, or the vehicle has moved along the surface or turned.

    ``distance_m``: of what is seen now, along the normal of the old place.
    """
    moved = minus(position_ned, old.position_ned)
    nearer = dot(moved, old.normal_ned)
    along = math.sqrt(max(dot(moved, moved) - nearer * nearer, 0.0))
    turned = dot(facing_ned, old.facing_ned) < _TURNED_COS
    back = abs(distance_m - (old.distance_m - nearer)) < _BACK_M
    if back or turned or along > _MOVED_M:
        return None
    return old
