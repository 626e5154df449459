"""What is known of the vehicle and its surroundings: the newest samples, a track per range beam and per rotor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from companion.estimation.kalman import Track
from companion.estimation.position_trust import PositionReset, PositionTrust
from companion.estimation.range_doubt import UNREAD, Doubt, OldPlace
from companion.estimation.velocity_bias import VelocityBias
from companion.estimation.wall_line import WallLine
from companion.mavlink.samples import Attitude, Battery, LocalPosition, Pressure, ServoOutput
from models.common.frames import Rows
from models.vehicle import Vector3, Vehicle

ATTITUDE_AGE_S = 0.2
POSITION_AGE_S = 0.5
"""Older ones are none."""


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
    met_ned: Vector3 | None = None
    """Where on a wall it ended, from the CG; None: nowhere."""
    read: Doubt = UNREAD
    """What the next reading is compared with, and why the newest is not used."""
    jumped_from: OldPlace | None = None
    """While a jump of the range is not explained."""
    line: WallLine | None = None
    """Of a wall: how it runs."""


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
    velocity_bias: VelocityBias = field(default_factory=VelocityBias)
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
