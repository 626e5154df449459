"""Heights and distances of every fan from recorded range beams."""

from __future__ import annotations

import numpy as np

from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.air_state import DIRECTIONS
from models.frames import Array
from models.vehicle import Vehicle
from replay.flightlog import Beam, FlightLog

MAX_GAP_S = 0.5


MAX_INCIDENCE_COS = float(np.cos(np.radians(30.0)))


def beam_reading(beam: Beam, t: Array) -> Array:
    """Slant range (n,): inf where the sensor says that nothing is there, NaN where it tells nothing."""
    good = beam.good
    out = good.at(t, MAX_GAP_S)[:, 0] if len(good) > 1 else np.full(len(t), np.nan)
    told = beam.distance.t_s
    far = np.array([v is RangeVerdict.ABOVE_MAX for v in beam.verdicts])
    known = np.array([v in (RangeVerdict.OK, RangeVerdict.ABOVE_MAX) for v in beam.verdicts])
    if known.any():
        nearest = np.clip(np.searchsorted(told[known], t), 0, int(known.sum()) - 1)
        before = np.maximum(nearest - 1, 0)
        times = told[known]
        pick = np.where(np.abs(times[before] - t) < np.abs(times[nearest] - t), before, nearest)
        close = np.abs(times[pick] - t) <= MAX_GAP_S
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
    for sensor in vehicle.rangefinders_for("ground"):
        beam = _beam_of(log, sensor.orientation)
        if beam is None or not len(beam.good):
            continue
        slant = beam_reading(beam, t + late_s)
        direction = np.asarray(beam.direction_frd)
        cosine = rotation[:, 2] @ direction
        with np.errstate(invalid="ignore"):
            height = rotation[:, 2] @ np.asarray(sensor.position_m) + slant * cosine
        return np.where(cosine > MAX_INCIDENCE_COS, height, np.nan)
    return None


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

    ``h_m``, ``d_m``, ``ceiling_m`` (n, fans), ``wall_bearing_rad`` (n,), ``ranges_m`` (n, 6);
    NaN where unknown, inf where nothing is there.
    """
    n, fans = len(t), len(vehicle.fans)
    h, d = np.full((n, fans), np.inf), np.full((n, fans), np.inf)
    ceiling, bearing = np.full((n, fans), np.inf), np.zeros(n)
    ranges = np.full((n, 6), np.nan)
    for i, direction in enumerate(DIRECTIONS):
        beam = log.beam(direction)
        if beam is not None:
            ranges[:, i] = beam_reading(beam, t + late_s)
    arms = [np.asarray(f.position_m) for f in vehicle.fans]
    height = ground_height(log, vehicle, t, rotation, late_s)
    if height is not None:
        h = np.stack([np.maximum(height - rotation[:, 2] @ arm, 0.0) for arm in arms], axis=1)
    for sensor in vehicle.rangefinders_for("wall"):
        beam = _beam_of(log, sensor.orientation)
        if beam is None or not len(beam.good):
            continue
        axis, mount = np.asarray(beam.direction_frd), np.asarray(sensor.position_m)
        slant = beam_reading(beam, t + late_s)
        world = rotation @ axis
        level = np.hypot(world[:, 0], world[:, 1])
        normal = np.where(level[:, None] > 0, world * [1, 1, 0] / np.maximum(level, 1e-9)[:, None], 0.0)
        toward = np.einsum("ni,nij->nj", normal, rotation)
        with np.errstate(invalid="ignore"):
            distance = toward @ mount + slant * level
            drop = rotation[:, 2] @ mount + slant * world[:, 2]
            floor = height if height is not None else np.full(n, np.inf)
            seen = (level > MAX_INCIDENCE_COS) & np.isfinite(slant) & ~(drop > floor - 0.05)
        own = np.stack([distance - toward @ f - fan.lip_radius_m for f, fan in zip(arms, vehicle.fans, strict=True)], 1)
        d = np.where(seen[:, None], np.maximum(own, 0.0), np.where(np.isnan(slant)[:, None], np.nan, np.inf))
        bearing = np.where(seen, np.arctan2(toward[:, 1], toward[:, 0]), 0.0)
        break  # the first declared wall rangefinder is the model's wall; others are second walls
    up = None
    for sensor in vehicle.rangefinders_for("ceiling"):
        up = _beam_of(log, sensor.orientation)
        mount = np.asarray(sensor.position_m)
    if up is None and not vehicle.rangefinders_for("ceiling"):
        up, mount = log.beam("up"), np.zeros(3)
    if up is not None and len(up.good):
        slant = beam_reading(up, t + late_s)
        cosine = -(rotation[:, 2] @ np.asarray(up.direction_frd))
        with np.errstate(invalid="ignore"):
            over = slant * cosine - rotation[:, 2] @ mount
            over = np.where(cosine > MAX_INCIDENCE_COS, over, np.inf)
        over = np.where(np.isnan(over), np.inf, over)
        ceiling = np.stack([over + rotation[:, 2] @ arm for arm in arms], axis=1)
    return {"h_m": h, "d_m": d, "ceiling_m": ceiling, "wall_bearing_rad": bearing, "ranges_m": ranges}
