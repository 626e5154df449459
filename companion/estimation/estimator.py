"""What is known of the vehicle's surroundings: one track per range beam and per rotor, each with sigma and age."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from companion.config import PipelineConfig
from companion.estimation.kalman import Outcome, Track, TrackModel, measure, measure_rate, predict
from companion.estimation.position_trust import PositionReset, PositionTrust, position_reset
from companion.estimation.range_doubt import (
    UNREAD,
    Doubt,
    OldPlace,
    Sighting,
    Why,
    doubt,
    jumped,
    remembered,
)
from companion.estimation.range_geometry import (
    NO_MATTER_RADII,
    choose_walls,
    plane_distance,
)
from companion.estimation.ring_planes import placed, ring_view
from companion.estimation.vectors import plus, turned
from companion.mavlink.range_beams import dot, orientation_direction
from companion.mavlink.samples import (
    Attitude,
    Battery,
    LocalPosition,
    Pressure,
    Range,
    RangeVerdict,
    Ring,
    RotorSpeeds,
    ServoOutput,
)
from models.common.frames import Rows, rotation_rows
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3, Vehicle
from models.vehicle_wrench import rpm_from_servos

ATTITUDE_AGE_S = 0.2
POSITION_AGE_S = 0.5
"""Older ones are none."""
RANGE_AGE_S = 0.22
"""An older range is stale. With the fade and one setpoint, offsets are zero 0.5 s after the last reading; 10 Hz is
enough."""
ROTOR_AGE_S = 0.22
"""The same of a rotor's speed."""
_RANGE_TRACK = TrackModel(
    acceleration_sd=1.5, initial_rate_sd=0.5, gate=16.0, restart_after=5, agree_within=0.10
)
_ROTOR_TRACK = TrackModel(
    acceleration_sd=6000.0, initial_rate_sd=2000.0, gate=25.0, restart_after=3, agree_within=400.0
)
_RANGE_DELAY_S = 0.03
_ROTOR_DELAY_S = 0.03
"""Age of a reading when it is stamped (a sensor's own averaging)."""
_RANGE_SIGMA_M = 0.01
_RANGE_SIGMA_SHARE = 0.005
_VELOCITY_SIGMA_M_S = 0.10
_ROTOR_SIGMA_RPM = 15.0
_STEP_S = 1.5
_STOPPED_RPM = 100.0
"""A zero, and what an ESC reports of a rotor that coasts: a tenth of the slowest idle speeds."""
_SPINNING_RPM = 500.0
"""Half of the slowest idle speeds; no rotor lifts anything below it."""
_SPUN_S = 1.0
"""A rotor that turned this short ago still does: none stops faster by itself."""
_SOUND_M_S = 340.0
"""Blade tips are never faster: such a speed is no speed but a damaged or saturated number."""
_CLEAR_AFTER_S = 0.5
"""A near surface has gone after readings without an echo for so long: a single lost echo at 10 Hz is no clear sight."""
_POSITION_NEAR_S = 0.3
"""A position further off in time says nothing about a reading's motion."""
_JUMPS_WITHIN_S = 1.0
"""After a longer silence another distance is no jump."""


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


@dataclass(frozen=True, kw_only=True)
class BeamTrack:
    """One declared rangefinder: the distance of the CG to the plane it sees."""

    track: Track | None = None
    normal_ned: Vector3 | None = None
    """Unit vector towards the plane."""
    heard_s: float = -math.inf
    clear_since_s: float = math.inf
    """Start of the present run of readings beyond the sensor's range; inf while it sees something."""
    sensor: tuple[int, int] | None = None
    slant_m: float = math.nan
    """The newest reading, as sent."""
    read: Doubt = UNREAD
    """What the next reading is compared with, and why the newest is not used."""
    jumped_from: OldPlace | None = None
    """While a jump of the range is not explained."""


class Surface(NamedTuple):
    """Ground, wall or ceiling at one instant: distance of the CG [m] (inf: nothing), closing rate, sigma, direction."""

    seen: Seen
    distance_m: float = math.inf
    rate_m_s: float = 0.0
    sigma_m: float = 0.0
    normal_ned: Vector3 | None = None
    stepped_s: float = -math.inf
    slant_m: float = math.nan
    """What the sensor itself last read."""
    jumped: bool = False
    """The distance jumped while the vehicle stayed where it was, and has not come back."""

    @property
    def known(self) -> bool:
        """False where the direction should be watched and is not."""
        return self.seen in (Seen.SURFACE, Seen.NOTHING, Seen.UNDECLARED)

    def stepped(self, t_s: float) -> bool:
        """Whether ground or wall jumped a moment ago: offsets stay away for so long."""
        return t_s - self.stepped_s < _STEP_S


@dataclass(frozen=True, slots=True)
class Packets:
    """An ESC's counter of telemetry packets, and whether it has ever moved: some never do."""

    count: int
    moves: bool


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """State of the estimator. Empty until messages arrive."""

    beams: tuple[BeamTrack, ...]
    rotors: tuple[Track | None, ...]
    attitude: Attitude | None = None
    rows: Rows | None = None
    """Of the rotation body FRD to world NED: the newest attitude's."""
    position: LocalPosition | None = None
    trust: PositionTrust = field(default_factory=PositionTrust)
    reset: PositionReset | None = None
    servo: ServoOutput | None = None
    servo_rpm: tuple[float, ...] | None = None
    battery: Battery | None = None
    pressure: Pressure | None = None
    packets: Mapping[int, Packets] = field(default_factory=dict)
    """Telemetry packets by ESC."""
    undeclared_s: float = -math.inf
    """When an ESC that the vehicle file does not name last turned."""
    esc_temperature_c: float | None = None
    """The hottest ESC."""


def blank_estimates(vehicle: Vehicle) -> Estimates:
    """Nothing heard yet."""
    return Estimates(
        beams=(BeamTrack(),) * len(vehicle.watched), rotors=(None,) * len(vehicle.rotors)
    )


def take_attitude(estimates: Estimates, sample: Attitude) -> Estimates:
    """The newest attitude; the rotation is kept beside it, in plain floats."""
    return with_changes(estimates, attitude=sample, rows=rotation_rows(*sample.q_ned_frd))


def take_position(estimates: Estimates, sample: LocalPosition) -> Estimates:
    """Position and velocity; the vehicle's own velocity measures the rate of every track."""
    if estimates.position is None:
        reset = None
    else:
        reset = position_reset(estimates.position, sample)
    beams = tuple([_carried(beam, sample, reset) for beam in estimates.beams])
    return with_changes(estimates, position=sample, beams=beams, reset=reset or estimates.reset)


def _carried(beam: BeamTrack, sample: LocalPosition, reset: PositionReset | None) -> BeamTrack:
    """The beam after a position; where that was set anew, the vehicle itself did not move."""
    if beam.track is not None and beam.normal_ned is not None:
        closing = -dot(sample.velocity_ned, beam.normal_ned)
        track = measure_rate(beam.track, _RANGE_TRACK, sample.t_s, closing, _VELOCITY_SIGMA_M_S)
        beam = with_changes(beam, track=track)
    if reset is None:
        return beam
    old = beam.jumped_from
    if old is not None:
        old = old._replace(position_ned=plus(old.position_ned, reset.by_ned))
    return with_changes(beam, read=Doubt(beam.read.why, None, None), jumped_from=old)


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
    sigma_m: float = _RANGE_SIGMA_M


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
    plane = plane_distance(
        target=target,
        direction_frd=sample.direction_frd,
        position_m=mount_m,
        range_m=slant,
        rotation=np.array(rows),
        height_cg_m=ground,
        rotor_radius_m=vehicle.rotor_radius_m,
    )
    north, east, down = plane.normal_ned.tolist()
    reading = Reading(
        t_s=sample.t_s,
        sensor=(sample.component, sample.sensor_id),
        slant_m=slant,
        beam_ned=turned(rows, sample.direction_frd),
        distance_m=float(plane.distance_m),
        normal_ned=(north, east, down),
        sigma_m=_RANGE_SIGMA_M if sample.sigma_m is None else sample.sigma_m,
    )
    return _read(estimates, index, estimates.beams[index], reading, config)


def _match(estimates: Estimates, sample: Range, vehicle: Vehicle) -> int | None:
    if sample.direction_frd is None:
        return None
    for index, declared in enumerate(vehicle.watched):
        direction = orientation_direction(declared.orientation)
        if (
            direction is None
            or dot(direction, sample.direction_frd) < 0.98
            or declared.target == "none"
        ):
            continue
        beam = estimates.beams[index]
        # Two sensors that look the same way: the one heard first keeps the place while it speaks.
        if (
            beam.sensor in (None, (sample.component, sample.sensor_id))
            or sample.t_s - beam.heard_s > 1.0
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
    sensor = (sample.component, -1)
    if not places or estimates.rows is None:
        return estimates
    if beams[0].sensor not in (None, sensor) and sample.t_s - beams[0].heard_s <= 1.0:
        return estimates
    ground = surface(estimates, config, "ground", sample.t_s).distance_m
    view = ring_view(sample, estimates.rows, vehicle.watched[places[0]].position_m, ground, vehicle)
    for k, old, plane in zip(
        places, beams, placed(view, [b.normal_ned for b in beams]), strict=True
    ):
        if not plane.same_wall(old.normal_ned):
            old = with_changes(old, track=None, read=UNREAD, jumped_from=None)
        normal = plane.normal_ned
        reading = Reading(sample.t_s, sensor, plane.slant_m, normal, plane.distance_m, normal)
        estimates = _read(estimates, k, old, reading, config)
    return estimates


def _read(
    estimates: Estimates, index: int, beam: BeamTrack, reading: Reading, config: PipelineConfig
) -> Estimates:
    """The estimates after a reading of the watched direction ``index``."""
    target = config.vehicle.watched[index].target
    near_m = NO_MATTER_RADII * config.vehicle.rotor_radius_m
    t_s = reading.t_s
    slant = reading.slant_m
    position = estimates.position
    read = beam.read
    here = None
    if (
        position is not None
        and abs(t_s - position.t_s) <= _POSITION_NEAR_S
        and estimates.trust.trusted
    ):
        here = Sighting(slant, position.position_ned, reading.beam_ned)
    if not math.isnan(slant):
        # An echo that was lost, a reading that froze: both are seen by the vehicle's own motion.
        if here is None:
            read = Doubt(None, None, read.sight)
        else:
            read = doubt(here, read, near_m, target)
    beam = with_changes(beam, sensor=reading.sensor, heard_s=t_s, slant_m=slant, read=read)
    clear_since_s = math.inf
    if not math.isnan(slant) and read.why is None:
        if math.isfinite(reading.distance_m):
            beam = _measured(beam, reading, here, near_m)
        elif math.isinf(reading.distance_m):
            clear_since_s = min(beam.clear_since_s, t_s)
    beam = with_changes(beam, clear_since_s=clear_since_s)
    return with_changes(
        estimates, beams=(*estimates.beams[:index], beam, *estimates.beams[index + 1 :])
    )


def _measured(beam: BeamTrack, reading: Reading, here: Sighting | None, near_m: float) -> BeamTrack:
    """The beam after a plane that its sensor believes to see. ``here``: where it was read, None where not known."""
    t_s = reading.t_s
    before = beam.track
    # 1 cm steps on the wire add a uniform error of 1/sqrt(12) cm.
    sigma = math.sqrt(
        reading.sigma_m**2 + (_RANGE_SIGMA_SHARE * reading.slant_m) ** 2 + 0.01**2 / 12.0
    )
    track, outcome = measure(before, _RANGE_TRACK, t_s, reading.distance_m, sigma, _RANGE_DELAY_S)
    if outcome is Outcome.OUTLIER:
        return with_changes(beam, track=track)
    old = beam.jumped_from
    if here is not None and old is not None:
        old = remembered(old, reading.distance_m, reading.normal_ned, here.position_ned)
    elif here is not None and before is not None and outcome is Outcome.RESTARTED:
        place = OldPlace(
            predict(before, _RANGE_TRACK, t_s).value, reading.normal_ned, here.position_ned
        )
        if before.age(t_s) <= _JUMPS_WITHIN_S:
            old = jumped(place, reading.distance_m, near_m)
        else:
            old = None
    return with_changes(beam, track=track, jumped_from=old, normal_ned=reading.normal_ned)


def take_rotors(estimates: Estimates, sample: RotorSpeeds, config: PipelineConfig) -> Estimates:
    """Speeds by ESC number.

    A zero of a rotor that was spinning, or while others spin, is a lost frame, not a stopped rotor. Telemetry that
    counts its packets and does not count on repeats an old value. Blade tips beyond the speed of sound are no speed.
    """
    vehicle = config.vehicle
    first = sample.first_esc
    spinning = [first + k for k, rpm in enumerate(sample.rpm) if abs(rpm) > _SPINNING_RPM]
    places = _rotor_places(vehicle)
    some_spin = any(esc in places for esc in spinning)
    packets, repeated = _counted(estimates, sample)
    fastest_rpm = _SOUND_M_S / vehicle.rotor_radius_m * 30.0 / math.pi
    rotors = list(estimates.rotors)
    for slot, signed_rpm in enumerate(sample.rpm):
        rpm = abs(signed_rpm)
        if repeated[slot] or rpm > fastest_rpm:
            continue
        for k in places.get(first + slot, ()):
            if rpm >= _STOPPED_RPM or not (some_spin or _spun(rotors[k], sample.t_s)):
                rotors[k], _ = measure(
                    rotors[k], _ROTOR_TRACK, sample.t_s, rpm, _ROTOR_SIGMA_RPM, _ROTOR_DELAY_S
                )
    undeclared = vehicle.telemetered and any(esc not in places for esc in spinning)
    if undeclared:
        undeclared_s = sample.t_s
    else:
        undeclared_s = estimates.undeclared_s
    estimates = with_changes(
        estimates, rotors=tuple(rotors), packets=packets, undeclared_s=undeclared_s
    )
    return take_temperatures(estimates, sample.temperature_c)


@lru_cache(maxsize=4)
def _rotor_places(vehicle: Vehicle) -> dict[int, list[int]]:
    """Places in ``vehicle.rotors`` by ESC number."""
    places: dict[int, list[int]] = {}
    for place, rotor in enumerate(vehicle.rotors):
        if rotor.esc is not None:
            places.setdefault(rotor.esc, []).append(place)
    return places


def _spun(track: Track | None, t_s: float) -> bool:
    """Whether a rotor turned within the last second."""
    return track is not None and track.value > _SPINNING_RPM and track.age(t_s) < _SPUN_S


def _counted(estimates: Estimates, sample: RotorSpeeds) -> tuple[Mapping[int, Packets], list[bool]]:
    """Packets so far, and which places of ``sample`` repeat an old value: of counters that are known to count."""
    if sample.count is None:
        return estimates.packets, [False] * len(sample.rpm)
    counts = dict(estimates.packets)
    repeated = []
    for k, count in enumerate(sample.count):
        before = counts.get(sample.first_esc + k)
        moves = before is not None and (before.moves or count != before.count)
        repeated.append(moves and before is not None and count == before.count)
        counts[sample.first_esc + k] = Packets(count, moves)
    return counts, repeated


def take_servo(estimates: Estimates, sample: ServoOutput, config: PipelineConfig) -> Estimates:
    """Servo outputs: vanes, and rotor speeds where none is telemetered."""
    if config.vehicle.telemetered:
        return with_changes(estimates, servo=sample)
    rpm = rpm_from_servos(config.vehicle, config.model, np.asarray(sample.pwm_us, dtype=float))
    return with_changes(estimates, servo=sample, servo_rpm=tuple(rpm.tolist()))


def take_temperatures(estimates: Estimates, celsius: Iterable[float]) -> Estimates:
    """The hottest ESC; places that read NaN are left out."""
    known = [t for t in celsius if math.isfinite(t)]
    if known:
        return with_changes(estimates, esc_temperature_c=max(known))
    return estimates


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
            jumped=beam.jumped_from is not None,
        )
    if beam.read.why is not None and heard <= RANGE_AGE_S:
        return Surface(_DOUBTED[beam.read.why])
    return Surface(Seen.MISSING if beam.heard_s == -math.inf else Seen.STALE)


def rotor_speeds(
    estimates: Estimates, config: PipelineConfig, t_s: float
) -> tuple[float, ...] | None:
    """Rotor speeds [rpm], of every rotor, at ``t_s``, or None where any is missing or too old."""
    if not config.vehicle.telemetered:
        fresh = estimates.servo is not None and t_s - estimates.servo.t_s <= ROTOR_AGE_S
        if fresh:
            return estimates.servo_rpm
        return None
    out = []
    for track in estimates.rotors:
        if track is None or track.age(t_s) > ROTOR_AGE_S:
            return None
        # A speed changes within tens of ms: between messages hold the value rather than extrapolate its slope.
        out.append(max(track.value, 0.0))
    return tuple(out)
