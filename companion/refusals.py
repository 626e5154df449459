"""Every refusal that holds now, gravest first."""

from __future__ import annotations

import math

from companion.config import Base, Carrier, PipelineConfig
from companion.control.hover_thrust import HEARD_AGE_S, hover_parameter, is_known
from companion.control.lateness import LATE_FADE_S, LATE_STOP_FOR_S, lateness
from companion.control.plant import HoldTuning, Margin
from companion.control.reasons import REASON_OF_SIGHT, Reason
from companion.control.swing_detector import SWING_LEVELS
from companion.disturbance.records import Disturbance
from companion.estimation.estimates import ATTITUDE_AGE_S, POSITION_AGE_S
from companion.estimation.height_drift import FADE_M_S
from companion.estimation.rotors import ROTOR_AGE_S
from companion.mavlink.firmware import Stack, ThrustMeaning
from companion.state.heard import Heard
from companion.state.pipeline_state import PipelineState
from models.surrogate.empty import is_empty
from models.vehicle.lift_ratio import IN_FLIGHT

_ABOUT_THRUST = {
    ThrustMeaning.CLIMB_RATE: Reason.THRUST_IS_CLIMB_RATE,
    ThrustMeaning.IGNORED: Reason.TYPE_IGNORED,
    ThrustMeaning.UNKNOWN: Reason.THRUST_UNKNOWN,
}

_HEARTBEAT_AGE_S = 3.0
"""Three heartbeats at the 1 Hz of the protocol."""
_POSITION_FADE_AGE_S = 0.28
"""Older than this the offsets fade, before the hold lets go. Above the 0.2 s of positions at 5 Hz."""
_UPSTREAM_AGE_S = 0.5
_MOST_TILT_COS = math.cos(math.radians(25.0))
"""Beyond, the small-angle law of the offsets no longer holds: they fade."""
_SWING_PAUSE_S = 6.0
"""Offsets stay away for so long after a swing."""
_LEAST = Margin(gain=1.25, phase_deg=10.0)
"""With less than this at the softest gains there is no hold."""
_LEAST_SHARE = 0.42
"""Of the full gains, to engage: softer, the hold is weaker than an autopilot's own (ArduPilot's PSC_POSXY_P 1.0 times
PSC_VELXY_P 2.0 is 2 1/s^2), and a wall's pull grows faster than it holds."""
_KEPT_SHARE = 0.35
"""The same for a hold that flies already."""


def refusals(state: PipelineState, config: PipelineConfig, t_s: float) -> tuple[Reason, ...]:
    """Why nothing is sent, or why offsets fade."""
    out: list[Reason] = []
    estimates = state.estimates
    heartbeat = state.heard.heartbeat
    disturbance = state.air.disturbance
    holds = config.base is Base.HOLD
    if heartbeat is None or t_s - heartbeat.t_s > _HEARTBEAT_AGE_S:
        out.append(Reason.NO_HEARTBEAT)
    else:
        _autopilot(out, state.heard, heartbeat.armed, config)
    _arrivals(out, state, config, t_s)
    if not state.air.airborne.flies(t_s):
        out.append(Reason.LANDED)
    if holds:
        _hold(out, state, config, t_s)
    if disturbance is None:
        out.append(Reason.RPM_MISSING)
    else:
        _surfaces(out, disturbance, t_s)
    if state.held.drift.drifts and abs(state.held.drift.rate_m_s) >= FADE_M_S:
        out.append(Reason.HEIGHT_DRIFTS)
    if estimates.rows is not None and estimates.rows[2][2] < _MOST_TILT_COS:
        out.append(Reason.TILTED)
    if holds and t_s - state.plant.swing.swung_s < _SWING_PAUSE_S:
        out.append(Reason.SWINGING)
    if state.requests.stopping:
        out.append(Reason.STOPPING)
    low, high = IN_FLIGHT
    if not low <= state.air.lift_share <= high:
        out.append(Reason.MODEL_WRONG)
    if t_s - estimates.undeclared_s < ROTOR_AGE_S:
        out.append(Reason.ROTORS_WRONG)
    if not config.offsets:
        out.append(Reason.OFFSETS_OFF)
    elif is_empty(config.model) and not _measured(state):
        out.append(Reason.NO_MODEL)
    return tuple(out)


def _measured(state: PipelineState) -> bool:
    """Whether this flight has measured anything of ground and wall."""
    adaptation = state.learned.adaptation
    return adaptation is not None and not adaptation.applied.near.is_nothing


def _arrivals(out: list[Reason], state: PipelineState, config: PipelineConfig, t_s: float) -> None:
    """What does not come, or comes late."""
    estimates = state.estimates
    if estimates.attitude is None or t_s - estimates.attitude.t_s > ATTITUDE_AGE_S:
        out.append(Reason.ATTITUDE_STALE)
    if t_s - state.heard.late_since_s >= LATE_STOP_FOR_S:
        out.append(Reason.TOO_LATE)
    elif lateness(estimates, config) > LATE_FADE_S:
        out.append(Reason.LATE)
    if config.base is Base.UPSTREAM and upstream_silent(state, t_s):
        out.append(Reason.UPSTREAM_STALE)


def upstream_silent(state: PipelineState, t_s: float) -> bool:
    """Whether the upstream controller has stopped."""
    return state.requests.upstream is None or t_s - state.requests.upstream.t_s > _UPSTREAM_AGE_S


def _autopilot(out: list[Reason], heard: Heard, armed: bool, config: PipelineConfig) -> None:
    """What firmware, mode and parameters do not allow."""
    stack = heard.stack
    if stack is Stack.OTHER:
        out.append(Reason.STACK_UNKNOWN)
    if not armed:
        out.append(Reason.NOT_ARMED)
    if not heard.takes_setpoints:
        out.append(Reason.WRONG_MODE)
    if config.carrier is Carrier.ACCELERATION:
        if stack is Stack.ARDUPILOT:
            out.append(Reason.CARRIER_REFUSED)
        return
    meaning = heard.thrust_meaning
    if meaning is not ThrustMeaning.THRUST and stack is not Stack.OTHER:
        out.append(_ABOUT_THRUST[meaning])


def _hold(out: list[Reason], state: PipelineState, config: PipelineConfig, t_s: float) -> None:
    """What the hold by itself needs: places, a margin, and before it engages the end of a take-off and a thrust."""
    position = state.estimates.position
    if position is None:
        age_s = math.inf
    else:
        age_s = t_s - position.t_s
    trusted = state.estimates.trust.trusted
    if age_s > POSITION_AGE_S:
        out.append(Reason.POSITION_STALE)
    if not trusted:
        out.append(Reason.POSITION_UNTRUSTED)
    elif _POSITION_FADE_AGE_S < age_s <= POSITION_AGE_S:
        out.append(Reason.POSITION_OLD)
    if state.plant.tuned is not None and not _firm_enough(
        state.plant.tuned, state.held.hold is not None
    ):
        out.append(Reason.NO_MARGIN)
    if state.plant.swing.level > SWING_LEVELS:
        out.append(Reason.SWINGS_ON)
    if state.held.hold is not None:
        return
    if not state.heard.engagement.out_of_take_off:
        out.append(Reason.TAKING_OFF)
    elif config.carrier is Carrier.ATTITUDE:
        declared = config.vehicle.hover_thrust
        if not is_known(state.learned.hover, t_s, state.heard.parameters, declared):
            awaited = (
                t_s - state.learned.hover.now_s < HEARD_AGE_S
                or hover_parameter(state.heard.parameters) is None
            )
            out.append(Reason.HOVER_UNKNOWN if awaited else Reason.HOVER_IMPLAUSIBLE)


def _firm_enough(tuned: HoldTuning, engaged: bool) -> bool:
    """Whether the hold is stable, and no weaker than what would fly without it."""
    return tuned.margin.meets(_LEAST) and tuned.share >= (_KEPT_SHARE if engaged else _LEAST_SHARE)


def _surfaces(out: list[Reason], disturbance: Disturbance, t_s: float) -> None:
    """Each refusal once, though several surfaces may have it."""
    for surface in (disturbance.ground, disturbance.wall, disturbance.ceiling):
        reason = REASON_OF_SIGHT.get(surface.seen)
        if reason is None and surface.stepped(t_s):
            reason = Reason.SURFACE_STEP
        elif reason is None and surface.jumped:
            reason = Reason.RANGE_JUMPED
        if reason is not None and reason not in out:
            out.append(reason)
    if disturbance.trust <= 0.0:
        out.append(Reason.OUT_OF_DOMAIN)
