"""Time in which nothing is known of the ground or a wall: far beyond what matters, or possibly near.

What is far is judged for everything else. What may be near is left out: an effect of a surface would be named as
another one there. Where hardly any time with a known distance is left, the surface is not judged at all: the flight is
then one of a vehicle without that sensor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from companion.estimation.range_geometry import NO_MATTER_RADII
from models.air_state import AirState
from models.common.frames import Array
from models.vehicle import Vehicle
from replay.flightlog import FlightLog
from replay.residual.grid import Grid, Mask
from replay.residual.motion import ENOUGH_S

EFFECT_RADII = 4.0
"""Lift is within 2 % of free air from here on (Cheeseman and Bennett 1955)."""
HEIGHT_ERROR_M = 0.5
"""By which an estimator's height errs: the rotors' own pressure on a barometer, and its drift over a flight."""
TOP_SHARE = 0.8
"""A sensor that falls silent at this share of its farthest reading has nothing in its range: it went out at the top."""
WORTH_A_NOTE_S = 1.0


@dataclass(frozen=True)
class Surface:
    """What the notes call it, what a rangefinder of it looks at, and its columns in ``AirState``, the nearest first."""

    name: str
    target: str
    nearest: str
    columns: tuple[str, ...]


GROUND = Surface("height over ground", "ground", "h_m", ("h_m",))
WALL = Surface("distance to the wall", "wall", "d_m", ("d_m", "second_d_m"))


def resolved(
    log: FlightLog, vehicle: Vehicle, grid: Grid, state: AirState, flying: Mask
) -> tuple[AirState, list[tuple[str, Mask]], list[str]]:
    """The state with far surfaces at infinity; time to leave out, by reason; notes.

    ``flying`` (n,): samples in the air. A distance that stays NaN may be a small one.
    """
    left_out: list[tuple[str, Mask]] = []
    notes: list[str] = []
    for surface in (GROUND, WALL):
        unknown = np.isnan(getattr(state, surface.nearest)).any(axis=1)
        if not unknown.any():
            continue
        far = _far(log, vehicle, state, surface) & unknown
        near = unknown & ~far
        seconds = float((flying & unknown).sum() / grid.rate)
        said = f"{surface.name} unknown in {seconds:.0f} s of the flight"
        if _too_little_left(flying, near, grid.rate):
            low = _known_near(state, surface, vehicle)
            left_out.append((f"{surface.name} known only here, and small", low))
            state = _moved_away(state, surface, np.ones(len(unknown), bool))
            notes.append(f"{said}: its effects are not judged")
            continue
        left_out.append((f"{surface.name} unknown, and perhaps small", near))
        state = _moved_away(state, surface, far)
        if seconds >= WORTH_A_NOTE_S:
            away = float((flying & far).sum() / grid.rate)
            notes.append(f"{said}; far away in {away:.0f} s of that, which is judged for all else")
    return state, left_out, notes


def _far_m(vehicle: Vehicle) -> float:
    """Distance [m] from which on a surface does not matter, whatever an estimator's height errs."""
    radius = vehicle.rotor_radius_m
    return max(NO_MATTER_RADII * radius, EFFECT_RADII * radius + HEIGHT_ERROR_M)


def _far(log: FlightLog, vehicle: Vehicle, state: AirState, surface: Surface) -> Mask:
    """Samples (n,) at which an unknown distance is known to be large."""
    distance = getattr(state, surface.nearest).min(axis=1)
    far_m = _far_m(vehicle)
    silent = _silent_at_the_top(distance, _top_m(log, vehicle, surface, distance, far_m))
    if surface is not GROUND:
        return silent
    above = _height_by_estimator(log, state, distance)
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(above), above > far_m, silent)


def _height_by_estimator(log: FlightLog, state: AirState, height: Array) -> Array:
    """Height (n,) over the lower ground of the last and the next reading, else over where the vehicle stood; or NaN."""
    down = state.position_ned[:, 2]
    places = np.where(np.isfinite(height), down + height, np.nan)
    if not np.isfinite(places).any():
        stood = _standing_by_log(log, state.time_s) & np.isfinite(down)
        if stood.any():
            ground = float(np.median(down[stood]))
        else:
            ground = np.nan
        return np.asarray(ground - down)
    before = _last_known(places)
    after = _last_known(places[::-1])[::-1]
    # Down is positive: the smaller place is the higher ground, and the vehicle is nearest to that.
    return np.asarray(np.fmin(before, after) - down)


def _standing_by_log(log: FlightLog, t: Array) -> Mask:
    """Samples (n,) at which the autopilot says that it stands, or is not armed."""
    stood = np.zeros(len(t), bool)
    for interval in log.landed:
        if interval.value == 1:
            stood |= (t >= interval.start_s) & (t < interval.end_s)
    if log.armed:
        armed = [(t >= i.start_s) & (t <= i.end_s) for i in log.armed]
        stood |= ~np.logical_or.reduce(armed)
    return stood


def _top_m(
    log: FlightLog, vehicle: Vehicle, surface: Surface, distance: Array, far_m: float
) -> float:
    """Distance [m] at which a sensor may fall silent because nothing is in its range, at most ``far_m``.

    By the range that it states; by its farthest reading where it states none.
    """
    facing = {sensor.orientation for sensor in vehicle.rangefinders_for(surface.target)}
    stated = [b.max_m for b in log.beams if b.orientation in facing and np.isfinite(b.max_m)]
    finite = distance[np.isfinite(distance)]
    if stated:
        reach = max(stated)
    else:
        reach = float(finite.max(initial=0.0))
    if reach > 0.0:
        return min(far_m, TOP_SHARE * reach)
    return far_m


def _silent_at_the_top(distance: Array, top: float) -> Mask:
    """Unknown samples (n,) between two large distances, or the end of the log: the sensor went out of its range."""
    before = _last_known(distance)
    after = _last_known(distance[::-1])[::-1]
    with np.errstate(invalid="ignore"):
        large = [np.isnan(side) | (side >= top) for side in (before, after)]
    nothing = np.isnan(before) & np.isnan(after)
    return np.asarray(large[0] & large[1] & ~nothing)


def _last_known(x: Array) -> Array:
    """The last value of (n,) that is a number, or NaN before the first."""
    known = ~np.isnan(x)
    index = np.maximum.accumulate(np.where(known, np.arange(len(x)), -1))
    return np.where(index >= 0, x[np.maximum(index, 0)], np.nan)


def _too_little_left(flying: Mask, near: Mask, rate: float) -> bool:
    """Whether leaving out what may be near costs the flight."""
    lost = float((flying & near).sum() / rate)
    left = float((flying & ~near).sum() / rate)
    return left < ENOUGH_S and lost > left


def _known_near(state: AirState, surface: Surface, vehicle: Vehicle) -> Mask:
    """Samples (n,) at which the surface is known to matter."""
    with np.errstate(invalid="ignore"):
        return np.asarray(
            getattr(state, surface.nearest).min(axis=1) < EFFECT_RADII * vehicle.rotor_radius_m
        )


def _moved_away(state: AirState, surface: Surface, when: Mask) -> AirState:
    """The state with a surface at infinity ``when`` (n,)."""
    columns = {
        name: np.where(when[:, None], np.inf, getattr(state, name)) for name in surface.columns
    }
    return replace(state, **columns)
