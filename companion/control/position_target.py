"""Where the hold is to be: what a pilot's SET_POSITION_TARGET_LOCAL_NED asks for, and the way there within limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from companion.estimation.vectors import Level, minus, plus, scaled, within
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
_FOLLOW_M_S = 0.2
"""A moving target that leaps by less than this in place and velocity is followed as it is. Any other may stop as
abruptly as it began: it is trailed by the way that stopping takes."""
_STILL_M = 0.0005
"""The same for the place of a target without velocity."""
_CAUGHT_UP_M = 0.02
_CAUGHT_UP_M_S = 0.03
"""An approach is over this near to the target in place and velocity."""
_IGNORE_POSITION = (1, 2, 4)
_IGNORE_VELOCITY = (8, 16, 32)
_IGNORE_EITHER = sum(_IGNORE_POSITION) + sum(_IGNORE_VELOCITY)
_IGNORE_YAW = 1024
"""Bits of POSITION_TARGET_TYPEMASK, by axis."""
_NOWHERE = (math.nan, math.nan, math.nan)
_AT_REST = (0.0, 0.0, 0.0)


_FRAMES = (1, 7, 8, 9)
"""MAV_FRAMEs that a target may be given in: LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED. All but the first
count from where the vehicle is when the message arrives."""
_ALONG_NOSE = (8, 9)
"""Those whose axes are turned by the vehicle's heading, and whose yaw counts from it. BODY_NED as on ArduPilot: MAVLink
calls it outdated."""


class Approach(NamedTuple):
    """How hard the reference goes to a target, and how hard it stops there."""

    closing_1_s: float
    """Speed per metre left, near the end."""
    jerk_m_s3: float
    """Braking begins with half of it. The rest keeps the way from ending too far."""

    def brake(self, most: float) -> float:
        """The deceleration [m/s^2] that braking counts on, of ``most`` that the vehicle has."""
        return min(0.75 * most, 0.5 * self.jerk_m_s3 / self.closing_1_s)


_GENTLE = Approach(closing_1_s=2.0, jerk_m_s3=3.0)
"""0.35 degrees of tilt from one setpoint to the next at 50 Hz, 0.9 with the lead."""
_BRISK = Approach(closing_1_s=4.0, jerk_m_s3=8.0)
"""To a place that comes with its velocity: a target that moves, not a new place at every message. At 0.3 m/s it is
trailed by 0.12 m in place of 0.21. Places alone, ten times a second, would shake the vehicle at this pace."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """What is asked for, NED: position [m], NaN in an axis that only a velocity moves; velocity [m/s]."""

    position: Vector3
    velocity: Vector3
    yaw: float
    """Heading [rad]."""
    set_s: float
    lasts_s: float = math.inf
    """How long a velocity without a position counts: two and a half periods of the sender."""
    has_both: bool = False
    """Whether its sender gives place and velocity, be it zero, in each axis."""


def stay(yaw: float, t_s: float) -> Target:
    """Stop as soon as the limits allow, and stay there."""
    return Target(position=_NOWHERE, velocity=_AT_REST, yaw=yaw, set_s=t_s)


def read_target(
    sample: SetPositionTarget, old: Target, position: Vector3, yaw: float
) -> Target | None:
    """The target that a message asks for, or None where its frame is not one of the four.

    ``position`` [m] and ``yaw`` [rad] are the vehicle's own; ``old`` gives what the message leaves out. An axis with
    neither position nor velocity keeps its place.
    """
    if sample.frame not in _FRAMES:
        return None
    place = sample.position
    speed = sample.velocity
    along_nose = sample.frame in _ALONG_NOSE
    if along_nose:
        place = _by_heading(place, yaw)
        speed = _by_heading(speed, yaw)
    if sample.frame != _FRAMES[0]:
        place = plus(place, position)
    north, east, down = (
        _axis(sample.type_mask, k, place[k], speed[k], old.position[k]) for k in range(3)
    )
    heading = old.yaw
    if not sample.type_mask & _IGNORE_YAW and math.isfinite(sample.yaw):
        heading = sample.yaw + (yaw if along_nose else 0.0)
    lasts = min(max(2.5 * (sample.t_s - old.set_s), _TARGET_AGE_S), _VELOCITY_AGE_S)
    return Target(
        position=(north[0], east[0], down[0]),
        velocity=(north[1], east[1], down[1]),
        yaw=heading,
        set_s=sample.t_s,
        lasts_s=lasts,
        has_both=_has_both(sample),
    )


def _has_both(sample: SetPositionTarget) -> bool:
    """Whether the message gives place and velocity in each axis."""
    finite = all(map(math.isfinite, (*sample.position, *sample.velocity)))
    return finite and not sample.type_mask & _IGNORE_EITHER


def _axis(mask: int, axis: int, place: float, speed: float, old: float) -> tuple[float, float]:
    """Position and velocity that a message asks for along one axis."""
    has_speed = not mask & _IGNORE_VELOCITY[axis] and math.isfinite(speed)
    has_place = not mask & _IGNORE_POSITION[axis] and math.isfinite(place)
    if has_speed:
        unmoved = math.nan
    else:
        unmoved = old
    return place if has_place else unmoved, speed if has_speed else 0.0


def _by_heading(vector: Vector3, yaw: float) -> Vector3:
    c = math.cos(yaw)
    s = math.sin(yaw)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]


class Course(NamedTuple):
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


def start_reference(
    position: Vector3, velocity: Vector3, acceleration: Vector3, lag_s: float = 0.0
) -> Reference:
    """Begin where the vehicle is, moving as it moves: what is asked for now is answered ``lag_s`` later."""
    north, east, _ = acceleration
    still = Reference(position, velocity, acceleration, velocity, ((north, east),) * 3)
    still = still._replace(velocity=minus(scaled(velocity, 2.0), expected(still, lag_s).velocity))
    return still._replace(position=minus(scaled(position, 2.0), expected(still, lag_s).position))


def expected(reference: Reference, lag_s: float) -> Course:
    """Where a vehicle is whose tilt answers the fed acceleration through three lags of ``lag_s`` / 3 each.

    A lag y' = (u - y) / tau gives y = u - tau y': velocity and place follow from the answered accelerations.
    """
    if reference.following:
        return Course(reference.position, reference.velocity, reference.acceleration)
    (x, y, z), (u, v, w) = reference.position, reference.velocity
    tau = lag_s / 3.0
    for north, east in reference.answered:
        u = u - tau * north
        v = v - tau * east
        x = x - tau * u
        y = y - tau * v
    north, east = reference.answered[2]
    return Course((x, y, z), (u, v, w), (north, east, reference.acceleration[2]))


def advance(
    reference: Reference,
    target: Target,
    limits: Limits,
    t_s: float,
    dt_s: float,
    lag_s: float = 0.0,
) -> Reference:
    """The reference ``dt_s`` later: on the target where the vehicle can follow it, else on the way there.

    A velocity counts for half a second after its message where it goes with a position, ``Target.lasts_s`` where it
    stands alone.
    """
    age_s = max(t_s - target.set_s, 0.0)
    north, east, down = within(target.velocity, limits.speed_m_s, limits.climb_m_s)
    x, y, z = target.position
    free = math.isnan(x) or math.isnan(y) or math.isnan(z)
    x, north = _target_now(x, north, age_s, target.lasts_s)
    y, east = _target_now(y, east, age_s, target.lasts_s)
    z, down = _target_now(z, down, age_s, target.lasts_s)
    place = (x, y, z)
    speed = (north, east, down)
    to_go = _way(reference.position, place)
    if not free and _follows(reference, to_go, speed, lag_s):
        return _followed(reference, place, speed, dt_s)
    if reference.following:
        reference = start_reference(*expected(reference, lag_s), lag_s)
        to_go = _way(reference.position, place)
    speed = (
        north if math.isnan(x) else 0.0,
        east if math.isnan(y) else 0.0,
        down if math.isnan(z) else 0.0,
    )
    if target.has_both:
        approach = _BRISK
    else:
        approach = _GENTLE
    return _approached(reference, to_go, speed, limits, dt_s, lag_s, approach=approach)


def _target_now(place: float, speed: float, age_s: float, lasts_s: float) -> tuple[float, float]:
    """Place and velocity along one axis ``age_s`` after the message: a moving target moves on at its own velocity."""
    if math.isnan(place):
        return place, speed if age_s <= lasts_s else 0.0
    if age_s > _TARGET_AGE_S:
        return place, 0.0
    return place + speed * age_s, speed


def _way(start: Vector3, end: Vector3) -> Vector3:
    """From ``start`` to ``end``; 0 in an axis without a place."""
    north = end[0] - start[0]
    east = end[1] - start[1]
    down = end[2] - start[2]
    return (
        0.0 if math.isnan(north) else north,
        0.0 if math.isnan(east) else east,
        0.0 if math.isnan(down) else down,
    )


def _follows(reference: Reference, to_go: Vector3, speed: Vector3, lag_s: float) -> bool:
    """Whether the target moves as the vehicle can."""
    slip = _apart(speed, reference.velocity)
    left = _apart(to_go, _AT_REST)
    moving = speed != _AT_REST
    if reference.following:
        return slip <= _FOLLOW_M_S and left <= (_FOLLOW_M if moving else _STILL_M)
    if slip >= _CAUGHT_UP_M_S or left >= (_CAUGHT_UP_M if moving else _STILL_M):
        return False
    return _apart(reference.position, expected(reference, lag_s).position) < _CAUGHT_UP_M


def _apart(a: Vector3, b: Vector3) -> float:
    """How far two vectors differ, in the axis where they differ most."""
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]), abs(a[2] - b[2]))


def _followed(reference: Reference, place: Vector3, speed: Vector3, dt_s: float) -> Reference:
    # A target that changes its velocity asks for an acceleration: give it rather than wait for the error.
    shape_n, shape_e, shape_d = _SHAPE_S
    shaped_n, shaped_e, shaped_d = reference.shaped_velocity
    north = (speed[0] - shaped_n) / shape_n
    east = (speed[1] - shaped_e) / shape_e
    down = (speed[2] - shaped_d) / shape_d
    shaped_n += north * min(dt_s, shape_n)
    shaped_e += east * min(dt_s, shape_e)
    shaped_d += down * min(dt_s, shape_d)
    return Reference(
        position=place,
        velocity=speed,
        acceleration=(north, east, down),
        shaped_velocity=(shaped_n, shaped_e, shaped_d),
        answered=((north, east),) * 3,
        following=True,
    )


def _approached(
    reference: Reference,
    to_go: Vector3,
    speed: Vector3,
    limits: Limits,
    dt_s: float,
    lag_s: float,
    *,
    approach: Approach,
) -> Reference:
    """A step of a motion limited in speed, acceleration and jerk that ends on the target without overshoot.

    Near the end it is linear and critically damped: acceleration follows the velocity error at four times the rate at
    which velocity follows the distance.
    """
    most = limits.acceleration_m_s2
    closing, jerk = approach
    brake = approach.brake(most)
    north, east, down = speed
    distance = math.hypot(to_go[0], to_go[1])
    if distance > 1e-9:
        share = _stoppable(distance, closing, brake) / distance
        north = north + to_go[0] * share
        east = east + to_go[1] * share
    down += math.copysign(_stoppable(abs(to_go[2]), closing, brake), to_go[2])
    wanted = within((north, east, down), limits.speed_m_s, limits.climb_m_s)
    vn, ve, vd = reference.velocity
    rate = 4.0 * closing
    demand = (
        _towards(wanted[0] - vn, rate, jerk),
        _towards(wanted[1] - ve, rate, jerk),
        _towards(wanted[2] - vd, rate, jerk),
    )
    demand = within(demand, most, most)
    step = jerk * dt_s
    north, east, down = reference.acceleration
    north = _ramped(north, demand[0], step)
    east = _ramped(east, demand[1], step)
    down = _ramped(down, demand[2], step)
    velocity = (vn + north * dt_s, ve + east * dt_s, vd + down * dt_s)
    vn, ve, vd = velocity
    x, y, z = reference.position
    return Reference(
        position=(x + vn * dt_s, y + ve * dt_s, z + vd * dt_s),
        velocity=velocity,
        acceleration=(north, east, down),
        shaped_velocity=velocity,
        answered=_answered(reference.answered, (north, east), dt_s, lag_s),
    )


def _ramped(old: float, demand: float, step: float) -> float:
    """The old value, at most a ``step`` nearer to the one demanded."""
    change = demand - old
    if change > step:
        return old + step
    if change < -step:
        return old - step
    return old + change


def _answered(
    lags: tuple[Level, Level, Level], acceleration: Level, dt_s: float, lag_s: float
) -> tuple[Level, Level, Level]:
    """The acceleration behind each of three first-order lags of ``lag_s`` / 3, ``dt_s`` later."""
    if dt_s > 0.0:
        share = dt_s / (lag_s / 3.0 + dt_s)
    else:
        share = 0.0
    north, east = acceleration
    behind = []
    for late_n, late_e in lags:
        north = late_n + share * (north - late_n)
        east = late_e + share * (east - late_e)
        behind.append((north, east))
    first, second, third = behind
    return first, second, third


def way_to_stop(velocity: Vector3) -> Vector3:
    """The way [m] on which a velocity without a place stops: v / closing + v^2 / (2 brake)."""
    size = math.hypot(*velocity)
    brake = _GENTLE.brake(math.inf)
    return scaled(velocity, 1.0 / _GENTLE.closing_1_s + size / (2.0 * brake))


def _stoppable(distance: float, closing: float, brake: float) -> float:
    """The speed v [m/s] that takes ``distance`` [m] to stop: distance = v / closing + v^2 / (2 brake).

    Braking begins and ends softly, at most at ``brake`` [m/s^2]: a jerk of ``closing`` times that.
    """
    return brake * (math.sqrt(1.0 / closing**2 + 2.0 * distance / brake) - 1.0 / closing)


def _towards(error: float, slope: float, limit: float) -> float:
    """``slope`` times a small error; for a large one the rate from which ``limit`` still brings it to rest."""
    size = abs(error)
    rate = slope * size
    if size > limit / slope**2:
        rate = math.sqrt(2.0 * limit * (size - 0.5 * limit / slope**2))
    return math.copysign(rate, error)
