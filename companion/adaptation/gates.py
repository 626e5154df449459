"""When nothing may be learned: the wrench that is measured is then not only that of the air and of the vehicle."""

from __future__ import annotations

import math

from companion.adapt_options import AdaptTuning
from companion.adaptation.pause import Pause
from companion.config import PipelineConfig
from companion.control.disturbance import Disturbance
from companion.control.state import PipelineState
from companion.mavlink.samples import Imu
from models.frames import GRAVITY
from models.surrogate.empty import is_empty

_TAKING_OFF, _LANDING = 3, 4
"""MAV_LANDED_STATE."""


def pause(state: PipelineState, imu: Imu, config: PipelineConfig, clear: Disturbance | None = None) -> Pause | None:
    """The reason not to learn from this sample; the surroundings of ``clear`` have been looked at already."""
    tuning, limits, estimates, now = config.adapt_tuning, config.tuning, state.estimates, imu.t_s
    disturbance, attitude, position = state.disturbance, estimates.attitude, estimates.position
    if disturbance is None or disturbance.parts is None:
        return Pause.NO_ROTORS
    if attitude is None or position is None or now - state.disturbance_s > limits.attitude_age_s:
        return Pause.STALE
    old_attitude = now - attitude.t_s > limits.attitude_age_s
    if old_attitude or now - position.t_s > limits.position_age_s or not estimates.trust.trusted:
        return Pause.STALE
    if not math.isfinite(sum(imu.specific_force_frd)):
        return Pause.NO_IMU
    rows = estimates.rows
    if now - state.airborne_since_s < tuning.airborne_s or state.landed_state in (_TAKING_OFF, _LANDING):
        return Pause.NOT_FLYING
    if rows is None or rows[2][2] < tuning.tilt_cos:
        return Pause.TILTED
    around = None if disturbance is clear else _surroundings(disturbance, config, tuning, now)
    return around or _pushed(disturbance.parts.vertical_n, imu, config, tuning)


def _surroundings(disturbance: Disturbance, config: PipelineConfig, tuning: AdaptTuning, now_s: float) -> Pause | None:
    for surface in (disturbance.ground, disturbance.wall, disturbance.ceiling):
        if not surface.known:
            return Pause.SURFACE_UNKNOWN
        if surface.jumped or now_s - surface.stepped_s < config.tuning.surface_step_s:
            return Pause.SURFACE_STEP
    assert disturbance.parts is not None
    around = disturbance.parts.around
    height, gap = min(around.heights), min(around.gaps)
    if height < tuning.near_ground_radii or gap * config.vehicle.rotor_radius_m < tuning.near_wall_m:
        return Pause.CONTACT
    if is_empty(config.model) and min(height, gap) < tuning.reach_radii:
        return Pause.UNMODELLED
    return Pause.OUTSIDE if disturbance.trust <= 0.0 else None


def _pushed(vertical_n: float, imu: Imu, config: PipelineConfig, tuning: AdaptTuning) -> Pause | None:
    fx, fy, fz = imu.specific_force_frd
    if fx * fx + fy * fy + fz * fz > tuning.clipped_m_s2**2:
        return Pause.CLIPPED
    mass = config.vehicle.mass_kg
    if abs(mass * fz - vertical_n) > tuning.external_share * mass * GRAVITY:
        return Pause.EXTERNAL
    return None
