"""Where the hold is to be: what a pilot's SET_POSITION_TARGET_LOCAL_NED asks for, and the way there within limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from companion.mavlink.samples import SetPositionTarget
from models.vehicle import Limits, Vector3

_SHAPE_S = (0.25, 0.25, 0.12)
"""Time over which a change of the velocity target is fed forward as an acceleration, by axis NED."""
_TARGET_AGE_S = 0.5
"""The velocity that goes with a position target counts for this long after it was sent; the position stays."""
_VELOCITY_AGE_S = 1.2
"""A velocity target without a position lasts two and a half periods of its sender, at most this long: senders repeat it
at 1 Hz or faster."""
_FOLLOW_M = 0.15
"""A target that leaps less than this is followed as it is; a larger leap is approached within the limits."""
_FOLLOW_M_S = 0.2
"""A target whose velocity leaps by more than this is followed by its place, not by the new velocity: a tilt that is
0.24 s late answers the leap too late, the hold swings, and runs past a target that stops as abruptly."""
_CAUGHT_UP_M, _CAUGHT_UP_M_S = 0.02, 0.03
"""An approach is over this near to the target in place and velocity."""
_JERK_M_S3 = 3.0
"""Of an approach: 0.35 degrees of tilt from one setpoint to the next at 50 Hz, 0.9 with the lead."""
_CLOSING_1_S = 1.0
"""Of an approach: speed per metre left, near the end; 5 cm take a second."""
_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_YAW = (1, 2, 4), (8, 16, 32), 1024
"""Bits of POSITION_TARGET_TYPEMASK, by axis."""
_NOWHERE = (math.nan, math.nan, math.nan)
_AT_REST = (0.0, 0.0, 0.0)


class TargetFrame(Enum):
    """MAV_FRAMEs that a target may be given in. Offsets are from where the vehicle is when the message arrives."""

    LOCAL_NED = 1
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    """As on ArduPilot: an offset along the nose and to the right; MAVLink calls it outdated."""
    BODY_OFFSET_NED = 9

    @property
    def from_vehicle(self) -> bool:
        """Whether the position is an offset from the vehicle."""
        return self is not TargetFrame.LOCAL_NED

    @property
    def along_nose(self) -> bool:
        """Whether the axes are turned by the vehicle's heading, and yaw counts from it."""
        return self in (TargetFrame.BODY_NED, TargetFrame.BODY_OFFSET_NED)


@dataclass(frozen=True)
class Target:
    """What is asked for, NED: position [m], NaN in an axis that only a velocity moves; velocity [m/s]."""

    position: Vector3
    velocity: Vector3
    yaw: float
    """Heading [rad]."""
    set_s: float
    lasts_s: float = math.inf
    """How long a velocity without a position counts: two and a half periods of the sender."""


def stay(yaw: float, t_s: float) -> Target:
    """Stop as soon as the limits allow, and stay there."""
    return Target(_NOWHERE, _AT_REST, yaw, t_s)


def read_target(sample: SetPositionTarget, old: Target, position: Vector3, yaw: float) -> Target | None:
    """The target that a message asks for, or None where its frame is not one of the four.

    ``position`` [m] and ``yaw`` [rad] are the vehicle's own; ``old`` gives what the message leaves out. An axis with
    neither position nor velocity keeps its place.
    """
    try:
        frame = TargetFrame(sample.frame)
    except ValueError:
        return None
    mask = sample.type_mask
    asked, speed = sample.position, sample.velocity
    if frame.along_nose:
        asked, speed = _turned(asked, yaw), _turned(speed, yaw)
    if frame.from_vehicle:
        asked = (asked[0] + position[0], asked[1] + position[1], asked[2] + position[2])
    north, east, down = (_axis(mask, axis, asked[axis], speed[axis], old.position[axis]) for axis in range(3))
    heading = old.yaw
    if not mask & _IGNORE_YAW and math.isfinite(sample.yaw):
        heading = sample.yaw + (yaw if frame.along_nose else 0.0)
    lasts = min(max(2.5 * (sample.t_s - old.set_s), _TARGET_AGE_S), _VELOCITY_AGE_S)
    return Target((north[0], east[0], down[0]), (north[1], east[1], down[1]), heading, sample.t_s, lasts)


def _axis(mask: int, axis: int, asked: float, speed: float, old: float) -> tuple[float, float]:
    """Position and velocity that a message asks for along one axis."""
    has_speed = not mask & _IGNORE_VELOCITY[axis] and math.isfinite(speed)
    has_place = not mask & _IGNORE_POSITION[axis] and math.isfinite(asked)
    unmoved = math.nan if has_speed else old
    return asked if has_place else unmoved, speed if has_speed else 0.0


def _turned(vector: Vector3, yaw: float) -> Vector3:
    c, s = math.cos(yaw), math.sin(yaw)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]


class Reference(NamedTuple):
    """Where the hold is to be at this instant, NED: position [m], velocity [m/s], acceleration [m/s^2]."""

    position: Vector3
    velocity: Vector3
    acceleration: Vector3
    shaped_velocity: Vector3
    """The velocity behind the shaping of ``_SHAPE_S``."""
    following: bool = False
    """True on a target that moves as the vehicle can: it is followed as it is. Any other is approached."""


def start_reference(position: Vector3, velocity: Vector3, acceleration: Vector3) -> Reference:
    """Begin where the vehicle is, moving as it moves."""
    return Reference(position, velocity, acceleration, velocity)


def advance(reference: Reference, target: Target, limits: Limits, t_s: float, dt_s: float) -> Reference:
    """The reference ``dt_s`` later: on the target where the vehicle can follow it, else on the way there.

    A velocity counts for half a second after its message where it goes with a position, ``Target.lasts_s`` where it
    stands alone.
    """
    age = t_s - target.set_s
    age = 0.0 if age < 0.0 else age
    (x, y, z), (px, py, pz) = target.position, reference.position
    # NaN differs from itself: an axis that only a velocity moves.
    free_n, free_e, free_d = x != x, y != y, z != z
    north, east, down = _limited(target.velocity, limits.speed_m_s, limits.climb_m_s)
    alone, beside = age <= target.lasts_s, age <= _TARGET_AGE_S
    north, east = north if (alone if free_n else beside) else 0.0, east if (alone if free_e else beside) else 0.0
    down = down if (alone if free_d else beside) else 0.0
    speed = (north, east, down)
    # Between two messages a moving target moves on at its own velocity.
    on = age if beside else _TARGET_AGE_S
    place = (x + north * on, y + east * on, z + down * on)
    to_go = (0.0 if free_n else place[0] - px, 0.0 if free_e else place[1] - py, 0.0 if free_d else place[2] - pz)
    if (
        not (free_n or free_e or free_d)
        and _largest(to_go) <= _FOLLOW_M
        and (reference.following or (_largest(to_go) < _CAUGHT_UP_M and _slip(reference, speed) < _CAUGHT_UP_M_S))
    ):
        if _slip(reference, speed) > _FOLLOW_M_S:
            speed = _common(reference.velocity, speed)
        return _followed(reference, place, speed, dt_s)
    return _approached(reference, to_go, speed, limits, dt_s)


def _limited(vector: Vector3, level: float, vertical: float) -> Vector3:
    """Horizontal length at most ``level``, vertical part at most ``vertical``."""
    north, east, down = vector
    size = math.hypot(north, east)
    if size > level:
        share = level / size
        north, east = north * share, east * share
    return north, east, -vertical if down < -vertical else vertical if down > vertical else down


def _largest(vector: Vector3) -> float:
    return max(abs(vector[0]), abs(vector[1]), abs(vector[2]))


def _slip(reference: Reference, speed: Vector3) -> float:
    v = reference.velocity
    return _largest((speed[0] - v[0], speed[1] - v[1], speed[2] - v[2]))


def _common(a: Vector3, b: Vector3) -> Vector3:
    """What both velocities have, axis by axis: the smaller of two with the same sign, else 0."""
    north, east, down = (min(x, y, key=abs) if x * y > 0.0 else 0.0 for x, y in zip(a, b, strict=True))
    return north, east, down


def _followed(reference: Reference, place: Vector3, speed: Vector3, dt_s: float) -> Reference:
    # A target that changes its velocity asks for an acceleration: give it rather than wait for the error.
    shaped, (shape_n, shape_e, shape_d) = reference.shaped_velocity, _SHAPE_S
    north, east = (speed[0] - shaped[0]) / shape_n, (speed[1] - shaped[1]) / shape_e
    down = (speed[2] - shaped[2]) / shape_d
    passed = (
        shaped[0] + north * min(dt_s, shape_n),
        shaped[1] + east * min(dt_s, shape_e),
        shaped[2] + down * min(dt_s, shape_d),
    )
    return Reference(place, speed, (north, east, down), passed, following=True)


def _approached(reference: Reference, to_go: Vector3, speed: Vector3, limits: Limits, dt_s: float) -> Reference:
    """A step of a motion limited in speed, acceleration and jerk that ends on the target without overshoot.

    Near the end it is linear and critically damped: acceleration follows the velocity error at four times the rate at
    which velocity follows the distance.
    """
    most, jerk, closing = limits.acceleration_m_s2, _JERK_M_S3, _CLOSING_1_S
    brake = min(0.75 * most, 0.25 * jerk)  # gentle enough for the jerk that braking begins with
    north, east, down = speed
    distance = math.hypot(to_go[0], to_go[1])
    if distance > 1e-9:
        share = _eased(distance, closing, brake) / distance
        north, east = north + to_go[0] * share, east + to_go[1] * share
    down += math.copysign(_eased(abs(to_go[2]), closing, brake), to_go[2])
    wanted = _limited((north, east, down), limits.speed_m_s, limits.climb_m_s)
    rate, (vx, vy, vz), (ax, ay, az) = 4.0 * closing, reference.velocity, reference.acceleration
    demand = _limited(
        (
            _towards(wanted[0] - vx, rate, jerk),
            _towards(wanted[1] - vy, rate, jerk),
            _towards(wanted[2] - vz, rate, jerk),
        ),
        most,
        most,
    )
    step, (x, y, z) = jerk * dt_s, demand
    ax += -step if x - ax < -step else step if x - ax > step else x - ax
    ay += -step if y - ay < -step else step if y - ay > step else y - ay
    az += -step if z - az < -step else step if z - az > step else z - az
    vx, vy, vz = vx + ax * dt_s, vy + ay * dt_s, vz + az * dt_s
    px, py, pz = reference.position
    velocity = (vx, vy, vz)
    return Reference((px + vx * dt_s, py + vy * dt_s, pz + vz * dt_s), velocity, (ax, ay, az), velocity)


def _towards(error: float, slope: float, limit: float) -> float:
    """``_eased`` with the error's sign."""
    return math.copysign(_eased(abs(error), slope, limit), error)


def _eased(error: float, slope: float, limit: float) -> float:
    """``slope`` times a small error; for a large one the rate from which ``limit`` still brings it to rest."""
    if error <= limit / slope**2:
        return slope * error
    return math.sqrt(2.0 * limit * (error - 0.5 * limit / slope**2))
