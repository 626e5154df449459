"""Heights and distances of every fan from recorded range beams."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from companion.estimation.range_doubt import UNREAD, Sighting, doubt
from companion.estimation.range_geometry import (
    NO_MATTER_RADII,
    PlaneDistance,
    choose_walls,
    fan_ceilings,
    fan_heights,
    fan_wall_distances,
    nearest_level,
    plane_distance,
    wall_bearing,
)
from companion.estimation.ring_planes import placed, ring_view
from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.air_state import DIRECTIONS
from models.common.frames import Array
from models.vehicle import Vector3, Vehicle
from replay.flightlog import Beam, FlightLog, Series, direction_name
from replay.residual.grid import Mask
from replay.residual.standing_walls import square_to_walls

_MEASURED = (RangeVerdict.OK, RangeVerdict.ABOVE_MAX)
"""Verdicts of a reading that says something."""
MAX_GAP_S = 0.5
"""Longest gap between two samples that is interpolated: a period of the 2 Hz that are judged."""
CARRIED_S = 3.0
"""Longest gap in the sight of a surface that the vehicle's own motion bridges: a position drifts by a centimetre."""


def beam_reading(beam: Beam, t: Array, doubted: Mask | None = None) -> Array:
    """Slant range (n,): inf where the sensor says that nothing is there, NaN where nothing is known.

    ``doubted`` (samples,): readings of the beam that are not used.
    """
    if doubted is None:
        used = np.ones(len(beam.verdicts), bool)
    else:
        used = ~doubted
    near, far = (used & beam.judged(verdict) for verdict in _MEASURED)
    return _reading(beam.distance.t_s, beam.distance.values[:, 0], near, far, t)


def _reading(times: Array, distance: Array, near: Mask, far: Mask, t: Array) -> Array:
    """What samples (m,) at ``times`` say at ``t`` (n,): the distance where ``near``, inf where ``far``."""
    good = Series(times[near], distance[near, None])
    if len(good) > 1:
        out = good.at(t, MAX_GAP_S)[:, 0]
    else:
        out = np.full(len(t), np.nan)
    known = near | far
    if known.any():
        usable = times[known]
        after = np.clip(np.searchsorted(usable, t), 0, len(usable) - 1)
        before = np.maximum(after - 1, 0)
        since_before = np.abs(usable[before] - t)
        until_after = np.abs(usable[after] - t)
        nearest = np.where(since_before < until_after, before, after)
        close = np.abs(usable[nearest] - t) <= MAX_GAP_S
        out = np.where(close & far[known][nearest], np.inf, out)
    return out


def _doubted(
    beam: Beam, target: str, near_m: float, t: Array, rotation: Array, position: Array
) -> Mask:
    """Readings (samples,) that flight does not use either: a lost echo, a frozen value. ``t``: when each was taken."""
    index = np.clip(np.searchsorted(t, beam.distance.t_s), 0, len(t) - 1)
    places = position[index]
    beams = rotation[index] @ np.asarray(beam.direction_frd)
    seen = np.isfinite(places).all(axis=1) & np.isfinite(beams).all(axis=1)
    slants = np.where(beam.judged(RangeVerdict.ABOVE_MAX), np.inf, beam.distance.values[:, 0])
    out = np.zeros(len(index), bool)
    read = UNREAD
    for i in np.flatnonzero(beam.judged(*_MEASURED) & seen & ~np.isnan(slants)):
        here = Sighting(float(slants[i]), tuple(places[i].tolist()), tuple(beams[i].tolist()))
        read = doubt(here, read, near_m, target)
        out[i] = read.why is not None
    return out


def _carried(plane: PlaneDistance, t: Array, position: Array) -> PlaneDistance:
    """The distance through gaps of up to ``CARRIED_S`` between two readings, by the vehicle's own motion.

    ``distance + position . normal`` is the place of the plane: it is interpolated, the vehicle's position is measured.
    """
    along = np.einsum("ij,ij->i", plane.normal_ned, position)
    known = np.isfinite(plane.distance_m) & np.isfinite(along)
    missing = np.isnan(plane.distance_m) & np.isfinite(along)
    if not known.any() or not missing.any():
        return plane
    place = Series(t[known], (plane.distance_m + along)[known, None]).at(t, CARRIED_S)[:, 0]
    return PlaneDistance(np.where(missing, place - along, plane.distance_m), plane.normal_ned)


def _beam_of(log: FlightLog, orientation: int) -> Beam | None:
    direction = orientation_direction(orientation)
    if direction is None:
        return None
    name = direction_name(direction)
    if name == "other":
        return None
    return log.beam(name)


def ground_height(
    log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, position: Array, late_s: float
) -> Array | None:
    """Height of the CG over the ground (n,), or None without a ground rangefinder."""
    seen = _planes(
        log=log,
        vehicle=vehicle,
        target="ground",
        t=t,
        rotation=rotation,
        position=position,
        late_s=late_s,
    )
    if seen:
        return nearest_level([plane.distance_m for plane in seen])
    return None


def _planes(
    log: FlightLog,
    vehicle: Vehicle,
    target: str,
    t: Array,
    rotation: Array,
    position: Array,
    late_s: float,
    floor: Array | float = np.inf,
) -> list[PlaneDistance]:
    """What every watched beam of ``target`` that the log holds saw of it."""
    out = []
    near_m = NO_MATTER_RADII * vehicle.rotor_radius_m
    for sensor in vehicle.watched:
        if sensor.target == target:
            beam = _beam_of(log, sensor.orientation)
        else:
            beam = None
        if beam is None or not beam.judged(*_MEASURED).any():
            continue
        doubted = _doubted(beam, target, near_m, t + late_s, rotation, position)
        slant = beam_reading(beam, t + late_s, doubted)
        plane = plane_distance(
            target=target,
            direction_frd=beam.direction_frd,
            position_m=sensor.position_m,
            range_m=slant,
            rotation=rotation,
            height_cg_m=floor,
            rotor_radius_m=vehicle.rotor_radius_m,
        )
        out.append(_carried(plane, t, position))
    return out


def _ring_planes(
    log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, position: Array, floor: Array
) -> list[PlaneDistance]:
    """What the two places of a declared ring saw, as flight does (``readings.take_ring``). ``t``: when it was read."""
    sensor = next((s for s in vehicle.rangefinders_for("wall") if s.ring), None)
    if sensor is None or not log.rings:
        return []
    near_m = NO_MATTER_RADII * vehicle.rotor_radius_m
    before: list[Vector3 | None] = [None, None]
    reads = [UNREAD, UNREAD]
    times = np.array([ring.t_s for ring in log.rings])
    found = np.full((2, len(times)), np.nan)
    normals = np.zeros((2, len(times), 3))
    for i, row in enumerate(np.clip(np.searchsorted(t, times), 0, len(t) - 1).tolist()):
        view = ring_view(
            log.rings[i], rotation[row].tolist(), sensor.position_m, float(floor[row]), vehicle
        )
        north, east, down = position[row].tolist()
        for k, plane in enumerate(placed(view, before)):
            if not math.isnan(plane.slant_m) and math.isfinite(north + east + down):
                here = Sighting(plane.slant_m, (north, east, down), plane.normal_ned)
                reads[k] = doubt(
                    here, reads[k] if plane.same_wall(before[k]) else UNREAD, near_m, "wall"
                )
            found[k, i] = np.nan if reads[k].why is not None else plane.distance_m
            normals[k, i] = plane.normal_ned
            before[k] = plane.normal_ned if math.isfinite(plane.slant_m) else before[k]
    nearest = np.clip(np.searchsorted(times, t), 0, len(times) - 1)
    return [
        PlaneDistance(_reading(times, one, np.isfinite(one), np.isinf(one), t), normal[nearest])
        for one, normal in zip(found, normals, strict=True)
    ]


def unseen_surfaces(log: FlightLog, vehicle: Vehicle) -> list[str]:
    """A line for everything that a declared rangefinder looks at and no message of the log measures."""
    notes = []
    for target in ("ground", "wall", "ceiling"):
        sensors = vehicle.rangefinders_for(target)
        beams = [_beam_of(log, sensor.orientation) for sensor in sensors]
        rings = target == "wall" and len(log.rings) > 0
        if sensors and not rings and not any(beam is not None and len(beam.good) for beam in beams):
            notes.append(
                f"no range to the {target} in the log, but a declared rangefinder: taken to be "
                "far away"
            )
    return notes


def distances(
    log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, position: Array, late_s: float
) -> dict[str, Array]:
    """Fields of ``AirState`` that ranges give, at the times ``t`` (n,), the ranges taken ``late_s`` later.

    ``h_m``, ``d_m``, ``second_d_m``, ``ceiling_m`` (n, fans), ``wall_bearing_rad``, ``second_bearing_rad`` (n,),
    ``ranges_m`` (n, 6); NaN where unknown, inf where nothing is there. By the geometry of flight
    (companion/estimation/range_geometry.py); a surface that no beam of the log looks at is taken to be far away.
    """
    n = len(t)
    fans = len(vehicle.fans)
    far = np.full((n, fans), np.inf)
    ranges = np.full((n, len(DIRECTIONS)), np.nan)
    for i, direction in enumerate(DIRECTIONS):
        beam = log.beam(direction)
        if beam is not None:
            ranges[:, i] = beam_reading(beam, t + late_s)
    out = {
        "h_m": far,
        "ceiling_m": far,
        "d_m": far,
        "wall_bearing_rad": np.zeros(n),
        "second_d_m": far,
        "second_bearing_rad": np.zeros(n),
        "ranges_m": ranges,
    }
    floor = far[:, 0]
    height = ground_height(log, vehicle, t, rotation, position, late_s)
    if height is not None:
        floor = height
        out["h_m"] = fan_heights(vehicle, height, rotation)
    planes = partial(
        _planes, log, vehicle, t=t, rotation=rotation, position=position, late_s=late_s
    )
    ceilings = planes("ceiling")
    if ceilings:
        level = nearest_level([plane.distance_m for plane in ceilings])
        out["ceiling_m"] = fan_ceilings(vehicle, level, rotation)
    seen = [square_to_walls(plane, position) for plane in planes("wall", floor=floor)]
    rings = _ring_planes(log, vehicle, t + late_s, rotation, position, floor)
    seen += [_carried(plane, t, position) for plane in rings]
    if seen:
        out |= _wall_fields(vehicle, seen, rotation)
    return out


def _wall_fields(
    vehicle: Vehicle, planes: Sequence[PlaneDistance], rotation: Array
) -> dict[str, Array]:
    """Distance and bearing of the two walls, of all planes that beams saw."""
    distances_m = np.stack([plane.distance_m for plane in planes])
    normals = np.stack([plane.normal_ned for plane in planes])
    walls = choose_walls(distances_m, normals)
    if_none = np.where(walls.known, np.inf, np.nan)[:, None]
    rows = np.arange(len(rotation))
    out = {}
    for number, d_name, bearing_name in (
        (walls.first, "d_m", "wall_bearing_rad"),
        (walls.second, "second_d_m", "second_bearing_rad"),
    ):
        there = number >= 0
        normal = normals[number, rows]
        lips = fan_wall_distances(vehicle, distances_m[number, rows], normal, rotation)
        out[d_name] = np.where(there[:, None], lips, if_none)
        out[bearing_name] = np.where(there, wall_bearing(normal, rotation), 0.0)
    return out
