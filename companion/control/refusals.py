"""Every refusal that holds now, gravest first."""

from __future__ import annotations

import math

from companion.config import Base, Carrier, HoldGains, PipelineConfig
from companion.control.authority import Reason
from companion.control.disturbance import Disturbance
from companion.control.hover_thrust import hover_parameter, is_known
from companion.control.plant import HoldTuning
from companion.control.state import PipelineState
from companion.estimation.estimator import Estimates, Seen
from companion.estimation.height_drift import FADE_M_S
from companion.mavlink.firmware import Stack, ThrustMeaning, stack_of, takes_setpoints, thrust_meaning
from companion.mavlink.samples import Heartbeat
from models.surrogate.empty import is_empty

_ABOUT_RANGES = {
    Seen.MISSING: Reason.RANGE_MISSING,
    Seen.STALE: Reason.RANGE_STALE,
    Seen.LOST: Reason.RANGE_LOST,
    Seen.FROZEN: Reason.RANGE_FROZEN,
}
_ABOUT_THRUST = {
    ThrustMeaning.CLIMB_RATE: Reason.THRUST_IS_CLIMB_RATE,
    ThrustMeaning.IGNORED: Reason.TYPE_IGNORED,
    ThrustMeaning.UNKNOWN: Reason.THRUST_UNKNOWN,
}

_HOLD, _UPSTREAM, _ACCELERATION = Base.HOLD, Base.UPSTREAM, Carrier.ACCELERATION
_OTHER, _THRUST = Stack.OTHER, ThrustMeaning.THRUST
"""A member of an enum by its class takes ten times as long as a name: these are asked for at every setpoint."""


def refusals(state: PipelineState, config: PipelineConfig, t_s: float) -> tuple[Reason, ...]:
    """Why nothing is sent, or why offsets fade."""
    out: list[Reason] = []
    estimates, tuning, heartbeat, disturbance = state.estimates, config.tuning, state.heartbeat, state.disturbance
    holds = config.base is _HOLD
    if heartbeat is None or t_s - heartbeat.t_s > tuning.heartbeat_age_s:
        out.append(Reason.NO_HEARTBEAT)
    else:
        _autopilot(out, state, heartbeat, config)
    _arrivals(out, state, config, t_s)
    if t_s - state.airborne_since_s < tuning.airborne_after_s:
        out.append(Reason.LANDED)
    if holds:
        _hold(out, state, config, t_s)
    if disturbance is None:
        out.append(Reason.RPM_MISSING)
    else:
        _surfaces(out, disturbance, tuning.surface_step_s, t_s)
    if state.drift.drifts and abs(state.drift.rate_m_s) >= FADE_M_S:
        out.append(Reason.HEIGHT_DRIFTS)
    if estimates.rows is not None and estimates.rows[2][2] < math.cos(tuning.max_tilt_rad):
        out.append(Reason.TILTED)
    if holds and t_s - state.swing.swung_s < tuning.swing_pause_s:
        out.append(Reason.SWINGING)
    if state.stopping:
        out.append(Reason.STOPPING)
    low, high = tuning.lift_share
    if not low <= state.lift_share <= high:
        out.append(Reason.MODEL_WRONG)
    if t_s - estimates.undeclared_s < tuning.rotor_age_s:
        out.append(Reason.ROTORS_WRONG)
    if not config.offsets:
        out.append(Reason.OFFSETS_OFF)
    elif is_empty(config.model):
        out.append(Reason.NO_MODEL)
    return tuple(out)


def _arrivals(out: list[Reason], state: PipelineState, config: PipelineConfig, t_s: float) -> None:
    """What does not come, or comes late."""
    estimates, tuning = state.estimates, config.tuning
    if estimates.attitude is None or t_s - estimates.attitude.t_s > tuning.attitude_age_s:
        out.append(Reason.ATTITUDE_STALE)
    if t_s - state.late_since_s >= tuning.late_stop_for_s:
        out.append(Reason.TOO_LATE)
    elif lateness(estimates, config) > tuning.late_fade_s:
        out.append(Reason.LATE)
    if config.base is _UPSTREAM and upstream_silent(state, config, t_s):
        out.append(Reason.UPSTREAM_STALE)


def lateness(estimates: Estimates, config: PipelineConfig) -> float:
    """How late [s] the newest attitude, and for the hold the newest position, arrived."""
    attitude, position = estimates.attitude, estimates.position
    late_s = 0.0 if attitude is None else attitude.late_s
    if position is not None and position.late_s > late_s and config.base is _HOLD:
        return position.late_s
    return late_s


def upstream_silent(state: PipelineState, config: PipelineConfig, t_s: float) -> bool:
    """Whether the upstream controller has stopped."""
    return state.upstream is None or t_s - state.upstream.t_s > config.tuning.upstream_age_s


def _autopilot(out: list[Reason], state: PipelineState, heartbeat: Heartbeat, config: PipelineConfig) -> None:
    stack = stack_of(heartbeat)
    if stack is _OTHER:
        out.append(Reason.STACK_UNKNOWN)
    if not heartbeat.armed:
        out.append(Reason.NOT_ARMED)
    if not takes_setpoints(heartbeat):
        out.append(Reason.WRONG_MODE)
    if config.carrier is _ACCELERATION:
        if stack is Stack.ARDUPILOT:
            out.append(Reason.CARRIER_REFUSED)
        return
    meaning = thrust_meaning(heartbeat, state.parameters)
    if meaning is not _THRUST and stack is not _OTHER:
        out.append(_ABOUT_THRUST[meaning])


def _hold(out: list[Reason], state: PipelineState, config: PipelineConfig, t_s: float) -> None:
    """What the hold by itself needs: places, a margin, and before it engages the end of a take-off and a thrust."""
    tuning, position = config.tuning, state.estimates.position
    age_s = math.inf if position is None else t_s - position.t_s
    trusted = state.estimates.trust.trusted
    if age_s > tuning.position_age_s:
        out.append(Reason.POSITION_STALE)
    if not trusted:
        out.append(Reason.POSITION_UNTRUSTED)
    elif tuning.position_fade_age_s < age_s <= tuning.position_age_s:
        out.append(Reason.POSITION_OLD)
    if state.tuned is not None and not _firm_enough(state.tuned, tuning.hold, state.hold is not None):
        out.append(Reason.NO_MARGIN)
    if state.swing.level > tuning.swing_levels:
        out.append(Reason.SWINGS_ON)
    if state.hold is not None:
        return
    if not state.engagement.out_of_take_off:
        out.append(Reason.TAKING_OFF)
    elif config.carrier is Carrier.ATTITUDE:
        declared = config.vehicle.hover_thrust
        if not is_known(state.hover, t_s, state.parameters, declared, tuning):
            awaited = t_s - state.hover.now_s < tuning.hover_heard_age_s or hover_parameter(state.parameters) is None
            out.append(Reason.HOVER_UNKNOWN if awaited else Reason.HOVER_IMPLAUSIBLE)


def _firm_enough(tuned: HoldTuning, gains: HoldGains, engaged: bool) -> bool:
    """Whether the hold is stable, and no weaker than what would fly without it."""
    least = gains.kept_share if engaged else gains.least_share
    return tuned.margin.meets(gains.least_gain_margin, gains.least_phase_margin_deg) and tuned.share >= least


def _surfaces(out: list[Reason], disturbance: Disturbance, step_s: float, t_s: float) -> None:
    """Each refusal once, though several surfaces may have it."""
    for surface in (disturbance.ground, disturbance.wall, disturbance.ceiling):
        if not surface.known:
            reason = _ABOUT_RANGES[surface.seen]
        elif t_s - surface.stepped_s < step_s:
            reason = Reason.SURFACE_STEP
        elif surface.jumped:
            reason = Reason.RANGE_JUMPED
        else:
            continue
        if reason not in out:
            out.append(reason)
    if disturbance.trust <= 0.0:
        out.append(Reason.OUT_OF_DOMAIN)
