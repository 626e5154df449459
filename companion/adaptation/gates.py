"""When nothing may be learned: the wrench that is measured is then not only that of the air and of the vehicle."""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from companion.config import PipelineConfig
from companion.estimation.disturbance import Disturbance
from companion.estimation.estimator import ATTITUDE_AGE_S, POSITION_AGE_S, Estimates
from companion.mavlink.samples import Imu
from models.frames import GRAVITY
from models.surrogate.empty import is_empty

_TAKING_OFF, _LANDING = 3, 4
"""MAV_LANDED_STATE."""
_AIRBORNE_S = 2.0
_NEAR_WALL_M = 0.03
"""Lip to wall: nearer, it may touch."""
_NEAR_GROUND_RADII = 0.1
"""The same for the ground, in rotor radii, as in diagnosis."""
_REACH_RADII = 4.0
"""So far ground and wall reach (Ai et al. 2020): nearer, a model without them explains nothing."""
_CLIPPED_M_S2 = 60.0
"""Of an accelerometer: a bump, or the end of its scale."""
_TILT_COS = 0.87
"""Cosine of 30 degrees: beyond, nobody hovers."""
_EXTERNAL_SHARE = 0.40
"""Of the weight: more force than this that is not the rotors' is a hand or a surface."""


class Pause(Enum):
    """Why nothing is learned now; the value is what the pilot reads."""

    NO_IMU = "no accelerometer"
    NO_ROTORS = "rotor speeds missing or old"
    STALE = "attitude or position old"
    NOT_FLYING = "not flying, or taking off or landing"
    SURFACE_UNKNOWN = "a range is not believed"
    SURFACE_STEP = "ground or wall jumped"
    CONTACT = "so near that it may touch"
    UNMODELLED = "near ground or wall, and the model does not cover them"
    OUTSIDE = "outside the data of the model"
    TILTED = "tilted beyond 30 degrees"
    CLIPPED = "bump, or accelerometer clipped"
    EXTERNAL = "an external force: the vehicle is held or touched"


class Situation(NamedTuple):
    """What is known of the vehicle when its accelerometer speaks."""

    estimates: Estimates
    disturbance: Disturbance | None
    disturbance_s: float
    """When it was computed."""
    airborne_since_s: float
    landed_state: int


def pause(here: Situation, imu: Imu, config: PipelineConfig, clear: Disturbance | None = None) -> Pause | None:
    """The reason not to learn from this sample; the surroundings of ``clear`` have been looked at already."""
    estimates, now = here.estimates, imu.t_s
    disturbance, attitude, position = here.disturbance, estimates.attitude, estimates.position
    if disturbance is None or disturbance.parts is None:
        return Pause.NO_ROTORS
    if attitude is None or position is None or now - here.disturbance_s > ATTITUDE_AGE_S:
        return Pause.STALE
    old_attitude = now - attitude.t_s > ATTITUDE_AGE_S
    if old_attitude or now - position.t_s > POSITION_AGE_S or not estimates.trust.trusted:
        return Pause.STALE
    if not math.isfinite(sum(imu.specific_force_frd)):
        return Pause.NO_IMU
    rows = estimates.rows
    if now - here.airborne_since_s < _AIRBORNE_S or here.landed_state in (_TAKING_OFF, _LANDING):
        return Pause.NOT_FLYING
    if rows is None or rows[2][2] < _TILT_COS:
        return Pause.TILTED
    around = None if disturbance is clear else _surroundings(disturbance, config, now)
    return around or _pushed(disturbance.parts.vertical_n, imu, config)


def _surroundings(disturbance: Disturbance, config: PipelineConfig, now_s: float) -> Pause | None:
    for surface in (disturbance.ground, disturbance.wall, disturbance.ceiling):
        if not surface.known:
            return Pause.SURFACE_UNKNOWN
        if surface.jumped or surface.stepped(now_s):
            return Pause.SURFACE_STEP
    assert disturbance.parts is not None
    around = disturbance.parts.around
    height, gap = min(around.heights), min(around.gaps)
    if height < _NEAR_GROUND_RADII or gap * config.vehicle.rotor_radius_m < _NEAR_WALL_M:
        return Pause.CONTACT
    if is_empty(config.model) and min(height, gap) < _REACH_RADII:
        return Pause.UNMODELLED
    return Pause.OUTSIDE if disturbance.trust <= 0.0 else None


def _pushed(vertical_n: float, imu: Imu, config: PipelineConfig) -> Pause | None:
    fx, fy, fz = imu.specific_force_frd
    if fx * fx + fy * fy + fz * fz > _CLIPPED_M_S2**2:
        return Pause.CLIPPED
    mass = config.vehicle.mass_kg
    if abs(mass * fz - vertical_n) > _EXTERNAL_SHARE * mass * GRAVITY:
        return Pause.EXTERNAL
    return None
