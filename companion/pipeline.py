"""The pure heart, live and in replay: ``step(state, sample, config) -> (state, decision)``.

No clock, no socket, no file. Time is the vehicle's boot axis, carried by the samples; without a sample nothing happens,
so no old output is ever sent again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from companion.config import Base, Carrier, PipelineConfig, Tuning
from companion.control.authority import HOLDS_BACK_EVERYTHING, Reason, fade
from companion.control.compensation import MomentWashout, Offset, slewed, wanted_offset
from companion.control.disturbance import Push, modelled_push
from companion.control.position_hold import BaseSetpoint, Hold, engage, fly, retarget
from companion.estimation import estimator as est
from companion.estimation.estimator import Estimates, Seen, blank_estimates
from companion.mavlink.firmware import (
    Stack,
    ThrustMap,
    ThrustMeaning,
    stack_of,
    takes_setpoints,
    thrust_map,
    thrust_meaning,
)
from companion.mavlink.message_filter import OWN_COMPONENT
from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    Battery,
    EscHealth,
    EstimatorStatus,
    Heartbeat,
    LandedState,
    LocalPosition,
    Parameter,
    Pressure,
    Range,
    RotorSpeeds,
    Sample,
    ServoOutput,
    SetAttitudeTarget,
    SetPositionTarget,
)
from companion.mavlink.setpoints import AccelerationCommand, AttitudeCommand, Command, tilt_by
from models.evolve import replace
from models.frames import GRAVITY, quaternion_from_euler

_ON_GROUND, _IN_AIR = 1, 2
_REBOOT_S = 1.0
_AUTOPILOT_INVALID = 8
_REASONS_OF_OTHERS = frozenset({Reason.NOT_ARMED, Reason.WRONG_MODE, Reason.LANDED})
"""Refusals after which somebody else flies, or nobody does: no parting setpoint."""


@dataclass(frozen=True)
class PipelineState:
    """Everything remembered between samples."""

    estimates: Estimates
    t_s: float = -math.inf
    heartbeat: Heartbeat | None = None
    landed_state: int = 0
    parameters: Mapping[str, float] = field(default_factory=dict)
    hover_seen: float | None = None
    """Commanded thrust that hovers in free air, averaged while the autopilot flew."""
    airborne_since_s: float = math.inf
    carried_s: float = -math.inf
    """When the rotors last carried the weight, or the autopilot last said so."""
    upstream: SetAttitudeTarget | None = None
    hold: Hold | None = None
    target: SetPositionTarget | None = None
    authority: float = 0.0
    offset: Offset = Offset()
    wanted: Offset = Offset()
    washout: MomentWashout = MomentWashout()
    decided_s: float = -math.inf
    push: Push | None = None
    pushed_s: float = -math.inf
    """When ``push`` was computed: after a position, so that an attitude is answered without waiting for the model."""
    late_since_s: float = math.inf
    """Since when attitude or position have been too late to fly on; inf while they are not."""
    stopping: bool = False


@dataclass(frozen=True, slots=True)
class Decision:
    """What was decided at ``t_s``, and all that a pilot or an analyst wants to know about why."""

    t_s: float
    command: Command | None
    reasons: tuple[Reason, ...]
    authority: float
    offset: Offset
    """Applied: after trust, limits, slew and fade."""
    base: BaseSetpoint | None
    push: Push | None
    late_s: float = 0.0
    """How late the attitude or position behind it arrived."""


def initial_state(config: PipelineConfig) -> PipelineState:
    """Nothing heard yet."""
    return PipelineState(blank_estimates(config.vehicle))


def stopped(state: PipelineState) -> PipelineState:
    """Ask for a fade-out: from here on the offsets go to zero."""
    return replace(state, stopping=True)


def step(state: PipelineState, sample: Sample, config: PipelineConfig) -> tuple[PipelineState, Decision | None]:
    """Take in one sample; decide where the sample calls for a decision.

    A decision follows an attitude (``Base.HOLD``) or an upstream setpoint (``Base.UPSTREAM``; while upstream is silent,
    attitudes bring decisions that say so). A boot clock that goes back by more than a second is a reboot: all that was
    known is forgotten, except the wish to stop.
    """
    if sample.t_s < state.t_s - _REBOOT_S and not isinstance(sample, SetAttitudeTarget | SetPositionTarget):
        state = replace(initial_state(config), stopping=state.stopping)
    state = _take(state, sample, config)
    if isinstance(sample, LocalPosition) and sample.t_s - state.pushed_s >= config.tuning.push_period_s:
        state = _renew_push(state, sample.t_s, config)
    if not _calls_for_decision(state, sample, config):
        return state, None
    return _decide(state, sample.t_s, config)


def _take(state: PipelineState, sample: Sample, config: PipelineConfig) -> PipelineState:
    now = max(state.t_s, sample.t_s)
    estimates = state.estimates
    match sample:
        case Attitude():
            return replace(state, t_s=now, estimates=est.take_attitude(estimates, sample))
        case LocalPosition():
            state = replace(state, t_s=now, estimates=est.take_position(estimates, sample, config.tuning))
            return _follow_reset(state, sample.t_s)
        case Range():
            return replace(state, t_s=now, estimates=est.take_range(estimates, sample, config))
        case RotorSpeeds():
            return replace(state, t_s=now, estimates=est.take_rotors(estimates, sample, config))
        case ServoOutput() if sample.port == 0:
            return replace(state, t_s=now, estimates=est.take_servo(estimates, sample, config))
        case Heartbeat() if sample.component == 1 and sample.autopilot != _AUTOPILOT_INVALID:
            return replace(state, t_s=now, heartbeat=sample)
        case Battery():
            return replace(state, t_s=now, estimates=replace(estimates, battery=sample))
        case Pressure():
            return replace(state, t_s=now, estimates=replace(estimates, pressure=sample))
        case EstimatorStatus():
            return replace(state, t_s=now, estimates=replace(estimates, trust=estimates.trust.told(sample)))
        case EscHealth():
            return replace(state, t_s=now, estimates=est.take_health(estimates, sample))
        case AttitudeTarget():
            return replace(_learn_hover(state, sample, config.tuning), t_s=now)
        case LandedState():
            return replace(state, t_s=now, landed_state=sample.landed_state)
        case Parameter():
            return replace(state, parameters={**state.parameters, sample.name: sample.value})
        case SetPositionTarget() if sample.target_component == OWN_COMPONENT:
            hold = None if state.hold is None else _retarget(state.hold, sample)
            return replace(state, hold=hold, target=sample)
        case SetAttitudeTarget() if config.base is Base.UPSTREAM and sample.component != OWN_COMPONENT:
            return replace(state, upstream=sample)
    return state


def _follow_reset(state: PipelineState, t_s: float) -> PipelineState:
    """Where the autopilot's position was set anew, the hold point moves with it: the vehicle itself did not move."""
    reset, hold = state.estimates.reset, state.hold
    if reset is None or reset.t_s != t_s or hold is None:
        return state
    reference = replace(hold.reference, position=hold.reference.position + np.asarray(reset.by_ned))
    return replace(state, hold=replace(hold, reference=reference))


def _calls_for_decision(state: PipelineState, sample: Sample, config: PipelineConfig) -> bool:
    if isinstance(sample, SetAttitudeTarget):
        return config.base is Base.UPSTREAM and sample.component != OWN_COMPONENT
    if not isinstance(sample, Attitude):
        return False
    if config.base is Base.UPSTREAM and not _upstream_silent(state, config, sample.t_s):
        return False
    return not 0.0 <= sample.t_s - state.decided_s < 1.0 / config.tuning.max_decision_rate_hz


def _upstream_silent(state: PipelineState, config: PipelineConfig, t_s: float) -> bool:
    return state.upstream is None or t_s - state.upstream.t_s > config.tuning.upstream_age_s


def _decide(state: PipelineState, t_s: float, config: PipelineConfig) -> tuple[PipelineState, Decision]:
    tuning = config.tuning
    dt = min(max(t_s - state.decided_s, 0.0), 0.1)
    if not 0.0 <= t_s - state.pushed_s <= 2.0 * tuning.push_period_s:
        state = _renew_push(state, t_s, config)
    push, rotation = state.push, state.estimates.rotation
    state = _airborne(state, push, config, t_s)
    late_s = lateness(state.estimates, config)
    state = replace(state, late_since_s=min(state.late_since_s, t_s) if late_s > tuning.late_stop_s else math.inf)
    thrust = _thrust_map(state, config)
    reasons = _reasons(state, push, config, t_s)
    blocked = any(reason in HOLDS_BACK_EVERYTHING for reason in reasons)

    state, base = _base(state, blocked, thrust, config, t_s)
    usable = push is not None and not reasons
    wanted, washout = state.wanted, state.washout
    if push is not None and rotation is not None and base is not None:
        fresh, washout = wanted_offset(push, washout, config, thrust, base.thrust, rotation, dt)
        if usable:
            wanted = fresh  # otherwise the last good one stays while the authority fades
    trusted = 1.0 if usable else 0.0
    authority = 0.0 if blocked else fade(state.authority, trusted, dt, tuning.fade_in_s, tuning.fade_out_s)
    offset = slewed(state.offset, wanted, config, dt) if authority > 0.0 else Offset()
    applied = offset.scaled(authority)
    command = None
    if base is not None and not blocked:
        command = _command(state, base, applied, thrust, config, t_s)
    elif blocked and state.hold is not None and not _REASONS_OF_OTHERS.intersection(reasons):
        command = _parting(state.hold, thrust, t_s)
    state = replace(
        state, authority=authority, offset=offset, wanted=wanted, washout=washout, decided_s=t_s,
        hold=None if blocked else state.hold,
    )  # fmt: skip
    return state, Decision(t_s, command, reasons, authority, applied, base, push, late_s)


def lateness(estimates: Estimates, config: PipelineConfig) -> float:
    """How late [s] the newest attitude, and for the hold the newest position, arrived."""
    late_s = 0.0 if estimates.attitude is None else estimates.attitude.late_s
    if config.base is Base.HOLD and estimates.position is not None:
        late_s = max(late_s, estimates.position.late_s)
    return late_s


def _renew_push(state: PipelineState, t_s: float, config: PipelineConfig) -> PipelineState:
    rotors, rotation = est.rotor_speeds(state.estimates, config, t_s), state.estimates.rotation
    if rotors is None or rotation is None:
        return replace(state, push=None, pushed_s=t_s)
    push = modelled_push(state.estimates, config, rotors, rotation, t_s, config.damping_1_s)
    return replace(state, push=push, pushed_s=t_s)


def _reasons(state: PipelineState, push: Push | None, config: PipelineConfig, t_s: float) -> tuple[Reason, ...]:
    """Every refusal that holds now, gravest first."""
    out: list[Reason] = []
    estimates, tuning, heartbeat = state.estimates, config.tuning, state.heartbeat
    if heartbeat is None or t_s - heartbeat.t_s > tuning.heartbeat_age_s:
        out.append(Reason.NO_HEARTBEAT)
    else:
        out.extend(_autopilot_reasons(state, heartbeat, config))
    if estimates.attitude is None or t_s - estimates.attitude.t_s > tuning.attitude_age_s:
        out.append(Reason.ATTITUDE_STALE)
    if config.base is Base.HOLD and (
        estimates.position is None or t_s - estimates.position.t_s > tuning.position_age_s
    ):
        out.append(Reason.POSITION_STALE)
    elif config.base is Base.HOLD and not estimates.trust.trusted:
        out.append(Reason.POSITION_UNTRUSTED)
    if t_s - state.late_since_s >= tuning.late_stop_for_s:
        out.append(Reason.TOO_LATE)
    elif lateness(estimates, config) > tuning.late_fade_s:
        out.append(Reason.LATE)
    if config.base is Base.UPSTREAM and _upstream_silent(state, config, t_s):
        out.append(Reason.UPSTREAM_STALE)
    if t_s - state.airborne_since_s < tuning.airborne_after_s:
        out.append(Reason.LANDED)
    if push is None:
        out.append(Reason.RPM_MISSING)
    else:
        out.extend(_surface_reasons(push, tuning.surface_step_s, t_s))
    if estimates.rotation is not None and estimates.rotation[2, 2] < math.cos(tuning.max_tilt_rad):
        out.append(Reason.TILTED)
    if state.stopping:
        out.append(Reason.STOPPING)
    if not config.offsets:
        out.append(Reason.OFFSETS_OFF)
    return tuple(out)


def _autopilot_reasons(state: PipelineState, heartbeat: Heartbeat, config: PipelineConfig) -> list[Reason]:
    out: list[Reason] = []
    stack = stack_of(heartbeat)
    if stack is Stack.OTHER:
        out.append(Reason.STACK_UNKNOWN)
    if not heartbeat.armed:
        out.append(Reason.NOT_ARMED)
    # PX4 enters OFFBOARD only while a stream is already running, and ignores that stream until then.
    if not takes_setpoints(heartbeat) and stack is not Stack.PX4:
        out.append(Reason.WRONG_MODE)
    if config.carrier is Carrier.ACCELERATION:
        if stack is Stack.ARDUPILOT:
            out.append(Reason.CARRIER_REFUSED)
        return out
    meaning = thrust_meaning(heartbeat, state.parameters)
    refusal = {
        ThrustMeaning.CLIMB_RATE: Reason.THRUST_IS_CLIMB_RATE,
        ThrustMeaning.IGNORED: Reason.TYPE_IGNORED,
        ThrustMeaning.UNKNOWN: Reason.THRUST_UNKNOWN,
    }.get(meaning)
    if refusal is not None and stack is not Stack.OTHER:
        out.append(refusal)
    return out


def _surface_reasons(push: Push, step_s: float, t_s: float) -> list[Reason]:
    out: list[Reason] = []
    for surface in (push.ground, push.wall, push.ceiling):
        if surface.seen is Seen.MISSING:
            out.append(Reason.RANGE_MISSING)
        elif surface.seen is Seen.STALE:
            out.append(Reason.RANGE_STALE)
        elif surface.seen is Seen.LOST:
            out.append(Reason.RANGE_LOST)
        elif surface.seen is Seen.FROZEN:
            out.append(Reason.RANGE_FROZEN)
        elif t_s - surface.stepped_s < step_s:
            out.append(Reason.SURFACE_STEP)
    if push.trust <= 0.0:
        out.append(Reason.OUT_OF_DOMAIN)
    return list(dict.fromkeys(out))


def _airborne(state: PipelineState, push: Push | None, config: PipelineConfig, t_s: float) -> PipelineState:
    """The autopilot's own land detector decides; where it says nothing, the rotors must carry the weight to lift off.

    In the air a low lift alone is no landing (a hard descent has it too): taking it for one would stop the stream.
    """
    weight = config.vehicle.mass_kg * GRAVITY
    carries = push is not None and push.free_lift_n > config.tuning.airborne_lift_share * weight
    if carries or state.landed_state == _IN_AIR:
        state = replace(state, carried_s=t_s)
    if state.landed_state == _ON_GROUND:
        return replace(state, airborne_since_s=math.inf)
    if state.airborne_since_s == math.inf:
        return replace(state, airborne_since_s=t_s) if state.carried_s == t_s else state
    idle = state.landed_state == 0 and t_s - state.carried_s > config.tuning.idle_is_landed_s
    return replace(state, airborne_since_s=math.inf) if idle else state


def _thrust_map(state: PipelineState, config: PipelineConfig) -> ThrustMap:
    stack = Stack.OTHER if state.heartbeat is None else stack_of(state.heartbeat)
    hover = state.hover_seen
    if hover is None:
        named = state.parameters.get("MOT_THST_HOVER", state.parameters.get("MPC_THR_HOVER"))
        hover = config.vehicle.hover_thrust if named is None else named
    return thrust_map(stack, state.parameters, hover)


def _learn_hover(state: PipelineState, sample: AttitudeTarget, tuning: Tuning) -> PipelineState:
    """Average the autopilot's own hover command, free of what the ground gives, while it still flies by itself."""
    position = state.estimates.position
    flying = state.hold is None and state.upstream is None and state.airborne_since_s < sample.t_s - 1.0
    if (
        not flying
        or position is None
        or abs(position.velocity_ned[2]) > tuning.hover_climb_m_s
        or not 0.05 < sample.thrust < 0.95
    ):
        return state
    free = sample.thrust - state.wanted.thrust
    if state.hover_seen is None:
        return replace(state, hover_seen=free)
    share = min(max(sample.t_s - state.t_s, 0.0), 0.1) / tuning.hover_mean_s
    return replace(state, hover_seen=state.hover_seen + max(share, 0.005) * (free - state.hover_seen))


def _base(
    state: PipelineState, blocked: bool, thrust: ThrustMap, config: PipelineConfig, t_s: float
) -> tuple[PipelineState, BaseSetpoint | None]:
    """The setpoint that the offset is added to, and the hold one step on."""
    if config.base is Base.UPSTREAM:
        upstream = state.upstream
        if upstream is None:
            return state, None
        return state, BaseSetpoint(math.nan, math.nan, math.nan, upstream.thrust)
    estimates = state.estimates
    if estimates.attitude is None or estimates.position is None or estimates.rotation is None:
        return state, None
    if blocked:
        # Nothing flies, but the thrust it would ask for lets the report say what the offset would be.
        return state, BaseSetpoint(math.nan, math.nan, math.nan, thrust.hover)
    position = np.asarray(estimates.position.position_ned)
    velocity = np.asarray(estimates.position.velocity_ned)
    body_down = estimates.rotation[:, 2]
    gains = config.tuning.hold
    hold = state.hold
    if hold is None:
        yaw = math.atan2(estimates.rotation[1, 0], estimates.rotation[0, 0])
        hold = engage(t_s, position, yaw, body_down)
        if state.target is not None and t_s - state.target.t_s < gains.target_age_s:
            hold = _retarget(hold, state.target)
    hold, base = fly(hold, gains, t_s, position, velocity, body_down, thrust)
    return replace(state, hold=hold), base


def _parting(hold: Hold, thrust: ThrustMap, t_s: float) -> AttitudeCommand:
    """The last setpoint before silence: the autopilot holds it for all of GUID_TIMEOUT, so it is level, at hover."""
    return AttitudeCommand(t_s, quaternion_from_euler(0.0, 0.0, hold.reference.yaw), thrust.hover)


def _retarget(hold: Hold, sample: SetPositionTarget) -> Hold:
    """Position bits 1+2+4, velocity bits 8+16+32, yaw bit 1024 of the mask ignore their parts (MAVLink)."""
    mask = sample.type_mask
    position = None if mask & 7 or not np.isfinite(sample.position).all() else np.asarray(sample.position)
    velocity = None if mask & 56 or not np.isfinite(sample.velocity).all() else np.asarray(sample.velocity)
    yaw = None if mask & 1024 or not math.isfinite(sample.yaw) else sample.yaw
    return retarget(hold, sample.t_s, position, velocity, yaw)


def _command(
    state: PipelineState, base: BaseSetpoint, offset: Offset, thrust: ThrustMap, config: PipelineConfig, t_s: float
) -> Command | None:
    if config.carrier is Carrier.ACCELERATION:
        if state.hold is None:
            return None
        reference = state.hold.reference
        north, east, down = map(float, reference.position)
        return AccelerationCommand(t_s, (north, east, down), offset.acceleration, reference.yaw)
    tuning = config.tuning
    floor = max(tuning.min_thrust_share * thrust.hover, tuning.min_thrust)
    ceiling = min(thrust.hover + tuning.max_thrust_above_hover, tuning.max_thrust)
    value = base.thrust + offset.thrust
    if config.base is Base.UPSTREAM:
        upstream = state.upstream
        assert upstream is not None
        # An upstream controller's own extremes are its business; the offset never pushes past the limits.
        value = base.thrust + min(max(offset.thrust, min(floor - base.thrust, 0.0)), max(ceiling - base.thrust, 0.0))
        return AttitudeCommand(
            t_s,
            tilt_by(upstream.q_ned_frd, offset.roll, offset.pitch),
            min(max(value, 0.0), 1.0),
            upstream.type_mask,
            upstream.rates_frd,
        )
    q = quaternion_from_euler(base.roll, base.pitch, base.yaw)
    return AttitudeCommand(t_s, tilt_by(q, offset.roll, offset.pitch), min(max(value, floor), ceiling))
