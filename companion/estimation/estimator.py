"""What is known of the vehicle's surroundings: one track per range beam and per rotor, each with sigma and age."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from companion.config import PipelineConfig
from companion.estimation.kalman import Track, TrackModel, Verdict, measure, measure_rate, predict
from companion.estimation.position_trust import PositionReset, PositionTrust, position_reset
from companion.estimation.range_doubt import UNREAD, Doubt, Sighting, Why, doubt
from companion.estimation.range_geometry import (
    NO_MATTER_RADII,
    choose_walls,
    fan_heights_now,
    fan_wall_distances_now,
    nearest_level_now,
    plane_distance,
)
from companion.estimation.range_jump import OldPlace, jumped, remembered
from companion.estimation.ring_planes import placed, ring_view
from companion.mavlink.range_beams import dot, orientation_direction
from companion.mavlink.samples import (
    Attitude,
    Battery,
    EscHealth,
    LocalPosition,
    Pressure,
    Range,
    RangeVerdict,
    Ring,
    RotorSpeeds,
    ServoOutput,
)
from models.evolve import replace
from models.frames import Rows, rotation_rows
from models.vehicle import Vector3, Vehicle
from models.vehicle_wrench import rpm_from_servos

ATTITUDE_AGE_S, POSITION_AGE_S = 0.2, 0.5
"""Older ones are none."""
RANGE_AGE_S = 0.22
"""An older range is stale. With the fade and one setpoint, offsets are zero 0.5 s after the last reading; 10 Hz is
enough."""
ROTOR_AGE_S = 0.22
"""The same of a rotor's speed."""
_RANGE_TRACK = TrackModel(acceleration_sd=1.5, initial_rate_sd=0.5, gate=16.0, restart_after=5, agree_within=0.10)
_ROTOR_TRACK = TrackModel(
    acceleration_sd=6000.0, initial_rate_sd=2000.0, gate=25.0, restart_after=3, agree_within=400.0
)
_RANGE_DELAY_S, _ROTOR_DELAY_S = 0.03, 0.03
"""Age of a reading when it is stamped (a sensor's own averaging)."""
_RANGE_SIGMA_M, _RANGE_SIGMA_SHARE = 0.01, 0.005
_VELOCITY_SIGMA_M_S, _ROTOR_SIGMA_RPM = 0.10, 15.0
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


@dataclass(frozen=True)
class BeamTrack:
    """One declared rangefinder: the distance of the CG to the plane it sees, and its newest verdict."""

    track: Track | None = None
    normal_ned: Vector3 | None = None
    """Unit vector towards the plane."""
    verdict: RangeVerdict | None = None
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


@dataclass(frozen=True)
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
    return Estimates((BeamTrack(),) * len(vehicle.watched), (None,) * len(vehicle.rotors))


def take_attitude(estimates: Estimates, sample: Attitude) -> Estimates:
    """The newest attitude; the rotation is kept beside it, in plain floats."""
    return replace(estimates, attitude=sample, rows=rotation_rows(*sample.q_ned_frd))


def take_position(estimates: Estimates, sample: LocalPosition) -> Estimates:
    """Position and velocity; the vehicle's own velocity measures the rate of every track."""
    velocity = sample.velocity_ned
    beams = tuple(
        [
            beam
            if beam.track is None or beam.normal_ned is None
            else replace(
                beam,
                track=measure_rate(
                    beam.track, _RANGE_TRACK, sample.t_s, -dot(velocity, beam.normal_ned), _VELOCITY_SIGMA_M_S
                ),
            )
            for beam in estimates.beams
        ]
    )
    reset = None if estimates.position is None else position_reset(estimates.position, sample)
    if reset is not None:  # the vehicle itself did not move
        beams = tuple(
            replace(beam, read=Doubt(beam.read.why, None, None), jumped_from=_moved(beam.jumped_from, reset.by_ned))
            for beam in beams
        )
    return replace(estimates, position=sample, beams=beams, reset=reset or estimates.reset)


def _moved(old: OldPlace | None, by: Vector3) -> OldPlace | None:
    if old is None:
        return None
    north, east, down = old.position_ned
    return old._replace(position_ned=(north + by[0], east + by[1], down + by[2]))


def take_range(estimates: Estimates, sample: Range | Ring, config: PipelineConfig) -> Estimates:
    """The surfaces that one message of a range sensor sees."""
    return take_ring(estimates, sample, config) if isinstance(sample, Ring) else take_beam(estimates, sample, config)


def take_beam(estimates: Estimates, sample: Range, config: PipelineConfig) -> Estimates:
    """A range goes to the watched rangefinder that looks the same way; others are ignored, never guessed."""
    index = _match(estimates, sample, config.vehicle)
    if index is None or estimates.rows is None:
        return estimates
    assert sample.direction_frd is not None
    x, y, z = sample.direction_frd
    north, east, down = [a * x + b * y + c * z for a, b, c in estimates.rows]
    verdict = sample.verdict
    slant = math.inf if verdict is RangeVerdict.ABOVE_MAX else sample.distance_m
    readable = verdict in (RangeVerdict.OK, RangeVerdict.ABOVE_MAX) and slant == slant
    heard = replace(estimates.beams[index], verdict=verdict, sensor=(sample.component, sample.sensor_id))
    beam = _heard(
        estimates, heard, index, sample.t_s, slant if readable else math.nan, (north, east, down), config.vehicle
    )
    if readable and beam.read.why is None:
        distance, normal = _plane(estimates, slant, index, sample, config)
        beam = _read_beam(estimates, beam, sample.t_s, distance, normal, sample.sigma_m, config)
    return _with_beam(estimates, index, beam)


def take_ring(estimates: Estimates, sample: Ring, config: PipelineConfig) -> Estimates:
    """The walls that a declared ring sees, one a place; a place without one sees nothing, or is not known."""
    vehicle = config.vehicle
    places = [k for k, sensor in enumerate(vehicle.watched) if sensor.ring and sensor.target == "wall"][:2]
    beams = [estimates.beams[k] for k in places]
    sensor = (sample.component, -1)
    if not places or estimates.rows is None:
        return estimates
    if beams[0].sensor not in (None, sensor) and sample.t_s - beams[0].heard_s <= 1.0:
        return estimates
    ground = surface(estimates, config, "ground", sample.t_s).distance_m
    view = ring_view(sample, estimates.rows, vehicle.watched[places[0]].position_m, ground, vehicle)
    for k, old, plane in zip(places, beams, placed(view, [b.normal_ned for b in beams]), strict=True):
        slant, verdict = plane.slant_m, RangeVerdict.OK
        if not math.isfinite(slant):
            verdict = RangeVerdict.ABOVE_MAX if slant == slant else RangeVerdict.LOW_QUALITY
        if not plane.same_wall(old.normal_ned):
            old = replace(old, track=None, read=UNREAD, jumped_from=None)
        heard = replace(old, verdict=verdict, sensor=sensor)
        beam = _heard(estimates, heard, k, sample.t_s, slant, plane.normal_ned, vehicle)
        if slant == slant and beam.read.why is None:
            beam = _read_beam(estimates, beam, sample.t_s, plane.distance_m, plane.normal_ned, None, config)
        estimates = _with_beam(estimates, k, beam)
    return estimates


def _with_beam(estimates: Estimates, index: int, beam: BeamTrack) -> Estimates:
    return replace(estimates, beams=(*estimates.beams[:index], beam, *estimates.beams[index + 1 :]))


def _heard(
    estimates: Estimates, beam: BeamTrack, index: int, t_s: float, slant: float, beam_ned: Vector3, vehicle: Vehicle
) -> BeamTrack:
    """The beam after a reading ``slant`` (inf: nothing within range, NaN: not readable), before its plane is taken."""
    readable = slant == slant
    read = _doubt(estimates, beam, slant, index, t_s, beam_ned, vehicle) if readable else beam.read
    clear_since_s = beam.clear_since_s if readable and read.why is None else math.inf
    return replace(beam, heard_s=t_s, slant_m=slant, read=read, clear_since_s=clear_since_s)


def _match(estimates: Estimates, sample: Range, vehicle: Vehicle) -> int | None:
    if sample.direction_frd is None:
        return None
    for index, declared in enumerate(vehicle.watched):
        direction = orientation_direction(declared.orientation)
        if direction is None or dot(direction, sample.direction_frd) < 0.98 or declared.target == "none":
            continue
        beam = estimates.beams[index]
        # Two sensors that look the same way: the one heard first keeps the place while it speaks.
        if beam.sensor in (None, (sample.component, sample.sensor_id)) or sample.t_s - beam.heard_s > 1.0:
            return index
    return None


def _doubt(
    estimates: Estimates, beam: BeamTrack, slant: float, index: int, t_s: float, beam_ned: Vector3, vehicle: Vehicle
) -> Doubt:
    """An echo that was lost, a reading that froze: both are seen by the vehicle's own motion."""
    position = estimates.position
    if position is None or abs(t_s - position.t_s) > _POSITION_NEAR_S or not estimates.trust.trusted:
        return Doubt(None, None, beam.read.sight)
    here = Sighting(slant, position.position_ned, beam_ned)
    return doubt(here, beam.read, NO_MATTER_RADII * vehicle.rotor_radius_m, vehicle.watched[index].target)


def _plane(
    estimates: Estimates, slant: float, index: int, sample: Range, config: PipelineConfig
) -> tuple[float, Vector3]:
    """Distance of the CG to the plane that a reading sees (inf: none in range, NaN: not known), and its direction."""
    declared = config.vehicle.watched[index]
    assert estimates.rows is not None
    assert sample.direction_frd is not None
    ground = math.inf
    if declared.target == "wall" and math.isfinite(slant):
        ground = surface(estimates, config, "ground", sample.t_s).distance_m
    plane = plane_distance(
        declared.target, sample.direction_frd, declared.position_m, slant, np.array(estimates.rows), ground,
        config.vehicle.rotor_radius_m,
    )  # fmt: skip
    north, east, down = plane.normal_ned.tolist()
    return float(plane.distance_m), (north, east, down)


def _read_beam(
    estimates: Estimates,
    beam: BeamTrack,
    t_s: float,
    distance: float,
    normal: Vector3,
    sigma_m: float | None,
    config: PipelineConfig,
) -> BeamTrack:
    """The beam after a reading that the sensor itself believes, as the plane at ``distance`` along ``normal``."""
    if math.isinf(distance):
        return replace(beam, clear_since_s=min(beam.clear_since_s, t_s))
    if math.isnan(distance):
        return replace(beam, clear_since_s=math.inf, verdict=RangeVerdict.LOW_QUALITY)
    own = sigma_m if sigma_m is not None else _RANGE_SIGMA_M
    # 1 cm steps on the wire add a uniform error of 1/sqrt(12) cm.
    sigma = math.sqrt(own**2 + (_RANGE_SIGMA_SHARE * beam.slant_m) ** 2 + 0.01**2 / 12.0)
    track, verdict = measure(beam.track, _RANGE_TRACK, t_s, distance, sigma, _RANGE_DELAY_S)
    if verdict is Verdict.RESTARTED and beam.track is None and track is not None:
        track = track._replace(restarted_s=-math.inf)  # the first sight of a surface is not a step of it
    old = _jumped_from(estimates, beam, verdict, distance, normal, t_s, config)
    beam = replace(beam, clear_since_s=math.inf, track=track, jumped_from=old)
    if verdict is Verdict.OUTLIER:
        return replace(beam, verdict=RangeVerdict.JUMP)
    return replace(beam, normal_ned=normal)


def _jumped_from(
    estimates: Estimates, beam: BeamTrack, verdict: Verdict, distance: float, normal: Vector3, t_s: float,
    config: PipelineConfig,
) -> OldPlace | None:  # fmt: skip
    """Where a surface that matters was before its range jumped, while the vehicle's position does not explain that."""
    old, track, position = beam.jumped_from, beam.track, estimates.position
    unplaced = position is None or abs(t_s - position.t_s) > _POSITION_NEAR_S or not estimates.trust.trusted
    if position is None or unplaced or verdict is Verdict.OUTLIER:
        return old
    if old is not None:
        return remembered(old, distance, normal, position.position_ned)
    if verdict is not Verdict.RESTARTED or track is None or track.age(t_s) > _JUMPS_WITHIN_S:
        return None
    before = predict(track, _RANGE_TRACK, t_s).value
    if min(before, distance) > NO_MATTER_RADII * config.vehicle.rotor_radius_m:
        return None
    return jumped(OldPlace(before, normal, position.position_ned), distance)


def take_rotors(estimates: Estimates, sample: RotorSpeeds, config: PipelineConfig) -> Estimates:
    """Speeds by ESC number.

    A zero of a rotor that was spinning, or while others spin, is a lost frame, not a stopped rotor. Telemetry that
    counts its packets and does not count on repeats an old value. Blade tips beyond the speed of sound are no speed.
    """
    vehicle, first = config.vehicle, sample.first_esc
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
                rotors[k], _ = measure(rotors[k], _ROTOR_TRACK, sample.t_s, rpm, _ROTOR_SIGMA_RPM, _ROTOR_DELAY_S)
    undeclared = vehicle.telemetered and any(esc not in places for esc in spinning)
    estimates = replace(
        estimates,
        rotors=tuple(rotors),
        packets=packets,
        undeclared_s=sample.t_s if undeclared else estimates.undeclared_s,
    )
    return estimates if sample.health is None else take_health(estimates, sample.health)


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
    counts, repeated = dict(estimates.packets), []
    for k, count in enumerate(sample.count):
        before = counts.get(sample.first_esc + k)
        moves = before is not None and (before.moves or count != before.count)
        repeated.append(moves and before is not None and count == before.count)
        counts[sample.first_esc + k] = Packets(count, moves)
    return counts, repeated


def take_servo(estimates: Estimates, sample: ServoOutput, config: PipelineConfig) -> Estimates:
    """Servo outputs: vanes, and rotor speeds where none is telemetered."""
    if config.vehicle.telemetered:
        return replace(estimates, servo=sample)
    rpm = rpm_from_servos(config.vehicle, config.model, np.asarray(sample.pwm_us, dtype=float))
    return replace(estimates, servo=sample, servo_rpm=tuple(rpm.tolist()))


def take_health(estimates: Estimates, sample: EscHealth) -> Estimates:
    """The hottest ESC; places that read NaN are left out."""
    known = [t for t in sample.temperature_c if math.isfinite(t)]
    return replace(estimates, esc_temperature_c=max(known)) if known else estimates


def surface(estimates: Estimates, config: PipelineConfig, target: str, t_s: float) -> Surface:
    """Ground or ceiling at ``t_s``, or the nearest wall, seen from the CG."""
    if target == "wall":
        return walls(estimates, config, t_s)[0]
    seen = _seen_by(estimates, config, target, t_s)
    if not seen:
        return Surface(Seen.UNDECLARED)
    distance = nearest_level_now([_distance(one) for one in seen])
    if math.isnan(distance):
        return next(one for one in seen if not one.known)
    return next(one for one in seen if one.distance_m == distance)


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
        [one.distance_m for one in seen], [up if one.normal_ned is None else one.normal_ned for one in seen]
    )
    first, second = int(chosen.first), int(chosen.second)
    return (
        seen[first] if first >= 0 else Surface(Seen.NOTHING),
        seen[second] if second >= 0 else Surface(Seen.NOTHING),
    )


def _distance(one: Surface) -> float:
    return one.distance_m if one.known else math.nan


def _seen_by(estimates: Estimates, config: PipelineConfig, target: str, t_s: float) -> list[Surface]:
    """What every beam that looks at ``target`` sees; an undeclared one that was never heard is not there."""
    declared = sum(2 if sensor.ring else 1 for sensor in config.vehicle.rangefinders)
    return [
        _beam_surface(beam, config, t_s)
        for k, (sensor, beam) in enumerate(zip(config.vehicle.watched, estimates.beams, strict=True))
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
            Seen.SURFACE,
            track.at(t_s),
            track.rate,
            track.sigma,
            beam.normal_ned,
            track.restarted_s,
            beam.slant_m,
            beam.jumped_from is not None,
        )
    if beam.read.why is not None and heard <= RANGE_AGE_S:
        return Surface(_DOUBTED[beam.read.why])
    return Surface(Seen.MISSING if beam.heard_s == -math.inf else Seen.STALE)


class FanQuery(NamedTuple):
    """The surrogate's arguments by fan, and the wall's bearing [rad]. Plain floats: two to six fans are few."""

    h_m: tuple[float, ...]
    d_m: tuple[float, ...]
    rpm: tuple[float, ...]
    wall_bearing_rad: float


def fan_query(
    vehicle: Vehicle, ground: Surface, wall: Surface, rotation: Rows, rpm: tuple[float, ...], lead_s: float
) -> FanQuery:
    """Per-fan distances ``lead_s`` ahead, by the tracks' own rates."""
    h = [math.inf] * len(vehicle.fans)
    if ground.seen is Seen.SURFACE:
        h = fan_heights_now(vehicle, ground.distance_m + ground.rate_m_s * lead_s, rotation)
    d, bearing = lips_to_wall(vehicle, wall, rotation, lead_s)
    return FanQuery(tuple(h), tuple(d), rpm, bearing)


def lips_to_wall(vehicle: Vehicle, wall: Surface, rotation: Rows, lead_s: float) -> tuple[list[float], float]:
    """Outer lip of every fan to a wall [m], ``lead_s`` ahead, and its bearing [rad]; inf, 0 without a wall."""
    if wall.seen is not Seen.SURFACE or wall.normal_ned is None:
        return [math.inf] * len(vehicle.fans), 0.0
    distance = wall.distance_m + wall.rate_m_s * lead_s
    return fan_wall_distances_now(vehicle, distance, wall.normal_ned, rotation)


def rotor_speeds(estimates: Estimates, config: PipelineConfig, t_s: float) -> tuple[float, ...] | None:
    """Rotor speeds [rpm], of every rotor, at ``t_s``, or None where any is missing or too old."""
    if not config.vehicle.telemetered:
        fresh = estimates.servo is not None and t_s - estimates.servo.t_s <= ROTOR_AGE_S
        return estimates.servo_rpm if fresh else None
    out = []
    for track in estimates.rotors:
        if track is None or track.age(t_s) > ROTOR_AGE_S:
            return None
        # A speed changes within tens of ms: between messages hold the value rather than extrapolate its slope.
        out.append(max(track.value, 0.0))
    return tuple(out)
