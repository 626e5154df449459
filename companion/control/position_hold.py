"""Cascaded position hold flown through attitude and thrust: the base that offsets are added to.

SET_ATTITUDE_TARGET replaces the autopilot's position controller, so the hold is ours. Position P, velocity PI, position
and velocity predicted to the instant at which the attitude can answer, thrust by the affine map. A careless outer loop
is worse than none (docs/lab/hold.md).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.control.dead_reckoning import KEPT_S, Gained, Reckoning, accelerated, gained_since
from companion.control.plant import CLIMB_LEAD_S, TILT_MEAN_S, HoldGains
from companion.control.position_target import (
    Course,
    Reference,
    Target,
    advance,
    expected,
    start_reference,
    stay,
)
from companion.control.wall_guard import WallAhead
from companion.estimation.vectors import Level, bounded, clipped, lagged, minus, plus, within
from companion.mavlink.firmware import ThrustMap
from models.common.frames import GRAVITY
from models.common.frozen_copy import with_changes
from models.vehicle import Limits, Vector3

_MOST_LEVEL_M_S2 = GRAVITY * math.tan(math.radians(15.0))
"""Of the hold, before offsets: 15 degrees of tilt."""
_PRESSED_M_S2 = GRAVITY * math.tan(math.radians(24.0))
"""The same away from a wall that it cannot stop before. Not everywhere: large tilts are answered later, and the hold
that leans so far to all sides swings."""
_MOST_CLIMB_M_S2 = 3.0
_MOST_INTEGRAL_M_S2 = 2.5
"""A steady 25 % of the weight: a wind of 10 m/s on a vehicle of 3 kg."""
_MOST_DRAG_1_S = 1.5
"""A tandem of ducts has 0.9, an open quadrotor of 3 kg 0.2."""
_SLOW_M_S = 0.15
"""At this speed what the integral learns is taken for drag by half; at rest for wind, fast for drag."""
_STEADY_M_S2 = 0.1
"""Faster changes of the reference's velocity are answered late: what is missing then is not drag."""
_BALANCE_S = 0.25
"""Time over which the integral goes to what the tilt is seen to balance, while a limit is met."""
_GAP_S = 0.5
"""After a longer silence the vehicle may be anywhere: the way to the target begins where it is."""
_AT_REST = (0.0, 0.0, 0.0)


class Motion(NamedTuple):
    """What is measured, NED: position [m] and velocity [m/s] as they were ``age_s`` ago, and the attitude now."""

    position: Vector3
    velocity: Vector3
    body_down: Vector3
    """The body's down axis."""
    yaw: float
    age_s: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    """North and east acceleration [m/s^2] of the offset that is applied: a part of the tilt that balances something."""
    wall: WallAhead | None = None
    """A wall that it is driven to."""
    clear: bool = False
    """No wall is near: what the tilt balances on the move is drag, not a pull that changes with the place."""
    balance: tuple[float, float] | None = None
    """North and east acceleration [m/s^2] by which the tilt, on average, balances wind and walls; None: not known."""


class Hold(NamedTuple):
    """State of an engaged hold. Accelerations are NED, m/s^2."""

    target: Target
    reference: Reference
    integral: Vector3
    """What balances wind, trim and a wrong hover thrust."""
    t_s: float
    tilt_mean: tuple[float, float]
    """What the tilt gives on average, north and east, beyond offsets and the reference's own acceleration."""
    climb_mean: float
    """Average of the vertical acceleration that was asked for beyond the reference's own."""
    climb_command: float
    """Vertical acceleration last asked for, integral included: what carries a late velocity on."""
    reckoning: Reckoning = ()
    """What accelerations that the position does not show yet add up to."""
    drag_1_s: float = 0.0
    """Deceleration per speed through still air, learned on the move: it is fed forward and ends where the motion ends.
    In the integral it would carry the vehicle past the place where it stops."""


class BaseSetpoint(NamedTuple):
    """Roll, pitch, yaw [rad] and thrust 0...1 that the base asks for, before any offset."""

    roll: float
    pitch: float
    yaw: float
    thrust: float
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What it stands for, NED m/s^2, beyond balancing gravity."""


def engage(
    t_s: float,
    motion: Motion,
    balance: tuple[float, float],
    thrust_now: float,
    thrust: ThrustMap,
    lag_s: float = 0.0,
    drag_1_s: float = 0.0,
) -> Hold:
    """Hold here, bumplessly: the first setpoint is the tilt and the thrust that fly now.

    ``balance`` is the part of the tilt's acceleration, north and east, that balances wind and drag rather than moving
    the vehicle; the integrals start with it, and the rest of the tilt starts the reference, which brakes from there.
    ``thrust_now`` is the thrust 0...1 that flies.
    """
    tilt_n, tilt_e = tilt_acceleration(motion.body_down)
    up = (thrust_now - thrust.hover) * thrust.slope * GRAVITY
    drag_n = drag_1_s * motion.velocity[0]
    drag_e = drag_1_s * motion.velocity[1]
    integral = bounded((balance[0] - drag_n, balance[1] - drag_e, -up), _MOST_INTEGRAL_M_S2)
    mean_n = integral[0] + drag_n
    mean_e = integral[1] + drag_e
    rest_n = clipped(tilt_n - mean_n, _MOST_LEVEL_M_S2)
    rest_e = clipped(tilt_e - mean_e, _MOST_LEVEL_M_S2)
    reference = start_reference(motion.position, motion.velocity, (rest_n, rest_e, 0.0), lag_s)
    mean = (tilt_n - rest_n - drag_n, tilt_e - rest_e - drag_e)
    climb = integral[2]
    return Hold(
        target=stay(motion.yaw, t_s),
        reference=reference,
        integral=integral,
        t_s=t_s,
        tilt_mean=mean,
        climb_mean=climb,
        climb_command=climb,
        drag_1_s=drag_1_s,
    )


def settled_target(hold: Hold) -> Target:
    """The place that the hold goes to, at rest there."""
    old = hold.target
    at = hold.reference.position
    north, east, down = (
        kept if math.isnan(wanted) else wanted
        for wanted, kept in zip(old.position, at, strict=True)
    )
    return with_changes(old, position=(north, east, down), velocity=_AT_REST)


def balanced(hold: Hold, acceleration: Vector3) -> Hold:
    """The hold after it took over what another part of the setpoint balanced: NED m/s^2, into its integral."""
    integral = bounded(plus(hold.integral, acceleration), _MOST_INTEGRAL_M_S2)
    north, east, down = minus(integral, hold.integral)
    return hold._replace(
        integral=integral,
        tilt_mean=(hold.tilt_mean[0] + north, hold.tilt_mean[1] + east),
        climb_mean=hold.climb_mean + down,
        climb_command=hold.climb_command + down,
    )


def shifted(hold: Hold, by_ned: Vector3) -> Hold:
    """The hold after the origin of positions moved: everything stays where it is over the ground."""
    reference = hold.reference._replace(position=plus(hold.reference.position, by_ned))
    return hold._replace(
        reference=reference,
        target=with_changes(hold.target, position=plus(hold.target.position, by_ned)),
    )


def fly(
    hold: Hold, gains: HoldGains, limits: Limits, t_s: float, motion: Motion, thrust: ThrustMap
) -> tuple[Hold, BaseSetpoint]:
    """One step of the cascade; returns the hold one step on and the setpoint. Plain floats: it runs for every one."""
    dt = min(max(t_s - hold.t_s, 0.0), 0.1)
    lag_s = gains.lag_s
    if t_s - hold.t_s > _GAP_S:
        reference = start_reference(motion.position, motion.velocity, _AT_REST, lag_s)
        hold = hold._replace(target=settled_target(hold), reference=reference, reckoning=())
        dt = 0.0
    reference = advance(hold.reference, hold.target, limits, t_s, dt, lag_s)
    course = expected(reference, lag_s)
    tilt_mean, climb_mean, extra = _residual_acceleration(
        hold, motion, course, reference.acceleration[2], dt
    )
    fed = course.acceleration
    moving = (extra[0] + fed[0], extra[1] + fed[1], extra[2] + fed[2])
    reckoning = accelerated(hold.reckoning, t_s, dt, moving)
    gained = gained_since(reckoning, t_s - motion.age_s)
    slip = _slip(course, motion, gained, extra, gains, limits)
    demand = _demand(slip, hold, reference, gains)
    acceleration, saturated = _limited(demand, motion.wall)
    drag = hold.drag_1_s
    integral = hold.integral
    if not saturated:
        along = _along_the_way(motion, reference, course.velocity, slip)
        drag, integral = _taught(hold, course.velocity, slip, along, gains, dt)
    elif motion.balance is not None:
        # At a limit the error would wind the integral up; what the tilt is seen to balance does not.
        share = min(dt / _BALANCE_S, 1.0)
        integral = _balanced(integral, motion.balance, motion.offset, share)
    north, east, down = acceleration
    roll, pitch = _acceleration_to_tilt(north, east, motion.yaw)
    command = thrust.hover + thrust.change(-down / GRAVITY)
    setpoint = BaseSetpoint(roll, pitch, hold.target.yaw, command, acceleration)
    return Hold(
        target=hold.target,
        reference=reference,
        integral=integral,
        t_s=t_s,
        tilt_mean=tilt_mean,
        climb_mean=climb_mean,
        climb_command=down,
        reckoning=reckoning,
        drag_1_s=drag,
    ), setpoint


def _residual_acceleration(
    hold: Hold, motion: Motion, course: Course, forward_d: float, dt: float
) -> tuple[Level, float, Vector3]:
    """Tilt and climb that are not fed forward: on average, and what goes beyond the average and changes the velocity.

    ``forward_d`` is the vertical acceleration that is fed forward [m/s^2, NED].
    """
    drag = hold.drag_1_s
    tilt_n, tilt_e = tilt_acceleration(motion.body_down)
    tilt_n = tilt_n - motion.offset[0] - course.acceleration[0] - drag * course.velocity[0]
    tilt_e = tilt_e - motion.offset[1] - course.acceleration[1] - drag * course.velocity[1]
    climb = hold.climb_command - forward_d
    share = min(dt / TILT_MEAN_S, 1.0)
    mean_n, mean_e = lagged(hold.tilt_mean, (tilt_n, tilt_e), share)
    mean_d = hold.climb_mean + (climb - hold.climb_mean) * share
    return (mean_n, mean_e), mean_d, (tilt_n - mean_n, tilt_e - mean_e, climb - mean_d)


def _demand(slip: Vector3, hold: Hold, reference: Reference, gains: HoldGains) -> Vector3:
    """The acceleration [m/s^2] that answers the slip, with the integral and what is fed forward."""
    drag = hold.drag_1_s
    integral_n, integral_e, integral_d = hold.integral
    forward_n, forward_e, forward_d = reference.acceleration
    ahead_n, ahead_e, _ = reference.shaped_velocity
    damping = gains.velocity_1_s
    return (
        slip[0] * damping + integral_n + (forward_n + drag * ahead_n),
        slip[1] * damping + integral_e + (forward_e + drag * ahead_e),
        slip[2] * gains.climb_1_s + integral_d + forward_d,
    )


def _taught(
    hold: Hold, velocity: Vector3, slip: Vector3, along: float, gains: HoldGains, dt: float
) -> tuple[float, Vector3]:
    """Drag [1/s] and integral [m/s^2] with the slip taken in.

    ``along``: what drag lacks [1/s]. The rest of the slip is integrated.
    """
    north, east, down = hold.integral
    vn, ve, _ = velocity
    rate = gains.integral_1_s2 * dt
    drag = min(max(hold.drag_1_s + along * rate, 0.0), _MOST_DRAG_1_S)
    integral = (
        north + (slip[0] - along * vn) * rate,
        east + (slip[1] - along * ve) * rate,
        down + slip[2] * gains.climb_integral_1_s2 * dt,
    )
    return drag, bounded(integral, _MOST_INTEGRAL_M_S2)


def _along_the_way(motion: Motion, reference: Reference, velocity: Vector3, slip: Vector3) -> float:
    """What drag lacks [1/s]: the slip along the way over the speed; 0 where the speed changes or a surface is near."""
    if not motion.clear or math.hypot(*reference.acceleration[:2]) >= _STEADY_M_S2:
        return 0.0
    vn, ve, _ = velocity
    return (slip[0] * vn + slip[1] * ve) / (vn * vn + ve * ve + _SLOW_M_S**2)


def _balanced(
    old: Vector3, balance: tuple[float, float], offset: tuple[float, float], share: float
) -> Vector3:
    """The integral, a share of the way to what the tilt balances without the offset."""
    north = old[0] + (balance[0] - offset[0] - old[0]) * share
    east = old[1] + (balance[1] - offset[1] - old[1]) * share
    return bounded((north, east, old[2]), _MOST_INTEGRAL_M_S2)


def _slip(
    course: Course, motion: Motion, gained: Gained, extra: Vector3, gains: HoldGains, limits: Limits
) -> Vector3:
    """The velocity that is missing [m/s], NED: towards the reference, and on with it."""
    # Position and velocity now, from the late ones and what has accelerated the vehicle since.
    age_s = min(motion.age_s, KEPT_S)
    x, y, z = motion.position
    vn, ve, vd = motion.velocity
    x = x + vn * age_s + gained.place[0]
    y = y + ve * age_s + gained.place[1]
    z = z + vd * age_s + gained.place[2]
    vn = vn + gained.velocity[0]
    ve = ve + gained.velocity[1]
    vd = vd + gained.velocity[2]
    closing = (
        (course.position[0] - x) * gains.position_1_s,
        (course.position[1] - y) * gains.position_1_s,
        (course.position[2] - z) * gains.height_1_s,
    )
    closing_n, closing_e, closing_d = within(closing, limits.speed_m_s, limits.climb_m_s)
    ahead_n, ahead_e, ahead_d = course.velocity
    # Attitude and motors answer late: look at the velocity that the present tilt and thrust lead to.
    lead_s = gains.tilt_lead_s
    return (
        closing_n + ahead_n - vn - extra[0] * lead_s,
        closing_e + ahead_e - ve - extra[1] * lead_s,
        closing_d + ahead_d - vd - extra[2] * CLIMB_LEAD_S,
    )


def tilt_acceleration(body_down: Vector3) -> tuple[float, float]:
    """What a tilt gives, north and east [m/s^2], while the lift holds the weight."""
    north, east, down = body_down
    if down < 0.5:
        lift = 0.5
    else:
        lift = down
    return -GRAVITY * north / lift, -GRAVITY * east / lift


def _limited(acceleration: Vector3, wall: WallAhead | None) -> tuple[Vector3, bool]:
    """The acceleration within tilt and climb limits, and whether a limit was met."""
    north, east, down = acceleration
    steep = math.hypot(north, east) > _MOST_LEVEL_M_S2
    limited = within(acceleration, _MOST_LEVEL_M_S2, _MOST_CLIMB_M_S2)
    if wall is None:
        away = 0.0
    else:
        away = -(north * wall.north + east * wall.east)
    if steep and wall is not None and away > 0.0:
        limited = (*_away_first(north, east, away, wall), limited[2])
    return limited, steep or abs(down) > _MOST_CLIMB_M_S2


def _away_first(north: float, east: float, away: float, wall: WallAhead) -> tuple[float, float]:
    """``away`` of the acceleration leads off the wall: as much of it as the limit allows; along the wall the rest."""
    along_n = north + away * wall.north
    along_e = east + away * wall.east
    limit = _PRESSED_M_S2
    kept = min(away, limit)
    along = math.hypot(along_n, along_e)
    if along > 0.0:
        share = min(math.sqrt(max(limit * limit - kept * kept, 0.0)) / along, 1.0)
    else:
        share = 0.0
    return along_n * share - kept * wall.north, along_e * share - kept * wall.east


def _acceleration_to_tilt(north: float, east: float, yaw: float) -> tuple[float, float]:
    c = math.cos(yaw)
    s = math.sin(yaw)
    forward = c * north + s * east
    right = -s * north + c * east
    return math.atan2(right, GRAVITY), -math.atan2(forward, GRAVITY)
