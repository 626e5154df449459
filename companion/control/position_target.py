"""Where the hold is to be: what a pilot's SET_POSITION_TARGET_LOCAL_NED asks for, and the way there within limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from companion.config import HoldGains
from companion.mavlink.samples import SetPositionTarget
from models.evolve import replace
from models.frames import Array
from models.vehicle import Limits

_IGNORE_POSITION, _IGNORE_VELOCITY, _IGNORE_YAW = (1, 2, 4), (8, 16, 32), 1024
"""Bits of POSITION_TARGET_TYPEMASK, by axis."""
_NOWHERE = np.full(3, np.nan)


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
    """What is asked for, NED: position [m] (3,), NaN in an axis that only a velocity moves; velocity [m/s] (3,)."""

    position: Array
    velocity: Array
    yaw: float
    """Heading [rad]."""
    set_s: float
    lasts_s: float = math.inf
    """How long a velocity without a position counts: two and a half periods of the sender."""


def stay(yaw: float, t_s: float) -> Target:
    """Stop as soon as the limits allow, and stay there."""
    return Target(_NOWHERE, np.zeros(3), yaw, t_s)


def read_target(sample: SetPositionTarget, old: Target, position: Array, yaw: float, gains: HoldGains) -> Target | None:
    """The target that a message asks for, or None where its frame is not one of the four.

    ``position`` (3,) [m] and ``yaw`` [rad] are the vehicle's own; ``old`` gives what the message leaves out. An axis
    with neither position nor velocity keeps its place.
    """
    try:
        frame = TargetFrame(sample.frame)
    except ValueError:
        return None
    mask = sample.type_mask
    asked, speed = np.array(sample.position), np.array(sample.velocity)
    if frame.along_nose:
        asked, speed = _turned(asked, yaw), _turned(speed, yaw)
    if frame.from_vehicle:
        asked = asked + position
    no_place = np.array([bool(mask & bit) for bit in _IGNORE_POSITION]) | ~np.isfinite(asked)
    no_speed = np.array([bool(mask & bit) for bit in _IGNORE_VELOCITY]) | ~np.isfinite(speed)
    place = np.where(no_place, np.where(no_speed, old.position, np.nan), asked)
    heading = old.yaw
    if not mask & _IGNORE_YAW and math.isfinite(sample.yaw):
        heading = sample.yaw + (yaw if frame.along_nose else 0.0)
    lasts = min(max(2.5 * (sample.t_s - old.set_s), gains.target_age_s), gains.velocity_age_s)
    return Target(place, np.where(no_speed, 0.0, speed), heading, sample.t_s, lasts)


def _turned(vector: Array, yaw: float) -> Array:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]])


@dataclass(frozen=True)
class Reference:
    """Where the hold is to be at this instant, NED: position [m], velocity [m/s], acceleration [m/s^2], (3,) each."""

    position: Array
    velocity: Array
    acceleration: Array
    shaped_velocity: Array
    """The velocity behind the shaping of ``HoldGains.shape_s``."""
    following: bool = False
    """True on a target that moves as the vehicle can: it is followed as it is. Any other is approached."""


def start_reference(position: Array, velocity: Array, acceleration: Array) -> Reference:
    """Begin where the vehicle is, moving as it moves."""
    return Reference(position.copy(), velocity.copy(), acceleration.copy(), velocity.copy())


def advance(
    reference: Reference, target: Target, gains: HoldGains, limits: Limits, t_s: float, dt_s: float
) -> Reference:
    """The reference ``dt_s`` later: on the target where the vehicle can follow it, else on the way there.

    A velocity counts for ``target_age_s`` after its message where it goes with a position, ``Target.lasts_s`` where it
    stands alone.
    """
    age = max(t_s - target.set_s, 0.0)
    moved = np.isnan(target.position)
    valid = np.where(moved, age <= target.lasts_s, age <= gains.target_age_s)
    speed = np.where(valid, _limited(target.velocity, limits.speed_m_s, limits.climb_m_s), 0.0)
    # Between two messages a moving target moves on at its own velocity.
    place = target.position + speed * min(age, gains.target_age_s)
    to_go = np.where(moved, 0.0, np.where(np.isnan(place), 0.0, place - reference.position))
    near = float(np.abs(to_go).max()) <= gains.follow_m
    if not moved.any() and near and (reference.following or _caught_up(reference, to_go, speed, gains)):
        return _followed(reference, place, speed, gains, dt_s)
    return _approached(reference, to_go, speed, gains, limits, dt_s)


def _limited(vector: Array, level: float, vertical: float) -> Array:
    """Horizontal length at most ``level``, vertical part at most ``vertical``."""
    out = vector.copy()
    size = math.hypot(out[0], out[1])
    if size > level:
        out[:2] *= level / size
    out[2] = min(max(out[2], -vertical), vertical)
    return out


def _caught_up(reference: Reference, to_go: Array, speed: Array, gains: HoldGains) -> bool:
    slip = float(np.abs(speed - reference.velocity).max())
    return float(np.abs(to_go).max()) < gains.caught_up_m and slip < gains.caught_up_m_s


def _followed(reference: Reference, place: Array, speed: Array, gains: HoldGains, dt_s: float) -> Reference:
    # A target that changes its velocity asks for an acceleration: give it rather than wait for the error.
    shape = np.asarray(gains.shape_s)
    acceleration = (speed - reference.shaped_velocity) / shape
    shaped = reference.shaped_velocity + acceleration * np.minimum(dt_s, shape)
    return Reference(place, speed, acceleration, shaped, following=True)


def _approached(
    reference: Reference, to_go: Array, speed: Array, gains: HoldGains, limits: Limits, dt_s: float
) -> Reference:
    """A step of a motion limited in speed, acceleration and jerk that ends on the target without overshoot.

    Near the end it is linear and critically damped: acceleration follows the velocity error at four times the rate at
    which velocity follows the distance.
    """
    most, jerk = limits.acceleration_m_s2, gains.jerk_m_s3
    wanted = speed.copy()
    closing = gains.closing_1_s
    brake = min(0.75 * most, 0.25 * jerk)  # gentle enough for the jerk that braking begins with
    distance = math.hypot(to_go[0], to_go[1])
    if distance > 1e-9:
        wanted[:2] += to_go[:2] * (_eased(distance, closing, brake) / distance)
    wanted[2] += math.copysign(_eased(abs(to_go[2]), closing, brake), to_go[2])
    slip = _limited(wanted, limits.speed_m_s, limits.climb_m_s) - reference.velocity
    demand = np.array([math.copysign(_eased(abs(s), 4.0 * closing, jerk), s) for s in slip])
    demand = _limited(demand, most, most)
    step = jerk * dt_s
    acceleration = reference.acceleration + np.clip(demand - reference.acceleration, -step, step)
    velocity = reference.velocity + acceleration * dt_s
    return replace(
        reference,
        position=reference.position + velocity * dt_s,
        velocity=velocity,
        acceleration=acceleration,
        shaped_velocity=velocity,
        following=False,
    )


def _eased(error: float, slope: float, limit: float) -> float:
    """``slope`` times a small error; for a large one the rate from which ``limit`` still brings it to rest."""
    if error <= limit / slope**2:
        return slope * error
    return math.sqrt(2.0 * limit * (error - 0.5 * limit / slope**2))
