"""Ground, walls and ceiling at one instant, as the tracks of the beams that look at them have them."""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from companion.config import PipelineConfig
from companion.estimation.estimates import BeamTrack, Estimates
from companion.estimation.range_doubt import Why
from companion.estimation.range_geometry import NO_MATTER_RADII, choose_walls
from models.vehicle import Vector3

RANGE_AGE_S = 0.22
"""An older range is stale. With the fade and one setpoint, offsets are zero 0.5 s after the last reading; 10 Hz is
enough."""
_STEP_S = 1.5
"""For so long after ground or wall jumped, offsets stay away and nothing is learned."""
_CLEAR_AFTER_S = 0.5
"""A near surface has gone after readings without an echo for so long: a single lost echo at 10 Hz is no clear sight."""


class Seen(Enum):
    """What a direction is known to hold."""

    SURFACE = "surface"
    NOTHING = "nothing within range"
    UNDECLARED = "no sensor declared"
    MISSING = "never heard"
    STALE = "stale"
    LOST = "lost its echo"
    FROZEN = "frozen"


_DOUBTED = {Why.LOST: Seen.LOST, Why.FROZEN: Seen.FROZEN}


class Surface(NamedTuple):
    """Ground, wall or ceiling at one instant: distance of the CG [m] (inf: nothing), closing rate, sigma, direction."""

    seen: Seen
    distance_m: float = math.inf
    rate_m_s: float = 0.0
    sigma_m: float = 0.0
    normal_ned: Vector3 | None = None
    stepped_s: float = -math.inf
    """When it last jumped."""
    slant_m: float = math.nan
    """What the sensor itself last read."""
    met_ned: Vector3 | None = None
    """Where on a wall that ended, from the CG: no velocity leads it."""
    heard_s: float = -math.inf
    """When it came."""
    jumped: bool = False
    """The distance jumped while the vehicle stayed where it was, and has not come back."""

    @property
    def known(self) -> bool:
        """False where the direction should be watched and is not."""
        return self.seen in (Seen.SURFACE, Seen.NOTHING, Seen.UNDECLARED)

    def stepped(self, t_s: float) -> bool:
        """Whether ground or wall jumped a moment ago."""
        return t_s - self.stepped_s < _STEP_S


def surface(estimates: Estimates, config: PipelineConfig, target: str, t_s: float) -> Surface:
    """Ground or ceiling at ``t_s``, or the nearest wall, seen from the CG."""
    if target == "wall":
        return walls(estimates, config, t_s)[0]
    seen = _seen_by(estimates, config, target, t_s)
    if not seen:
        return Surface(Seen.UNDECLARED)
    near = [one for one in seen if one.seen is Seen.SURFACE]
    if near:
        return min(near, key=lambda one: one.distance_m)
    return next((one for one in seen if not one.known), seen[0])


def walls(estimates: Estimates, config: PipelineConfig, t_s: float) -> tuple[Surface, Surface]:
    """The nearest wall at ``t_s``, and the nearest at another bearing, seen from the CG."""
    seen = _seen_by(estimates, config, "wall", t_s)
    if not seen:
        return Surface(Seen.UNDECLARED), Surface(Seen.UNDECLARED)
    lost = next((one for one in seen if not one.known), None)
    if lost is not None:
        return lost, lost
    if len(seen) == 1:
        return seen[0], Surface(Seen.UNDECLARED)
    up = (0.0, 0.0, -1.0)
    chosen = choose_walls(
        [one.distance_m for one in seen],
        [up if one.normal_ned is None else one.normal_ned for one in seen],
    )
    first = int(chosen.first)
    second = int(chosen.second)
    return (
        seen[first] if first >= 0 else Surface(Seen.NOTHING),
        seen[second] if second >= 0 else Surface(Seen.NOTHING),
    )


def _seen_by(
    estimates: Estimates, config: PipelineConfig, target: str, t_s: float
) -> list[Surface]:
    """What every beam that looks at ``target`` sees; an undeclared one that was never heard is not there."""
    declared = sum(2 if sensor.ring else 1 for sensor in config.vehicle.rangefinders)
    return [
        _beam_surface(beam, config, t_s)
        for k, (sensor, beam) in enumerate(
            zip(config.vehicle.watched, estimates.beams, strict=True)
        )
        if sensor.target == target and (k < declared or beam.heard_s > -math.inf)
    ]


def _beam_surface(beam: BeamTrack, config: PipelineConfig, t_s: float) -> Surface:
    track = beam.track
    heard = t_s - beam.heard_s
    was_near = track is not None and track.value < NO_MATTER_RADII * config.vehicle.rotor_radius_m
    if heard <= RANGE_AGE_S and t_s - beam.clear_since_s >= (_CLEAR_AFTER_S if was_near else 0.0):
        return Surface(Seen.NOTHING, slant_m=math.inf)
    if track is not None and track.age(t_s) <= RANGE_AGE_S:
        return Surface(
            seen=Seen.SURFACE,
            distance_m=track.at(t_s),
            rate_m_s=track.rate,
            sigma_m=track.sigma,
            normal_ned=beam.normal_ned,
            stepped_s=track.restarted_s,
            slant_m=beam.slant_m,
            met_ned=beam.met_ned,
            heard_s=beam.heard_s,
            jumped=beam.jumped_from is not None,
        )
    if beam.read.why is not None and heard <= RANGE_AGE_S:
        return Surface(_DOUBTED[beam.read.why])
    return Surface(Seen.MISSING if beam.heard_s == -math.inf else Seen.STALE)
