"""The disturbance and the drift of the position, renewed as positions come."""

from __future__ import annotations

import math

from companion.config import Base, PipelineConfig
from companion.control.plant import FULL
from companion.control.reasons import Notice
from companion.disturbance.model import modelled_disturbance
from companion.disturbance.wall_law import NEAR_RADII, Lips, WallLaw, wall_law
from companion.estimation import estimator as est
from companion.estimation import height_drift
from companion.estimation.range_geometry import NO_MATTER_RADII
from companion.estimation.surfaces import Seen
from companion.estimation.wall_drift import NO_WALL_DRIFT, compare_wall
from companion.state.pipeline_state import PipelineState
from models.common.frames import GRAVITY
from models.common.frozen_copy import with_changes
from models.vehicle_wrench import fan_rpm_now

DISTURBANCE_PERIOD_S = 0.03
"""The model is asked this often, after a position, so that an attitude is answered without waiting for it."""
_LIFT_TIME_S = 2.0
"""Over which the modelled lift of a flying vehicle is averaged before it is compared with the weight."""
_UPSTREAM_DAMPING_1_S = 2.0
"""Of an upstream controller's velocity loop: ArduPilot's PSC_VELXY_P; PX4's MPC_XY_VEL_P_ACC is 1.8."""


def renew_disturbance(state: PipelineState, t_s: float, config: PipelineConfig) -> PipelineState:
    """The modelled disturbance of now; None where rotor speeds or attitude are not known."""
    rotors = est.rotor_speeds(state.estimates, config, t_s)
    rows = state.estimates.rows
    if rotors is None or rows is None:
        return with_changes(state, air=with_changes(state.air, disturbance=None, disturbance_s=t_s))
    if state.learned.adaptation is None:
        correction = None
    else:
        correction = state.learned.adaptation.applied
    disturbance = modelled_disturbance(
        estimates=state.estimates,
        config=config,
        rotor_rpm=rotors,
        rotation=rows,
        t_s=t_s,
        damping_1_s=damping_1_s(state, config),
        correction=correction,
    )
    before = state.air
    share = before.lift_share
    if before.airborne.flies(t_s):
        now = disturbance.free_lift_n / (config.vehicle.mass_kg * GRAVITY)
        share += min(max(t_s - before.disturbance_s, 0.0) / _LIFT_TIME_S, 1.0) * (now - share)
    air = with_changes(before, disturbance=disturbance, disturbance_s=t_s, lift_share=share)
    return with_changes(state, air=air)


def wall_law_now(state: PipelineState, config: PipelineConfig, t_s: float) -> WallLaw | None:
    """How the pull of the wall beside the vehicle grows towards it; None where no wall is near."""
    disturbance = state.air.disturbance
    rotors = est.rotor_speeds(state.estimates, config, t_s)
    if disturbance is None or rotors is None or disturbance.wall.seen is not Seen.SURFACE:
        return None
    nearest = min(disturbance.d_m)
    if nearest > NEAR_RADII * config.vehicle.rotor_radius_m:
        return None
    lips = Lips(
        h_m=disturbance.h_m,
        behind_m=tuple([d_m - nearest for d_m in disturbance.d_m]),
        rpm=fan_rpm_now(config.vehicle, rotors),
    )
    adaptation = state.learned.adaptation
    if adaptation is None or disturbance.parts is None:
        return wall_law(config, lips)
    return wall_law(config, lips, adaptation.applied, disturbance.parts.around)


def damping_1_s(state: PipelineState, config: PipelineConfig) -> float:
    """Velocity damping of the loop in charge."""
    if config.base is Base.UPSTREAM:
        return _UPSTREAM_DAMPING_1_S
    return (FULL if state.plant.tuned is None else state.plant.tuned.gains).velocity_1_s


def compare_ranges(state: PipelineState, config: PipelineConfig) -> PipelineState:
    """The ranges to ground and wall beside the newest position, while the hold flies by it."""
    estimates = state.estimates
    disturbance = state.air.disturbance
    held = state.held
    position = estimates.position
    reset = estimates.reset
    if held.hold is None or position is None:
        if held.wall_drift is NO_WALL_DRIFT:
            return state
        return with_changes(state, held=with_changes(held, wall_drift=NO_WALL_DRIFT))
    t_s = position.t_s
    if disturbance is None:
        ground, wall = (est.surface(estimates, config, what, t_s) for what in ("ground", "wall"))
    else:
        ground = disturbance.ground
        wall = disturbance.wall
    near_m = NO_MATTER_RADII * config.vehicle.rotor_radius_m
    beside = compare_wall(
        held.wall_drift,
        wall,
        position,
        near_m,
        -math.inf if reset is None else reset.t_s,
        state.felt,
    )
    notice: tuple[Notice, float] | None
    known = held.wall_drift
    if beside.drifts and (not known.drifts or beside.wrong is not known.wrong):
        notice = (Notice.POSITION_DRIFTS if beside.holds_off else Notice.WALL_RANGE_DRIFTS, t_s)
    else:
        notice = state.notice
    drift = height_drift.compare(held.drift, ground, position)
    return with_changes(
        state, held=with_changes(held, drift=drift, wall_drift=beside), notice=notice
    )
