"""From range beams to the distances the surrogate wants: tilt and lever arms taken out, per fan."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.frames import Array
from models.vehicle import Vehicle

MAX_INCIDENCE_RAD = math.radians(30.0)
"""A beam further than this off the normal of what it should hit tells nothing reliable (ardupilot#5638)."""


@dataclass(frozen=True, slots=True)
class PlaneDistance:
    """Distance of the CG to the plane a beam hit [m], and the plane's direction seen from the vehicle (NED, unit)."""

    distance_m: float
    normal_ned: Array


def plane_distance(
    target: str, direction_frd: Array, position_m: Array, range_m: float, rotation: Array, height_cg_m: float
) -> PlaneDistance | None:
    """Distance of the CG to ground, ceiling or wall along the plane's normal, from one slant range.

    ``rotation`` FRD -> NED. Ground and ceiling are level; a wall is upright and faces the beam. None where the beam is
    more than 30 degrees off the normal, or where a wall beam meets the ground first (``height_cg_m``, inf if unknown).
    """
    beam = rotation @ direction_frd
    arm = rotation @ (position_m + range_m * direction_frd)
    if target == "wall":
        level = math.hypot(beam[0], beam[1])
        if level < math.cos(MAX_INCIDENCE_RAD):
            return None
        if arm[2] > height_cg_m - 0.05:
            return None
        normal = np.array([beam[0] / level, beam[1] / level, 0.0])
    else:
        down = 1.0 if target == "ground" else -1.0
        if beam[2] * down < math.cos(MAX_INCIDENCE_RAD):
            return None
        normal = np.array([0.0, 0.0, down])
    return PlaneDistance(float(arm @ normal), normal)


def fan_heights(vehicle: Vehicle, height_cg_m: float, rotation: Array) -> Array:
    """Reference point to ground [m], shape (fans,), from the height of the CG."""
    return np.array([height_cg_m - float(rotation[2] @ np.asarray(fan.position_m)) for fan in vehicle.fans])


def fan_wall_distances(vehicle: Vehicle, wall_cg_m: float, normal_ned: Array, rotation: Array) -> Array:
    """Outer lip to wall [m], shape (fans,), from the distance of the CG."""
    toward = normal_ned @ rotation
    return np.array([wall_cg_m - float(toward @ np.asarray(f.position_m)) - f.lip_radius_m for f in vehicle.fans])


def wall_bearing(normal_ned: Array, rotation: Array) -> float:
    """Bearing of the wall from the nose [rad], positive to the right."""
    body = normal_ned @ rotation
    return math.atan2(float(body[1]), float(body[0]))
