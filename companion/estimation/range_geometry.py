"""From range beams to the distances that a model wants: tilt and lever arms taken out, per fan.

One geometry for flight and replay: every function takes one instant (leading shape ``()``) or a record (leading shape
``(n,)``); what runs at every setpoint has a second form in plain floats, ``..._now``, that a test holds equal to it.
Everywhere a distance is a number where a surface is seen, ``inf`` where the sensor says that nothing is there, and
NaN where nothing is known.

The rules:

- Ground and ceiling are level. Beams that look at the same one confirm each other: the nearest is taken, and one that
  tells nothing does not matter while another sees the surface.
- A wall is upright, and faces its beam where nothing says how it runs (``wall_line``). The nearest wall is the model's;
  the nearest of those at another bearing is the second wall. While any declared wall beam tells nothing, no wall
  distance is known: it may look at the nearest wall.
- A wall beam that meets the ground first tells nothing, unless it got so far that a wall behind it does not matter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from companion.mavlink.range_beams import dot
from models.common.frames import Array, Rows
from models.vehicle import Vector3, Vehicle

MAX_INCIDENCE_RAD = math.radians(30.0)
"""A beam further than this off the normal of what it should hit tells nothing reliable (ardupilot#5638)."""
GROUND_MARGIN_M = 0.05
"""A wall beam that ends lower than this over the ground has met the ground, not the wall."""
FAR_RADII = 30.0
"""Rotor radii beyond which a reading to the side or up means that nothing is there: the air ends before 4."""
NO_MATTER_RADII = 10.0
"""Rotor radii from the CG beyond which a wall does not matter, with the vehicle's own size and a margin taken in."""
ANOTHER_WALL_RAD = 0.8
"""Bearings further apart than this (46 degrees) belong to two walls."""
_COS_INCIDENCE = math.cos(MAX_INCIDENCE_RAD)


@dataclass(frozen=True, slots=True)
class PlaneDistance:
    """Distance (...) of the CG to the plane that a beam looks at [m], and its direction (..., 3) (NED, unit).

    The direction is zero for a wall beam that points straight up or down.
    """

    distance_m: Array
    normal_ned: Array


def plane_distance(
    target: str,
    direction_frd: ArrayLike,
    position_m: ArrayLike,
    range_m: ArrayLike,
    rotation: Array,
    height_cg_m: ArrayLike = math.inf,
    rotor_radius_m: float = math.inf,
) -> PlaneDistance:
    """Distance of the CG to ground, ceiling or wall along the plane's normal, from slant ranges (...).

    ``rotation`` (..., 3, 3) FRD -> NED, ``height_cg_m`` (...) over ground (inf or NaN: not known). NaN where the beam
    is more than 30 degrees off the normal, or where a wall beam meets the ground first.
    """
    slant = np.asarray(range_m, dtype=float)
    mount = np.asarray(position_m, dtype=float)
    beam = rotation @ np.asarray(direction_frd, dtype=float)
    level = np.hypot(beam[..., 0], beam[..., 1])
    if target == "wall":
        normal = beam * np.array([1.0, 1.0, 0.0]) / np.maximum(level, 1e-9)[..., None]
        along = level
    else:
        if target == "ground":
            down = 1.0
        else:
            down = -1.0
        normal = np.zeros_like(beam)
        normal[..., 2] = down
        along = beam[..., 2] * down
    with np.errstate(invalid="ignore"):
        lever = np.einsum("...i,...ij,j->...", normal, rotation, mount)
        distance = np.where(np.isinf(slant), np.inf, lever + slant * along)
        distance = np.where((along < _COS_INCIDENCE) & np.isfinite(distance), np.nan, distance)
        if target == "wall":
            end = rotation[..., 2, :] @ mount + slant * beam[..., 2]
            met_ground = np.isfinite(distance) & (end > np.asarray(height_cg_m) - GROUND_MARGIN_M)
            clear = distance > NO_MATTER_RADII * rotor_radius_m
            distance = np.where(met_ground, np.where(clear, np.inf, np.nan), distance)
        if target != "ground":
            distance = np.where(slant > FAR_RADII * rotor_radius_m, np.inf, distance)
    return PlaneDistance(np.asarray(distance), normal)


def plane_distance_now(
    *,
    target: str,
    beam_ned: Vector3,
    position_m: Vector3,
    slant_m: float,
    rotation: Rows,
    height_cg_m: float,
    rotor_radius_m: float,
) -> tuple[float, Vector3]:
    """``plane_distance`` of one instant in plain floats, from the beam's direction in NED: distance and normal."""
    north, east, down = beam_ned
    if target == "wall":
        along = abs(complex(north, east))  # math.hypot differs from numpy's in the last bit
        reach = max(along, 1e-9)
        normal = (north / reach, east / reach, down * 0.0)
    else:
        sign = 1.0 if target == "ground" else -1.0
        along = down * sign
        normal = (0.0, 0.0, sign)
    if math.isinf(slant_m):
        distance = math.inf
    else:
        lever = 0.0
        for n, row in zip(normal, rotation, strict=True):
            for r, mount in zip(row, position_m, strict=True):
                lever += n * r * mount
        distance = lever + slant_m * along
        if along < _COS_INCIDENCE:
            distance = math.nan
    if target == "wall" and math.isfinite(distance):
        end = dot(rotation[2], position_m) + slant_m * down
        if end > height_cg_m - GROUND_MARGIN_M:
            clear = distance > NO_MATTER_RADII * rotor_radius_m
            distance = math.inf if clear else math.nan
    if target != "ground" and slant_m > FAR_RADII * rotor_radius_m:
        distance = math.inf
    return distance, normal


def nearest_level(distances_m: ArrayLike) -> Array:
    """Distance (...) to ground or ceiling from those (beams, ...) of the beams that look at it."""
    d = np.asarray(distances_m, dtype=float)
    seen = np.where(np.isfinite(d), d, np.inf).min(axis=0)
    return np.asarray(np.where(np.isfinite(seen) | ~np.isnan(d).any(axis=0), seen, np.nan))


@dataclass(frozen=True, slots=True)
class Walls:
    """The nearest wall and the nearest at another bearing: which beam sees it (...), -1 where none does.

    ``known`` (...) is False where a wall beam tells nothing.
    """

    first: Array
    second: Array
    known: Array


def choose_walls(distances_m: ArrayLike, normals_ned: ArrayLike) -> Walls:
    """Which wall beam sees the nearest wall, and which the nearest at another bearing.

    ``distances_m`` (beams, ...) of the CG and ``normals_ned`` (beams, ..., 3), as ``plane_distance`` gives them.
    """
    d = np.asarray(distances_m, dtype=float)
    normals = np.asarray(normals_ned, dtype=float)
    bearings = np.arctan2(normals[..., 1], normals[..., 0])
    known = ~np.isnan(d).any(axis=0)
    reach = np.where(np.isfinite(d) & known, d, np.inf)
    first = reach.argmin(axis=0)
    apart = bearings - np.take_along_axis(bearings, first[None], axis=0)
    apart = np.abs((apart + np.pi) % (2.0 * np.pi) - np.pi)
    others = np.where(apart > ANOTHER_WALL_RAD, reach, np.inf)
    second = others.argmin(axis=0)
    return Walls(
        np.where(np.isfinite(reach.min(axis=0)), first, -1),
        np.where(np.isfinite(others.min(axis=0)), second, -1),
        known,
    )


def fan_heights(vehicle: Vehicle, height_cg_m: ArrayLike, rotation: Array) -> Array:
    """Reference point to ground [m], shape (..., fans), never below 0, from the height of the CG (...)."""
    below = rotation[..., 2, :] @ vehicle.fan_positions_m.T
    return np.asarray(np.maximum(np.asarray(height_cg_m, dtype=float)[..., None] - below, 0.0))


def fan_heights_now(vehicle: Vehicle, height_cg_m: float, rotation: Rows) -> list[float]:
    """``fan_heights`` of one instant in plain floats."""
    a, b, c = rotation[2]
    out = []
    for x, y, z in (fan.position_m for fan in vehicle.fans):
        out.append(max(height_cg_m - (a * x + b * y + c * z), 0.0))
    return out


def fan_ceilings(vehicle: Vehicle, ceiling_cg_m: ArrayLike, rotation: Array) -> Array:
    """Reference point to ceiling [m], shape (..., fans), never below 0, from the distance of the CG (...)."""
    below = rotation[..., 2, :] @ vehicle.fan_positions_m.T
    return np.asarray(np.maximum(np.asarray(ceiling_cg_m, dtype=float)[..., None] + below, 0.0))


def fan_wall_distances(
    vehicle: Vehicle, wall_cg_m: ArrayLike, normal_ned: Array, rotation: Array
) -> Array:
    """Outer lip to wall [m], shape (..., fans), never below 0, from the distance of the CG (...)."""
    toward = np.einsum("...i,...ij->...j", normal_ned, rotation) @ vehicle.fan_positions_m.T
    return np.asarray(
        np.maximum(
            np.asarray(wall_cg_m, dtype=float)[..., None] - toward - vehicle.lip_radii_m, 0.0
        )
    )


def fan_wall_distances_now(
    vehicle: Vehicle, wall_cg_m: float, normal_ned: Vector3, rotation: Rows
) -> tuple[list[float], float]:
    """``fan_wall_distances`` and ``wall_bearing`` of one instant in plain floats."""
    north, east, down = normal_ned
    (a, b, c), (d, e, f), (g, h, i) = rotation
    x = north * a + east * d + down * g
    y = north * b + east * e + down * h
    z = north * c + east * f + down * i
    lips = []
    for fan in vehicle.fans:
        px, py, pz = fan.position_m
        lips.append(max(wall_cg_m - (x * px + y * py + z * pz) - fan.lip_radius_m, 0.0))
    return lips, math.atan2(y, x)


def wall_bearing(normal_ned: Array, rotation: Array) -> Array:
    """Bearing (...) of the wall from the nose [rad], positive to the right."""
    body = np.einsum("...i,...ij->...j", normal_ned, rotation)
    return np.asarray(np.arctan2(body[..., 1], body[..., 0]))
