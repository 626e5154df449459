"""Cascaded position hold flown through attitude and thrust: the base that offsets are added to.

SET_ATTITUDE_TARGET replaces the autopilot's position controller, so the hold is ours. Position P, velocity PI with a
lead from the lean that there is, thrust by the affine map. A careless outer loop is worse than none (docs/control.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.config import HoldGains
from companion.mavlink.firmware import ThrustMap
from models.evolve import replace
from models.frames import GRAVITY, Array


@dataclass(frozen=True)
class Reference:
    """Where to be: NED position [m], velocity [m/s] fed forward, heading [rad]."""

    position: Array
    velocity: Array
    yaw: float
    set_s: float


@dataclass(frozen=True)
class Hold:
    """State of an engaged hold: its reference and integrals (NED, m/s^2)."""

    reference: Reference
    integral: Array
    shaped_velocity: Array
    t_s: float
    lean_mean: Array
    """What the lean gives on average, north and east, m/s^2."""


@dataclass(frozen=True, slots=True)
class BaseSetpoint:
    """Roll, pitch, yaw [rad] and thrust 0...1 that the base asks for, before any offset."""

    roll: float
    pitch: float
    yaw: float
    thrust: float
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What it stands for, NED m/s^2, beyond balancing gravity."""


def engage(t_s: float, position: Array, yaw: float, body_down: Array) -> Hold:
    """Hold here, bumplessly: what the present lean accelerates is what the integrals start with.

    ``body_down`` (3,) is the body's down axis in NED.
    """
    lean = _lean_acceleration(body_down)
    start = np.clip(np.array([lean[0], lean[1], 0.0]), -1.5, 1.5)
    reference = Reference(position.copy(), np.zeros(3), yaw, t_s)
    return Hold(reference, start, np.zeros(3), t_s, lean)


def retarget(hold: Hold, t_s: float, position: Array | None, velocity: Array | None, yaw: float | None) -> Hold:
    """A pilot's position, velocity or heading target; None leaves that part as it is."""
    old = hold.reference
    return replace(
        hold,
        reference=Reference(
            old.position if position is None else position,
            np.zeros(3) if velocity is None else velocity,
            old.yaw if yaw is None else yaw,
            t_s,
        ),
    )


def fly(
    hold: Hold, gains: HoldGains, t_s: float, position: Array, velocity: Array, body_down: Array, thrust: ThrustMap
) -> tuple[Hold, BaseSetpoint]:
    """One step of the cascade. Position and velocity are NED; ``body_down`` (3,) is the body's down axis in NED.

    Returns the new integrals and the setpoint.
    """
    reference = hold.reference
    dt = min(max(t_s - hold.t_s, 0.0), 0.1)
    stale = t_s - reference.set_s > gains.target_age_s
    feed_forward = np.zeros(3) if stale else reference.velocity
    error = reference.position - position
    demand = error * (gains.position_1_s, gains.position_1_s, gains.height_1_s)
    speed = math.hypot(demand[0], demand[1])
    if speed > gains.max_speed_m_s:
        demand[:2] *= gains.max_speed_m_s / speed
    demand[2] = min(max(demand[2], -gains.max_climb_m_s), gains.max_climb_m_s)
    # A target that changes its velocity asks for an acceleration: give it rather than wait for the error.
    shape = np.asarray(gains.shape_s)
    lead = (feed_forward - hold.shaped_velocity) / shape
    shaped = hold.shaped_velocity + lead * np.minimum(dt, shape)
    # The lean that there is tells the velocity a little ahead: phase that a late attitude loop takes away.
    lean = _lean_acceleration(body_down)
    lean_mean = hold.lean_mean + (lean - hold.lean_mean) * min(dt / gains.tilt_mean_s, 1.0)
    slip = demand + feed_forward - velocity
    slip[:2] -= gains.tilt_lead_s * (lean - lean_mean - lead[:2])
    damping = np.array([gains.velocity_1_s, gains.velocity_1_s, gains.climb_1_s])
    acceleration = slip * damping + hold.integral + lead
    limit = GRAVITY * math.tan(gains.max_tilt_rad)
    level = math.hypot(acceleration[0], acceleration[1])
    saturated = level > limit or abs(acceleration[2]) > gains.max_climb_acceleration_m_s2
    if level > limit:
        acceleration[:2] *= limit / level
    acceleration[2] = min(max(acceleration[2], -gains.max_climb_acceleration_m_s2), gains.max_climb_acceleration_m_s2)
    integral = hold.integral
    if not saturated:
        rate = slip * (gains.integral_1_s2, gains.integral_1_s2, gains.climb_integral_1_s2)
        integral = np.clip(integral + rate * dt, -gains.max_integral_m_s2, gains.max_integral_m_s2)
    roll, pitch = _acceleration_to_lean(acceleration[0], acceleration[1], reference.yaw)
    command = thrust.hover + thrust.change(-float(acceleration[2]) / GRAVITY)
    north, east, down = map(float, acceleration)
    setpoint = BaseSetpoint(roll, pitch, reference.yaw, command, (north, east, down))
    return replace(hold, integral=integral, shaped_velocity=shaped, t_s=t_s, lean_mean=lean_mean), setpoint


def _acceleration_to_lean(north: float, east: float, yaw: float) -> tuple[float, float]:
    c, s = math.cos(yaw), math.sin(yaw)
    forward, right = c * north + s * east, -s * north + c * east
    return math.atan2(right, GRAVITY), -math.atan2(forward, GRAVITY)


def _lean_acceleration(body_down: Array) -> Array:
    """What a lean gives, north and east [m/s^2] (2,), while the lift holds the weight."""
    out: Array = -GRAVITY * body_down[:2] / max(float(body_down[2]), 0.5)
    return out
