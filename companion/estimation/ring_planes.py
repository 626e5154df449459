"""The walls that a ring of range directions sees: nearest planes by a line through neighbouring returns.

Returns are put on the ground plan (level, NED, from the CG): an upright wall is a straight line there, whatever tilt of
the vehicle and slant of the beams. A line ``n . p = D`` is fitted by total least squares: ``n`` is the direction of
least spread of the points, tan(2 a) = 2 Sxy / (Sxx - Syy) gives that of their greatest (Pearson 1901). One rule for
flight and replay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from companion.estimation.range_geometry import (
    ANOTHER_WALL_RAD,
    FAR_RADII,
    GROUND_MARGIN_M,
    MAX_INCIDENCE_RAD,
    NO_MATTER_RADII,
)
from companion.estimation.vectors import plus, scaled, turned
from companion.mavlink.samples import Ring
from models.common.frames import Rows
from models.vehicle import Vector3, Vehicle

_WINDOWS_RAD = (
    (math.radians(50.0), MAX_INCIDENCE_RAD),
    (math.radians(25.0), MAX_INCIDENCE_RAD),
    (math.radians(95.0), math.radians(50.0)),
)
"""A line is fitted to returns so far to both sides of the nearest one, and may be turned so far from it. 50 degrees
reach the next of a ring of eight, 95 the next but one, where the echo between them is lost."""
_FINE_RAD = math.radians(15.0)
"""In a ring of finer steps a wall shows in two directions at least: a single return is none."""
_GROUND_MARGIN_SHARE = math.tan(math.radians(1.0))
"""Of a slant, beside ``GROUND_MARGIN_M``: attitude and reading differ by so much in a vehicle that turns at 20 degrees
per second and sends ranges 50 ms late. Low in a corner the ground seen 4 m away was taken for a second wall."""
_OFF_LINE_M = 0.02
_OFF_LINE_SHARE = 0.02
"""How far a return may lie off its line: three sigma of a good lidar with 1 cm steps, and a share of its range."""


class _Return(NamedTuple):
    """One return: place on the ground plan from the CG [m], slant [m], and beam (NED, unit)."""

    north_m: float
    east_m: float
    slant_m: float
    beam_ned: Vector3

    @property
    def bearing_rad(self) -> float:
        return math.atan2(self.beam_ned[1], self.beam_ned[0])

    def off(self, bearing_rad: float, distance_m: float) -> float:
        """Distance from the line at ``distance_m`` towards ``bearing_rad`` [m], above 0 where beyond."""
        return (
            self.north_m * math.cos(bearing_rad) + self.east_m * math.sin(bearing_rad) - distance_m
        )

    @property
    def tolerance_m(self) -> float:
        return _OFF_LINE_M + _OFF_LINE_SHARE * self.slant_m


class RingPlane(NamedTuple):
    """A wall: distance of the CG [m], its direction (NED, unit, level), and its nearest return [m].

    Both distances are inf where no wall is seen in that direction, NaN where the ring is blind.
    """

    distance_m: float
    normal_ned: Vector3
    slant_m: float

    def same_wall(self, normal_ned: Vector3 | None) -> bool:
        """Whether a wall seen before in direction ``normal_ned`` may be this one."""
        return (
            normal_ned is not None
            and _apart(_bearing(self.normal_ned), _bearing(normal_ned)) <= ANOTHER_WALL_RAD
        )


class RingView(NamedTuple):
    """Up to two walls at different bearings, nearest return first; directions (NED bearings) that tell anything."""

    planes: tuple[RingPlane, ...]
    known_rad: tuple[float, ...]
    blind_rad: tuple[float, ...]

    def sees(self, normal_ned: Vector3 | None) -> bool:
        """Whether the ring would see a wall in this direction; None: in any."""
        if normal_ned is None:
            return bool(self.known_rad)
        toward = _bearing(normal_ned)
        known, blind = (
            sum(_apart(b, toward) <= MAX_INCIDENCE_RAD for b in bearings)
            for bearings in (self.known_rad, self.blind_rad)
        )
        return known > blind


def ring_view(
    ring: Ring, rows: Rows, mount_m: Vector3, height_cg_m: float, vehicle: Vehicle
) -> RingView:
    """What a ring at ``mount_m`` (FRD) sees; ``rows`` FRD -> NED, ``height_cg_m`` over ground (inf, NaN: not known).

    Directions that are unknown, meet the ground or the vehicle's own parts, or point up or down are blind.
    """
    lever = turned(rows, mount_m)
    far = FAR_RADII * vehicle.rotor_radius_m
    near = NO_MATTER_RADII * vehicle.rotor_radius_m
    outline = _outline(vehicle)
    returns: list[_Return] = []
    known: list[float] = []
    blind: list[float] = []
    for bearing, slant in zip(ring.bearings_rad, ring.distances_m, strict=True):
        level = (math.cos(bearing), math.sin(bearing), 0.0)
        if ring.northward:
            beam = level
        else:
            beam = turned(rows, level)
        toward = _bearing(beam)
        north, east, down = plus(lever, scaled(beam, slant))
        met_ground = down > height_cg_m - GROUND_MARGIN_M - _GROUND_MARGIN_SHARE * slant
        inclined = math.hypot(beam[0], beam[1]) < math.cos(MAX_INCIDENCE_RAD)
        if (
            math.isnan(slant)
            or inclined
            or _own(rows, (north, east, down), outline)
            or (met_ground and slant < near)
        ):
            blind.append(toward)
            continue
        known.append(toward)
        if slant <= far and not met_ground:
            returns.append(_Return(north, east, slant, beam))
    steps = len(ring.bearings_rad) - 1
    fine = steps > 0 and ring.bearings_rad[-1] - ring.bearings_rad[0] < steps * _FINE_RAD
    return RingView(_planes(returns, fine), tuple(known), tuple(blind))


def _planes(returns: list[_Return], fine: bool) -> tuple[RingPlane, ...]:
    found: list[RingPlane] = []
    while returns and len(found) < 2:
        nearest = min(returns, key=lambda r: r.slant_m)
        bearing, distance, count = _line(nearest, returns)
        normal = (math.cos(bearing), math.sin(bearing), 0.0)
        plane = RingPlane(distance, normal, nearest.slant_m)
        if not (fine and count < 2) and not any(
            plane.same_wall(other.normal_ned) for other in found
        ):
            found.append(plane)
        returns = [
            r
            for r in returns
            if r is not nearest and abs(r.off(bearing, distance)) > 2.0 * r.tolerance_m
        ]
    return tuple(found)


def _line(nearest: _Return, returns: Sequence[_Return]) -> tuple[float, float, int]:
    """Bearing, distance and number of returns of the line through ``nearest`` and its neighbours.

    The widest window whose returns lie on one line counts, to both sides first, else to the side with the nearer
    returns: those of another wall are further. Without any the wall faces the beam.
    """
    toward = nearest.bearing_rad
    for window, turn in _WINDOWS_RAD:
        close = [(_signed(r.bearing_rad - toward), r) for r in returns]
        both = [r for aside, r in close if abs(aside) <= window]
        left = [r for aside, r in close if -window <= aside <= 0.0]
        right = [r for aside, r in close if 0.0 <= aside <= window]
        for choices in ((both,), (left, right)):
            lines = [
                line for points in choices if (line := _fitted(points, toward, turn)) is not None
            ]
            if lines:
                return min(lines)[1:]
    return toward, nearest.off(toward, 0.0), 1


def _fitted(
    points: Sequence[_Return], toward_rad: float, turn_rad: float
) -> tuple[float, float, float, int] | None:
    """Line of total least squares: mean slant, bearing, distance and number of points.

    None where the points lie on no line, or it is turned too far from ``toward_rad``: its nearest part would be seen
    elsewhere.
    """
    count = len(points)
    if count < 2:
        return None
    north = sum(p.north_m for p in points) / count
    east = sum(p.east_m for p in points) / count
    nn = sum((p.north_m - north) ** 2 for p in points)
    ee = sum((p.east_m - east) ** 2 for p in points)
    ne = sum((p.north_m - north) * (p.east_m - east) for p in points)
    bearing = 0.5 * math.atan2(2.0 * ne, nn - ee) + 0.5 * math.pi
    distance = north * math.cos(bearing) + east * math.sin(bearing)
    if distance < 0.0:
        bearing = bearing + math.pi
        distance = -distance
    if _apart(bearing, toward_rad) > turn_rad or any(
        abs(p.off(bearing, distance)) > p.tolerance_m for p in points
    ):
        return None
    return sum(p.slant_m for p in points) / count, bearing, distance, count


@lru_cache(maxsize=4)
def _outline(vehicle: Vehicle) -> tuple[Vector3, ...]:
    """Directions around the vehicle (forward, right) and how far its outermost lip reaches that way [m]."""
    around = [math.radians(10.0 * k) for k in range(36)]
    fans = [(*fan.position_m[:2], fan.lip_radius_m) for fan in vehicle.fans]
    return tuple(
        (
            math.cos(a),
            math.sin(a),
            max(x * math.cos(a) + y * math.sin(a) + lip for x, y, lip in fans),
        )
        for a in around
    )


def _own(rows: Rows, place_ned: Vector3, outline: Sequence[Vector3]) -> bool:
    """Whether a return lies within the vehicle's own outline."""
    x, y = (sum(row[axis] * v for row, v in zip(rows, place_ned, strict=True)) for axis in (0, 1))
    return all(c * x + s * y <= reach for c, s, reach in outline)


def placed(view: RingView, before: Sequence[Vector3 | None]) -> list[RingPlane]:
    """What is seen at each place: the wall in the direction where one was seen ``before``, new ones in free places."""
    reaches = []
    for old in before:
        if view.sees(old):
            reaches.append(math.inf)
        else:
            reaches.append(math.nan)
    out = [
        RingPlane(reach, old or (1.0, 0.0, 0.0), reach)
        for reach, old in zip(reaches, before, strict=True)
    ]
    free = list(range(len(before)))
    for plane in sorted(view.planes, key=lambda p: not any(map(p.same_wall, before))):
        place = min(free, key=lambda k: (not plane.same_wall(before[k]), before[k] is not None))
        free.remove(place)
        out[place] = plane
    return out


def _bearing(v: Vector3) -> float:
    return math.atan2(v[1], v[0])


def _signed(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)


def _apart(a_rad: float, b_rad: float) -> float:
    return abs(_signed(a_rad - b_rad))
