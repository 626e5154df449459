"""Heights and distances of every fan from recorded range beams."""

from __future__ import annotations

import numpy as np

from companion.estimation.range_geometry import (
    PlaneDistance,
    choose_walls,
    fan_ceilings,
    fan_heights,
    fan_wall_distances,
    nearest_level,
    plane_distance,
    wall_bearing,
)
from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.air_state import DIRECTIONS
from models.frames import Array
from models.vehicle import Vehicle
from replay.flightlog import Beam, FlightLog

MAX_GAP_S = 0.5
"""Longest gap between two samples that is interpolated: a period of the 2 Hz that are judged."""


def beam_reading(beam: Beam, t: Array) -> Array:
    """Slant range (n,): inf where the sensor says that nothing is there, NaN where it says nothing."""
    good = beam.good
    out = good.at(t, MAX_GAP_S)[:, 0] if len(good) > 1 else np.full(len(t), np.nan)
    times = beam.distance.t_s
    far = np.array([v is RangeVerdict.ABOVE_MAX for v in beam.verdicts])
    known = np.array([v in (RangeVerdict.OK, RangeVerdict.ABOVE_MAX) for v in beam.verdicts])
    if known.any():
        usable = times[known]
        nearest = np.clip(np.searchsorted(usable, t), 0, len(usable) - 1)
        before = np.maximum(nearest - 1, 0)
        pick = np.where(np.abs(usable[before] - t) < np.abs(usable[nearest] - t), before, nearest)
        close = np.abs(usable[pick] - t) <= MAX_GAP_S
        out = np.where(close & far[known][pick], np.inf, out)
    return out


def _beam_of(log: FlightLog, orientation: int) -> Beam | None:
    wanted = orientation_direction(orientation)
    if wanted is None:
        return None
    from replay.flightlog import best_beam, direction_name

    return best_beam([b for b in log.beams if b.name == direction_name(wanted) and b.name != "other"])


def ground_height(log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, late_s: float) -> Array | None:
    """Height of the CG over the ground (n,), or None without a ground rangefinder."""
    seen = _planes(log, vehicle, "ground", t, rotation, late_s)
    return nearest_level([plane.distance_m for plane in seen]) if seen else None


def _planes(
    log: FlightLog, vehicle: Vehicle, target: str, t: Array, rotation: Array, late_s: float, height: Array | None = None
) -> list[PlaneDistance]:
    """What every watched beam of ``target`` that the log holds saw of it."""
    out = []
    for sensor in vehicle.watched:
        beam = _beam_of(log, sensor.orientation) if sensor.target == target else None
        if beam is None or not _ever_measured(beam):
            continue
        slant = beam_reading(beam, t + late_s)
        floor = np.inf if height is None else height
        out.append(
            plane_distance(
                target, beam.direction_frd, sensor.position_m, slant, rotation, floor, vehicle.rotor_radius_m
            )
        )
    return out


def _ever_measured(beam: Beam) -> bool:
    return any(v in (RangeVerdict.OK, RangeVerdict.ABOVE_MAX) for v in beam.verdicts)


def unseen_surfaces(log: FlightLog, vehicle: Vehicle) -> list[str]:
    """A line for everything that a declared rangefinder looks at and no message of the log measures."""
    notes = []
    for target in ("ground", "wall", "ceiling"):
        sensors = vehicle.rangefinders_for(target)
        beams = [_beam_of(log, sensor.orientation) for sensor in sensors]
        if sensors and not any(beam is not None and len(beam.good) for beam in beams):
            notes.append(f"no range to the {target} in the log, but a declared rangefinder: taken to be far away")
    return notes


def distances(
    log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, position: Array, late_s: float
) -> dict[str, Array]:
    """Fields of ``AirState`` that ranges give, at the times ``t`` (n,), the ranges taken ``late_s`` later.

    ``h_m``, ``d_m``, ``second_d_m``, ``ceiling_m`` (n, fans), ``wall_bearing_rad``, ``second_bearing_rad`` (n,),
    ``ranges_m`` (n, 6); NaN where unknown, inf where nothing is there. By the geometry of flight
    (companion/estimation/range_geometry.py); a surface that no beam of the log looks at is taken to be far away.
    """
    n, fans = len(t), len(vehicle.fans)
    far = np.full((n, fans), np.inf)
    ranges = np.full((n, len(DIRECTIONS)), np.nan)
    for i, direction in enumerate(DIRECTIONS):
        beam = log.beam(direction)
        if beam is not None:
            ranges[:, i] = beam_reading(beam, t + late_s)
    height = ground_height(log, vehicle, t, rotation, late_s)
    ceilings = _planes(log, vehicle, "ceiling", t, rotation, late_s)
    seen = _planes(log, vehicle, "wall", t, rotation, late_s, height)
    out = {
        "h_m": far if height is None else fan_heights(vehicle, height, rotation),
        "ceiling_m": fan_ceilings(vehicle, nearest_level([c.distance_m for c in ceilings]), rotation)
        if ceilings
        else far,
        "d_m": far, "wall_bearing_rad": np.zeros(n), "second_d_m": far, "second_bearing_rad": np.zeros(n),
        "ranges_m": ranges,
    }  # fmt: skip
    if seen:
        distance, normal = np.stack([w.distance_m for w in seen]), np.stack([w.normal_ned for w in seen])
        walls = choose_walls(distance, normal)
        known = np.where(walls.known, np.inf, np.nan)[:, None]
        for index, d_name, bearing_name in (
            (walls.first, "d_m", "wall_bearing_rad"),
            (walls.second, "second_d_m", "second_bearing_rad"),
        ):
            there, rows = index >= 0, np.arange(n)
            lips = fan_wall_distances(vehicle, distance[index, rows], normal[index, rows], rotation)
            out[d_name] = np.where(there[:, None], lips, known)
            out[bearing_name] = np.where(there, wall_bearing(normal[index, rows], rotation), 0.0)
    return out
