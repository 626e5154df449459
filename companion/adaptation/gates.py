"""When nothing may be learned: the wrench that is measured is then not only that of the air and of the vehicle."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.config import PipelineConfig
from companion.disturbance.records import Disturbance
from companion.estimation.estimates import ATTITUDE_AGE_S, POSITION_AGE_S, Estimates
from companion.mavlink.samples import Imu
from models.common.frames import GRAVITY

NO_IMU = "no accelerometer"
NOT_FLYING = "not flying, or taking off or landing"
SURFACE_UNKNOWN = "a range is not believed"
SURFACE_STEP = "ground or wall jumped"
"""Reasons to pause that others look for."""
_TAKING_OFF = 3
_LANDING = 4
"""MAV_LANDED_STATE."""
_AIRBORNE_S = 2.0
_NEAR_WALL_M = 0.03
"""Lip to wall: nearer, it may touch."""
_NEAR_GROUND_RADII = 0.1
"""The same for the ground, in rotor radii, as in diagnosis."""
_CLIPPED_M_S2 = 60.0
"""Of an accelerometer: a bump, or the end of its scale."""
_TILT_COS = 0.87
"""Cosine of 30 degrees: beyond, nobody hovers."""
_EXTERNAL_SHARE = 0.40
"""Of the weight: more force than this that is not the rotors' is a hand or a surface."""


class Situation(NamedTuple):
    """What is known of the vehicle when its accelerometer speaks."""

    estimates: Estimates
    disturbance: Disturbance | None
    disturbance_s: float
    """When it was computed."""
    airborne_since_s: float
    landed_state: int


def pause(
    here: Situation, imu: Imu, config: PipelineConfig, clear: Disturbance | None = None
) -> str | None:
    """The reason not to learn from this sample, as the pilot reads it; ``clear`` has been looked at already."""
    estimates = here.estimates
    now = imu.t_s
    disturbance = here.disturbance
    attitude = estimates.attitude
    position = estimates.position
    if disturbance is None or disturbance.parts is None:
        return "rotor speeds missing or old"
    if attitude is None or position is None or now - here.disturbance_s > ATTITUDE_AGE_S:
        return "attitude or position old"
    old_attitude = now - attitude.t_s > ATTITUDE_AGE_S
    if old_attitude or now - position.t_s > POSITION_AGE_S or not estimates.trust.trusted:
        return "attitude or position old"
    if not math.isfinite(sum(imu.specific_force_frd)):
        return NO_IMU
    rows = estimates.rows
    if now - here.airborne_since_s < _AIRBORNE_S or here.landed_state in (_TAKING_OFF, _LANDING):
        return NOT_FLYING
    if rows is None or rows[2][2] < _TILT_COS:
        return "tilted beyond 30 degrees"
    if disturbance is clear:
        around = None
    else:
        around = _surroundings(disturbance, config, now)
    return around or _pushed(disturbance.parts.vertical_n, imu, config)


def _surroundings(disturbance: Disturbance, config: PipelineConfig, now_s: float) -> str | None:
    for surface in (disturbance.ground, disturbance.wall, disturbance.ceiling):
        if not surface.known:
            return SURFACE_UNKNOWN
        if surface.jumped or surface.stepped(now_s):
            return SURFACE_STEP
    assert disturbance.parts is not None
    around = disturbance.parts.around
    height = min(around.heights)
    gap = min(around.gaps)
    if height < _NEAR_GROUND_RADII or gap * config.vehicle.rotor_radius_m < _NEAR_WALL_M:
        return "so near that it may touch"
    if disturbance.trust <= 0.0:
        return "outside the data of the model"
    return None


def _pushed(vertical_n: float, imu: Imu, config: PipelineConfig) -> str | None:
    fx, fy, fz = imu.specific_force_frd
    if fx * fx + fy * fy + fz * fz > _CLIPPED_M_S2**2:
        return "bump, or accelerometer clipped"
    mass = config.vehicle.mass_kg
    if abs(mass * fz - vertical_n) > _EXTERNAL_SHARE * mass * GRAVITY:
        return "an external force: the vehicle is held or touched"
    return None
