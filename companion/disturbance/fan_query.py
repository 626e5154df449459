"""Where the fans are to ground and wall a little ahead: the arguments of the surrogate."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.estimation.range_geometry import fan_heights_now, fan_wall_distances_now
from companion.estimation.surfaces import Seen, Surface
from models.common.frames import Rows
from models.vehicle import Vehicle


class FanQuery(NamedTuple):
    """The surrogate's arguments by fan, and the wall's bearing [rad]. Plain floats: two to six fans are few."""

    h_m: tuple[float, ...]
    d_m: tuple[float, ...]
    rpm: tuple[float, ...]
    wall_bearing_rad: float


def fan_query(
    vehicle: Vehicle,
    ground: Surface,
    wall: Surface,
    rotation: Rows,
    rpm: tuple[float, ...],
    lead_s: float,
) -> FanQuery:
    """Per-fan distances ``lead_s`` ahead, by the tracks' own rates."""
    h = [math.inf] * len(vehicle.fans)
    if ground.seen is Seen.SURFACE:
        h = fan_heights_now(vehicle, ground.distance_m + ground.rate_m_s * lead_s, rotation)
    d, bearing = lips_to_wall(vehicle, wall, rotation, lead_s)
    return FanQuery(tuple(h), tuple(d), rpm, bearing)


def lips_to_wall(
    vehicle: Vehicle, wall: Surface, rotation: Rows, lead_s: float
) -> tuple[list[float], float]:
    """Outer lip of every fan to a wall [m], ``lead_s`` ahead, and its bearing [rad]; inf, 0 without a wall."""
    if wall.seen is not Seen.SURFACE or wall.normal_ned is None:
        return [math.inf] * len(vehicle.fans), 0.0
    distance = wall.distance_m + wall.rate_m_s * lead_s
    return fan_wall_distances_now(vehicle, distance, wall.normal_ned, rotation)
