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
_FOLLOW_M, _FOLLOW_M_S = 0.15, 0.2
"""A moving target that leaps by less than this in place and velocity is followed as it is. Any other may stop as
abruptly as it began: it is trailed by the way that stopping takes."""
_STILL_M = 0.0005
"""The same for the place of a target without velocity."""
_CAUGHT_UP_M, _CAUGHT_UP_M_S = 0.02, 0.03
"""An approach is over this near to the target in place and velocity."""
_JERK_M_S3 = 3.0
"""Of an approach: 0.35 degrees of tilt from one setpoint to the next at 50 Hz, 0.9 with the lead."""
_CLOSING_1_S = 2.0
"""Of an approach: speed per metre left, near the end. With the deceleration of a quarter of the jerk braking begins
with half the jerk: the rest keeps the way from ending too far."""
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


Level = tuple[float, float]
"""North and east."""


class Motion(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s^2], NED."""

    position: Vector3
    velocity: Vector3
    acceleration: Vector3


class Reference(NamedTuple):
    """What the vehicle is asked to do, NED: position [m], velocity [m/s], acceleration [m/s^2] that is fed forward."""

    position: Vector3
    velocity: Vector3
    acceleration: Vector3
    shaped_velocity: Vector3
    """The velocity behind the shaping of ``_SHAPE_S``."""
    answered: tuple[Level, Level, Level] = ((0.0, 0.0),) * 3
    """The acceleration behind each of the lags that the attitude loop is taken for."""
    following: bool = False
    """True on a target that moves as the vehicle can: it is followed as it is. Any other is approached."""


def start_reference(position: Vector3, velocity: Vector3, acceleration: Vector3, lag_s: float = 0.0) -> Reference:
    """Begin where the vehicle is, moving as it moves: what is asked for now is answered ``lag_s`` later."""
    north, east, _ = acceleration
    still = Reference(position, velocity, acceleration, velocity, ((north, east),) * 3)
    (x, y, z), (u, v, w) = position, velocity
    (ex, ey, _), (eu, ev, _), _ = expected(still, lag_s)
    vx, vy = u + u - eu, v + v - ev
    still = still._replace(velocity=(vx, vy, w))
    (ex, ey, _), _, _ = expected(still, lag_s)
    return still._replace(position=(x + x - ex, y + y - ey, z))


def expected(reference: Reference, lag_s: float) -> Motion:
    """Where a vehicle is whose tilt answers the fed acceleration through three lags of ``lag_s`` / 3 each.

    A lag y' = (u - y) / tau gives y = u - tau y': velocity and place follow from the answered accelerations.
    """
    if reference.following:
        return Motion(reference.position, reference.velocity, reference.acceleration)
    (x, y, z), (u, v, w) = reference.position, reference.velocity
    tau = lag_s / 3.0
    for north, east in reference.answered:
        u, v = u - tau * north, v - tau * east
        x, y = x - tau * u, y - tau * v
    north, east = reference.answered[2]
    return Motion((x, y, z), (u, v, w), (north, east, reference.acceleration[2]))


def advance(
    reference: Reference, target: Target, limits: Limits, t_s: float, dt_s: float, lag_s: float = 0.0
) -> Reference:
    """The reference ``dt_s`` later: on the target where the vehicle can follow it, else on the way there.

    A velocity counts for half a second after its message where it goes with a position, ``Target.lasts_s`` where it
    stands alone.
    """
    age = t_s - target.set_s
    age = 0.0 if age < 0.0 else age
    x, y, z = target.position
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
    to_go = _way(reference.position, place)
    if not (free_n or free_e or free_d) and _follows(reference, to_go, speed, lag_s):
        return _followed(reference, place, speed, dt_s)
    if reference.following:
        reference = start_reference(*expected(reference, lag_s), lag_s)
        to_go = _way(reference.position, place)
    speed = (north if free_n else 0.0, east if free_e else 0.0, down if free_d else 0.0)
    return _approached(reference, to_go, speed, limits, dt_s, lag_s)


def _way(start: Vector3, end: Vector3) -> Vector3:
    """From ``start`` to ``end``; 0 in an axis without a place."""
    north, east, down = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    return 0.0 if north != north else north, 0.0 if east != east else east, 0.0 if down != down else down


def _follows(reference: Reference, to_go: Vector3, speed: Vector3, lag_s: float) -> bool:
    """Whether the target moves as the vehicle can."""
    slip, moving = _largest(_way(reference.velocity, speed)), _largest(speed) > 0.0
    if not reference.following:
        behind = _largest(_way(expected(reference, lag_s).position, reference.position))
        near_m = _CAUGHT_UP_M if moving else _STILL_M
        return _largest(to_go) < near_m and slip < _CAUGHT_UP_M_S and behind < _CAUGHT_UP_M
    return slip <= _FOLLOW_M_S and _largest(to_go) <= (_FOLLOW_M if moving else _STILL_M)


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
    return Reference(place, speed, (north, east, down), passed, ((north, east),) * 3, following=True)


def _approached(
    reference: Reference, to_go: Vector3, speed: Vector3, limits: Limits, dt_s: float, lag_s: float
) -> Reference:
    """A step of a motion limited in speed, acceleration and jerk that ends on the target without overshoot.

    Near the end it is linear and critically damped: acceleration follows the velocity error at four times the rate at
    which velocity follows the distance.
    """
    most, jerk, closing = limits.acceleration_m_s2, _JERK_M_S3, _CLOSING_1_S
    brake = min(0.75 * most, 0.25 * jerk)  # gentle enough for the jerk that braking begins with
    north, east, down = speed
    distance = math.hypot(to_go[0], to_go[1])
    if distance > 1e-9:
        share = _stoppable(distance, closing, brake) / distance
        north, east = north + to_go[0] * share, east + to_go[1] * share
    down += math.copysign(_stoppable(abs(to_go[2]), closing, brake), to_go[2])
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
    velocity, share = (vx, vy, vz), dt_s / (lag_s / 3.0 + dt_s) if dt_s > 0.0 else 0.0
    now, answered = (ax, ay), []
    for late in reference.answered:
        now = (late[0] + (now[0] - late[0]) * share, late[1] + (now[1] - late[1]) * share)
        answered.append(now)
    return Reference(
        (px + vx * dt_s, py + vy * dt_s, pz + vz * dt_s),
        velocity,
        (ax, ay, az),
        velocity,
        (answered[0], answered[1], answered[2]),
    )


def _stoppable(distance: float, closing: float, brake: float) -> float:
    """The speed v [m/s] that takes ``distance`` [m] to stop: distance = v / closing + v^2 / (2 brake).

    Braking begins and ends softly, at most at ``brake`` [m/s^2]: a jerk of ``closing`` times that.
    """
    return brake * (math.sqrt(1.0 / closing**2 + 2.0 * distance / brake) - 1.0 / closing)


def _towards(error: float, slope: float, limit: float) -> float:
    """``_eased`` with the error's sign."""
    return math.copysign(_eased(abs(error), slope, limit), error)


def _eased(error: float, slope: float, limit: float) -> float:
    """``slope`` times a small error; for a large one the rate from which ``limit`` still brings it to rest."""
    if error <= limit / slope**2:
        return slope * error
    return math.sqrt(2.0 * limit * (error - 0.5 * limit / slope**2))
