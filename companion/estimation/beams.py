"""What one reading of a watched direction, or one position, does to the track of its distance."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.config import PipelineConfig
from companion.estimation.estimates import BeamTrack, Estimates
from companion.estimation.kalman import Outcome, TrackModel, measure, measure_rate, predict
from companion.estimation.position_trust import PositionReset
from companion.estimation.range_doubt import Doubt, OldPlace, Sighting, doubt, jumped, remembered
from companion.estimation.range_geometry import NO_MATTER_RADII
from companion.estimation.vectors import plus
from companion.estimation.wall_line import WallLine, met, square_to
from companion.mavlink.range_beams import dot
from companion.mavlink.samples import LocalPosition
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3

_TRACK = TrackModel(
    acceleration_sd=1.5, initial_rate_sd=0.5, gate=16.0, restart_after=5, agree_within=0.10
)
_DELAY_S = 0.03
"""Age of a reading when it is stamped (a sensor's own averaging)."""
SIGMA_M = 0.01
"""Of a reading whose sensor does not say it."""
_SIGMA_SHARE = 0.005
_VELOCITY_SIGMA_M_S = 0.10
_POSITION_NEAR_S = 0.3
"""A position further off in time says nothing about a reading's motion."""
_BESIDE = 0.6
"""Of the distance from which a wall matters: nearer than that, how it runs is not learned any more."""
_JUMPS_WITHIN_S = 1.0
"""After a longer silence another distance is no jump."""


class Reading(NamedTuple):
    """What a message of a range sensor says of one watched direction."""

    t_s: float
    sensor: tuple[int, int]
    slant_m: float
    """inf: nothing within range, NaN: not readable; so are distances."""
    beam_ned: Vector3
    distance_m: float
    """Of the CG to the plane that is seen."""
    normal_ned: Vector3
    """Unit vector towards that."""
    facing_ned: Vector3
    """The same as a vehicle sees it that knows nothing of how a wall runs."""
    sigma_m: float = SIGMA_M
    met_ned: Vector3 | None = None
    """Where on a wall it ends, from the CG; None: not on a wall."""
    single: bool = True
    """Of one beam, which does not see how the wall runs."""


def read(
    estimates: Estimates, index: int, beam: BeamTrack, reading: Reading, config: PipelineConfig
) -> Estimates:
    """The estimates after a reading of the watched direction ``index``, whose track is ``beam``."""
    target = config.vehicle.watched[index].target
    near_m = NO_MATTER_RADII * config.vehicle.rotor_radius_m
    t_s = reading.t_s
    slant = reading.slant_m
    here = _sighting(estimates, reading)
    doubted = beam.read
    if not math.isnan(slant):
        # An echo that was lost, a reading that froze: both are seen by the vehicle's own motion.
        if here is None:
            doubted = Doubt(None, None, doubted.sight)
        else:
            doubted = doubt(here, doubted, near_m, target)
    usable = not math.isnan(slant) and doubted.why is None
    clear_since_s = math.inf
    if usable and math.isinf(reading.distance_m):
        clear_since_s = min(beam.clear_since_s, t_s)
    beam = with_changes(
        beam,
        sensor=reading.sensor,
        heard_s=t_s,
        slant_m=slant,
        met_ned=reading.met_ned,
        read=doubted,
        clear_since_s=clear_since_s,
    )
    if usable and math.isfinite(reading.distance_m):
        beam = _measured(beam, reading, here, near_m)
    return with_changes(
        estimates, beams=(*estimates.beams[:index], beam, *estimates.beams[index + 1 :])
    )


def _sighting(estimates: Estimates, reading: Reading) -> Sighting | None:
    """Where the vehicle was when it read this; None where no position near in time is believed."""
    position = estimates.position
    if position is None or not estimates.trust.trusted:
        return None
    if not abs(reading.t_s - position.t_s) <= _POSITION_NEAR_S:
        return None
    return Sighting(reading.slant_m, position.position_ned, reading.beam_ned)


def _measured(beam: BeamTrack, reading: Reading, here: Sighting | None, near_m: float) -> BeamTrack:
    """The beam after a plane that its sensor believes to see. ``here``: where it was read, None where not known."""
    t_s = reading.t_s
    before = beam.track
    # 1 cm steps on the wire add a uniform error of 1/sqrt(12) cm.
    sigma = math.sqrt(reading.sigma_m**2 + (_SIGMA_SHARE * reading.slant_m) ** 2 + 0.01**2 / 12.0)
    track, outcome = measure(before, _TRACK, t_s, reading.distance_m, sigma, _DELAY_S)
    line = _line(beam.line, reading, here, outcome, near_m)
    if outcome is Outcome.OUTLIER:
        return with_changes(beam, track=track, line=line)
    old = beam.jumped_from
    if here is not None and old is not None:
        distance_m = reading.distance_m
        if reading.met_ned is not None:
            distance_m = dot(reading.met_ned, old.normal_ned)
        old = remembered(old, distance_m, reading.facing_ned, here.position_ned)
    elif here is not None and before is not None and outcome is Outcome.RESTARTED:
        place = OldPlace(
            distance_m=predict(before, _TRACK, t_s).value,
            normal_ned=reading.normal_ned,
            facing_ned=reading.facing_ned,
            position_ned=here.position_ned,
        )
        if before.age(t_s) <= _JUMPS_WITHIN_S:
            old = jumped(place, reading.distance_m, near_m)
        else:
            old = None
    return with_changes(
        beam, track=track, jumped_from=old, normal_ned=reading.normal_ned, line=line
    )


def _line(
    known: WallLine | None,
    reading: Reading,
    here: Sighting | None,
    outcome: Outcome,
    near_m: float,
) -> WallLine | None:
    """How the wall runs, after a reading.

    It is learned on the way to the wall. Beside it a position that goes wrong would turn it.
    """
    if reading.met_ned is None or here is None or not reading.single:
        return known
    place = plus(here.position_ned, reading.met_ned)
    if known is None or known.seen_along(reading.beam_ned) is None:
        return square_to(reading.beam_ned, place, reading.t_s)
    same = known.near(place)
    if same and reading.distance_m >= _BESIDE * near_m:
        return met(known, reading.beam_ned, place, reading.t_s)
    if outcome is Outcome.RESTARTED and not same:
        return square_to(reading.beam_ned, place, reading.t_s)
    if outcome is Outcome.OUTLIER:
        return known
    # Beside the wall, or the position leapt and the range did not: the direction is kept.
    return known.through(place, reading.t_s)


def moved(beam: BeamTrack, sample: LocalPosition, reset: PositionReset | None) -> BeamTrack:
    """The beam after a position; where that was set anew, the vehicle itself did not move."""
    if beam.track is not None and beam.normal_ned is not None:
        closing = -dot(sample.velocity_ned, beam.normal_ned)
        track = measure_rate(beam.track, _TRACK, sample.t_s, closing, _VELOCITY_SIGMA_M_S)
        beam = with_changes(beam, track=track)
    if reset is None:
        return beam
    old = beam.jumped_from
    if old is not None:
        old = old._replace(position_ned=plus(old.position_ned, reset.by_ned))
    line = beam.line
    if line is not None:
        line = line.shifted(reset.by_ned)
    return with_changes(beam, read=Doubt(beam.read.why, None, None), jumped_from=old, line=line)
