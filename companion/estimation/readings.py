"""Messages of range sensors as readings of the watched directions: single beams, and rings that see walls."""

from __future__ import annotations

import math

from companion.config import PipelineConfig
from companion.estimation.beams import SIGMA_M, Reading, read
from companion.estimation.estimates import Estimates
from companion.estimation.range_doubt import UNREAD
from companion.estimation.range_geometry import plane_distance_now
from companion.estimation.ring_planes import placed, ring_view
from companion.estimation.surfaces import surface
from companion.estimation.vectors import plus, scaled, turned
from companion.estimation.wall_line import WallLine
from companion.mavlink.range_beams import dot, orientation_direction
from companion.mavlink.samples import Range, RangeVerdict, Ring
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3, Vehicle

_SAME_BEAM_COS = 0.98
"""Two beams within 11 degrees look the same way."""
_SILENT_S = 1.0
"""A sensor that was silent for longer gives its place to another one that looks the same way."""
_RING_ID = -1
"""A ring has no sensor id."""


def take_range(estimates: Estimates, sample: Range | Ring, config: PipelineConfig) -> Estimates:
    """The surfaces that one message of a range sensor sees."""
    if isinstance(sample, Ring):
        return take_ring(estimates, sample, config)
    return take_beam(estimates, sample, config)


def take_beam(estimates: Estimates, sample: Range, config: PipelineConfig) -> Estimates:
    """A range goes to the watched rangefinder that looks the same way; others are ignored, never guessed."""
    vehicle = config.vehicle
    rows = estimates.rows
    index = _match(estimates, sample, vehicle)
    if index is None or rows is None or sample.direction_frd is None:
        return estimates
    if sample.verdict is RangeVerdict.ABOVE_MAX:
        slant = math.inf
    else:
        slant = sample.distance_m
    if sample.verdict not in (RangeVerdict.OK, RangeVerdict.ABOVE_MAX):
        slant = math.nan
    target = vehicle.watched[index].target
    mount_m = vehicle.watched[index].position_m
    if target == "wall":
        ground = surface(estimates, config, "ground", sample.t_s).distance_m
    else:
        ground = math.inf
    beam_ned = turned(rows, sample.direction_frd)
    distance, normal = plane_distance_now(
        target=target,
        beam_ned=beam_ned,
        position_m=mount_m,
        slant_m=slant,
        rotation=rows,
        height_cg_m=ground,
        rotor_radius_m=vehicle.rotor_radius_m,
    )
    reading = Reading(
        t_s=sample.t_s,
        sensor=(sample.component, sample.sensor_id),
        slant_m=slant,
        beam_ned=beam_ned,
        distance_m=distance,
        normal_ned=normal,
        facing_ned=normal,
        sigma_m=SIGMA_M if sample.sigma_m is None else sample.sigma_m,
    )
    beam = estimates.beams[index]
    if target == "wall" and math.isfinite(distance):
        met_ned = plus(turned(rows, mount_m), scaled(beam_ned, slant))
        reading = _square_to_wall(reading, met_ned, beam.line)
    return read(estimates, index, beam, reading, config)


def _square_to_wall(reading: Reading, met_ned: Vector3, line: WallLine | None) -> Reading:
    """The reading as the distance square to the wall, as far as it is known how that runs."""
    normal = None if line is None else line.seen_along(reading.beam_ned)
    if normal is None:
        normal = reading.normal_ned
    return reading._replace(distance_m=dot(normal, met_ned), normal_ned=normal, met_ned=met_ned)


def _match(estimates: Estimates, sample: Range, vehicle: Vehicle) -> int | None:
    if sample.direction_frd is None:
        return None
    for index, declared in enumerate(vehicle.watched):
        direction = orientation_direction(declared.orientation)
        if (
            direction is None
            or dot(direction, sample.direction_frd) < _SAME_BEAM_COS
            or declared.target == "none"
        ):
            continue
        beam = estimates.beams[index]
        # Two sensors that look the same way: the one heard first keeps the place while it speaks.
        if (
            beam.sensor in (None, (sample.component, sample.sensor_id))
            or sample.t_s - beam.heard_s > _SILENT_S
        ):
            return index
    return None


def take_ring(estimates: Estimates, sample: Ring, config: PipelineConfig) -> Estimates:
    """The walls that a declared ring sees, one a place; a place without one sees nothing, or is not known."""
    vehicle = config.vehicle
    places = [
        k for k, sensor in enumerate(vehicle.watched) if sensor.ring and sensor.target == "wall"
    ][:2]
    beams = [estimates.beams[k] for k in places]
    sensor = (sample.component, _RING_ID)
    if not places or estimates.rows is None:
        return estimates
    if beams[0].sensor not in (None, sensor) and sample.t_s - beams[0].heard_s <= _SILENT_S:
        return estimates
    ground = surface(estimates, config, "ground", sample.t_s).distance_m
    view = ring_view(sample, estimates.rows, vehicle.watched[places[0]].position_m, ground, vehicle)
    for k, old, plane in zip(
        places, beams, placed(view, [b.normal_ned for b in beams]), strict=True
    ):
        if not plane.same_wall(old.normal_ned):
            old = with_changes(old, track=None, read=UNREAD, jumped_from=None)
        normal = plane.normal_ned
        seen = math.isfinite(plane.distance_m)
        reading = Reading(
            t_s=sample.t_s,
            sensor=sensor,
            slant_m=plane.slant_m,
            beam_ned=normal,
            distance_m=plane.distance_m,
            normal_ned=normal,
            facing_ned=normal,
            met_ned=scaled(normal, plane.distance_m) if seen else None,
            single=False,
        )
        estimates = read(estimates, k, old, reading, config)
    return estimates
