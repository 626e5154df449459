"""Cascaded position hold flown through attitude and thrust: the base that offsets are added to.

SET_ATTITUDE_TARGET replaces the autopilot's position controller, so the hold is ours. Position P, velocity PI, position
and velocity predicted to the instant at which the attitude can answer, thrust by the affine map. A careless outer loop
is worse than none (docs/control.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.config import HoldGains
from companion.control.position_target import Reference, Target, advance, start_reference, stay
from companion.mavlink.firmware import ThrustMap
from models.evolve import replace
from models.frames import GRAVITY, Array
from models.vehicle import Limits

_MAX_PREDICTION_S = 0.4
"""A position older than this is not predicted further: the tilt since then says too little."""
_SAME_STAMP_S = 1e-4
"""Positions whose stamps differ by less are one: stamps count milliseconds."""


@dataclass(frozen=True)
class Motion:
    """What is measured, NED: position [m] and velocity [m/s] (3,) as they were ``age_s`` ago, and the attitude now."""

    position: Array
    velocity: Array
    body_down: Array
    """The body's down axis (3,)."""
    yaw: float
    age_s: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    """North and east acceleration [m/s^2] of the offset that is applied: a part of the tilt that balances something."""


@dataclass(frozen=True)
class Since:
    """What accelerations have added since the newest position was measured: to its velocity and to its place, (3,)."""

    stamp_s: float
    velocity: Array
    place: Array


@dataclass(frozen=True)
class Hold:
    """State of an engaged hold. Accelerations are NED, m/s^2."""

    target: Target
    reference: Reference
    integral: Array
    """What balances wind, trim and a wrong hover thrust, (3,)."""
    t_s: float
    tilt_mean: Array
    """What the tilt gives on average, north and east, beyond offsets and the reference's own acceleration."""
    climb_mean: float
    """Average of the vertical acceleration that was asked for beyond the reference's own."""
    climb_command: float
    """Vertical acceleration last asked for, integral included: what carries a late velocity on."""
    since: Since | None = None


@dataclass(frozen=True)
class BaseSetpoint:
    """Roll, pitch, yaw [rad] and thrust 0...1 that the base asks for, before any offset."""

    roll: float
    pitch: float
    yaw: float
    thrust: float
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What it stands for, NED m/s^2, beyond balancing gravity."""


def engage(t_s: float, motion: Motion, balance: Array, thrust_now: float, thrust: ThrustMap, gains: HoldGains) -> Hold:
    """Hold here, bumplessly: the first setpoint is the tilt and the thrust that fly now.

    ``balance`` (2,) is the part of the tilt's acceleration that balances wind rather than moving the vehicle; the
    integrals start with it, and the rest of the tilt starts the reference, which brakes from there. ``thrust_now`` is
    the thrust 0...1 that flies.
    """
    tilt = tilt_acceleration(motion.body_down)
    up = (thrust_now - thrust.hover) * thrust.slope * GRAVITY
    most = gains.max_integral_m_s2
    integral = np.clip(np.array([balance[0], balance[1], -up]), -most, most)
    limit = GRAVITY * math.tan(gains.max_tilt_rad)
    rest = np.clip(tilt - integral[:2], -limit, limit)
    reference = start_reference(motion.position, motion.velocity, np.array([rest[0], rest[1], 0.0]))
    climb = float(integral[2])
    return Hold(stay(motion.yaw, t_s), reference, integral, t_s, tilt - rest, climb, climb)


def resume(hold: Hold, motion: Motion) -> Hold:
    """Go on after a gap: to the same target, on a way that begins where the vehicle is."""
    old = hold.target
    place = np.where(np.isnan(old.position), hold.reference.position, old.position)
    reference = start_reference(motion.position, motion.velocity, np.zeros(3))
    return replace(hold, target=replace(old, position=place, velocity=np.zeros(3)), reference=reference)


def balanced(hold: Hold, acceleration: Array, gains: HoldGains) -> Hold:
    """The hold after it took over what another part of the setpoint balanced: (3,) NED m/s^2, into its integral."""
    most = gains.max_integral_m_s2
    taken = np.clip(hold.integral + acceleration, -most, most) - hold.integral
    return replace(
        hold,
        integral=hold.integral + taken,
        tilt_mean=hold.tilt_mean + taken[:2],
        climb_mean=hold.climb_mean + float(taken[2]),
        climb_command=hold.climb_command + float(taken[2]),
    )


def shifted(hold: Hold, by_ned: Array) -> Hold:
    """The hold after the origin of positions moved: everything stays where it is over the ground."""
    reference = replace(hold.reference, position=hold.reference.position + by_ned)
    return replace(hold, reference=reference, target=replace(hold.target, position=hold.target.position + by_ned))


def fly(
    hold: Hold, gains: HoldGains, limits: Limits, t_s: float, motion: Motion, thrust: ThrustMap
) -> tuple[Hold, BaseSetpoint]:
    """One step of the cascade; returns the hold one step on and the setpoint."""
    dt = min(max(t_s - hold.t_s, 0.0), 0.1)
    if t_s - hold.t_s > gains.gap_s:
        hold, dt = resume(hold, motion), 0.0
    reference = advance(hold.reference, hold.target, gains, limits, t_s, dt)
    share = min(dt / gains.tilt_mean_s, 1.0)
    # Tilt and thrust that are neither fed forward nor lasting: what will change the velocity unasked.
    tilt = tilt_acceleration(motion.body_down) - motion.offset - reference.acceleration[:2]
    climb = hold.climb_command - float(reference.acceleration[2])
    tilt_mean = hold.tilt_mean + (tilt - hold.tilt_mean) * share
    climb_mean = hold.climb_mean + (climb - hold.climb_mean) * share
    extra = np.array([tilt[0] - tilt_mean[0], tilt[1] - tilt_mean[1], climb - climb_mean])
    since = _followed(hold.since, t_s - motion.age_s, motion.age_s, dt, extra + reference.acceleration)
    velocity = motion.velocity + since.velocity
    position = motion.position + min(motion.age_s, _MAX_PREDICTION_S) * motion.velocity + since.place

    error = reference.position - position
    demand = error * (gains.position_1_s, gains.position_1_s, gains.height_1_s)
    speed = math.hypot(demand[0], demand[1])
    if speed > limits.speed_m_s:
        demand[:2] *= limits.speed_m_s / speed
    demand[2] = min(max(demand[2], -limits.climb_m_s), limits.climb_m_s)
    slip = demand + reference.velocity - velocity
    # Attitude and motors answer late: look at the velocity that the present tilt and thrust lead to.
    slip -= extra * (gains.tilt_lead_s, gains.tilt_lead_s, gains.climb_lead_s)
    damping = np.array([gains.velocity_1_s, gains.velocity_1_s, gains.climb_1_s])
    acceleration, saturated = _limited(slip * damping + hold.integral + reference.acceleration, gains)
    integral = hold.integral
    if not saturated:
        rate = slip * (gains.integral_1_s2, gains.integral_1_s2, gains.climb_integral_1_s2)
        integral = np.clip(integral + rate * dt, -gains.max_integral_m_s2, gains.max_integral_m_s2)
    north, east, down = map(float, acceleration)
    roll, pitch = _acceleration_to_tilt(north, east, motion.yaw)
    command = thrust.hover + thrust.change(-down / GRAVITY)
    setpoint = BaseSetpoint(roll, pitch, hold.target.yaw, command, (north, east, down))
    return Hold(hold.target, reference, integral, t_s, tilt_mean, climb_mean, down, since), setpoint


def tilt_acceleration(body_down: Array) -> Array:
    """What a tilt gives, north and east [m/s^2] (2,), while the lift holds the weight."""
    out: Array = -GRAVITY * body_down[:2] / max(float(body_down[2]), 0.5)
    return out


def _followed(since: Since | None, stamp_s: float, age_s: float, dt: float, acceleration: Array) -> Since:
    """One step further from a late position, by what accelerates the vehicle now (3,).

    Between two positions it is summed step by step. The present acceleration over the whole age would be an algebraic
    loop: a setpoint would be answered by its own forecast, and thrust would leap from limit to limit at every step
    once damping times age exceeds 1.
    """
    if since is None or stamp_s > since.stamp_s + _SAME_STAMP_S:
        age = min(max(age_s, 0.0), _MAX_PREDICTION_S)
        gained = age * acceleration
        return Since(stamp_s, gained, 0.5 * age * gained)
    if age_s > _MAX_PREDICTION_S:
        return since
    return Since(since.stamp_s, since.velocity + dt * acceleration, since.place + dt * since.velocity)


def _limited(acceleration: Array, gains: HoldGains) -> tuple[Array, bool]:
    """The acceleration within tilt and climb limits, and whether a limit was met."""
    limit, most = GRAVITY * math.tan(gains.max_tilt_rad), gains.max_climb_acceleration_m_s2
    level = math.hypot(acceleration[0], acceleration[1])
    saturated = level > limit or abs(acceleration[2]) > most
    if level > limit:
        acceleration[:2] *= limit / level
    acceleration[2] = min(max(acceleration[2], -most), most)
    return acceleration, saturated


def _acceleration_to_tilt(north: float, east: float, yaw: float) -> tuple[float, float]:
    c, s = math.cos(yaw), math.sin(yaw)
    forward, right = c * north + s * east, -s * north + c * east
    return math.atan2(right, GRAVITY), -math.atan2(forward, GRAVITY)
