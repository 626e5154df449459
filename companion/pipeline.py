"""The pure heart, live and in replay: ``step(state, sample, config) -> (state, decision)``.

``step`` is ``answer`` and then ``settle``. Flight sends the setpoint between the two: what only later setpoints depend
on is worked out while this one is on its way.

No clock, no socket, no file. Time is the vehicle's boot axis, carried by the samples; without a sample nothing happens,
so no old output is ever sent again.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from companion.adaptation import adapt
from companion.adaptation.gates import Situation
from companion.adaptation.sizes import drag_prior
from companion.adaptation.steady import mass_flow
from companion.config import Base, Carrier, PipelineConfig
from companion.control import engagement, hover_thrust, landed, swing_detector
from companion.control.compensation import Offset, Offsets, fade, slewed, wanted_offset
from companion.control.engagement import waits_for_mode
from companion.control.hand_over import (
    HAND_OVER_S,
    NOT_OURS,
    begin_hand_over,
    hand_over_command,
    held_off,
    place_of,
)
from companion.control.hover_thrust import HoverThrust
from companion.control.landed import AIRBORNE_AFTER_S, IN_AIR
from companion.control.lateness import LATE_STOP_S, lateness
from companion.control.plant import FULL, hear_position
from companion.control.position_hold import (
    BaseSetpoint,
    Hold,
    Motion,
    balanced,
    engage,
    fly,
    settled_target,
    shifted,
)
from companion.control.position_target import Target, read_target, stay
from companion.control.reasons import HOLDS_BACK_EVERYTHING, Notice, Reason
from companion.control.refusals import refusals, upstream_silent
from companion.control.state import Decision, PipelineState
from companion.control.survey import Whereabouts, aborted, advance, as_message
from companion.control.wall_guard import level_wall, watch_wall
from companion.disturbance.model import modelled_disturbance
from companion.estimation import estimator as est
from companion.estimation import height_drift
from companion.estimation.estimates import blank_estimates
from companion.estimation.range_geometry import NO_MATTER_RADII
from companion.estimation.wall_drift import NO_WALL_DRIFT, compare_wall
from companion.mavlink import AUTOPILOT_COMPONENT, NO_AUTOPILOT, OWN_COMPONENT, samples
from companion.mavlink.firmware import (
    Stack,
    ThrustMap,
    mode_name,
    stack_of,
    takes_setpoints,
    thrust_map,
)
from companion.mavlink.samples import Sample
from companion.mavlink.setpoints import AttitudeCommand, Command, PositionCommand, tilt_by
from companion.settle import retuned, settle
from companion.survey_box import SurveyBox
from models.common.frames import GRAVITY, quaternion_from_euler
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3

_DISTURBANCE_PERIOD_S = 0.03
"""The model is asked this often, after a position, so that an attitude is answered without waiting for it."""
_SHORTEST_PERIOD_S = 1.0 / 110.0
"""Of decisions: a little above the 100 Hz that a companion link carries."""
_LIFT_TIME_S = 2.0
"""Over which the modelled lift of a flying vehicle is averaged before it is compared with the weight."""
_HOVER_CLIMB_M_S = 0.2
"""Faster than this vertically, the autopilot's thrust is no hover thrust."""
_UPSTREAM_DAMPING_1_S = 2.0
"""Of an upstream controller's velocity loop: ArduPilot's PSC_VELXY_P; PX4's MPC_XY_VEL_P_ACC is 1.8."""
_LEAST_THRUST_SHARE = 0.3
"""Of hover thrust: the hold never commands less, so that the attitude stays controllable."""
_MOST_THRUST_ABOVE_HOVER = 0.35
_RETURN_S = 10.0
_RETURN_M = 1.0
"""A hold that engages again so soon and so near goes back to the place that it had to leave."""
_SENSED = (est.Seen.SURFACE, est.Seen.NOTHING)
_NEAR_RADII = 4.0
"""Rotor radii from lip to wall within which its pull is felt: the models' data end at 3.8."""
MIN_THRUST = 0.05
MAX_THRUST = 0.95
"""Of the hold's commands."""
_REBOOT_S = 1.0
"""The autopilot's own stamps come in order to some 0.3 s: further back, its clock has started anew."""
_STAMPED = (samples.Attitude, samples.LocalPosition, samples.AttitudeTarget)
"""What carries the autopilot's own stamp of milliseconds and comes in order."""


def initial_state(config: PipelineConfig) -> PipelineState:
    """Nothing heard yet."""
    return PipelineState(
        estimates=blank_estimates(config.vehicle), adaptation=adapt.initial(config)
    )


def stopped(state: PipelineState) -> PipelineState:
    """Ask for the end: offsets fade, and the vehicle comes to rest where it is."""
    if state.hold is None:
        hold = None
    else:
        hold = state.hold._replace(target=stay(state.hold.target.yaw, state.t_s))
    return with_changes(state, stopping=True, hold=hold)


def ready_to_leave(state: PipelineState) -> bool:
    """After ``stopped``: whether offsets are gone and the vehicle is at rest, or not ours."""
    if state.offsets.authority > 0.0:
        return False
    position = state.estimates.position
    if state.hold is None or position is None:
        return state.hand_over is None
    moving = max(*map(abs, state.hold.reference.velocity), math.hypot(*position.velocity_ned))
    return moving < 0.1


def level_command(state: PipelineState, config: PipelineConfig) -> AttitudeCommand:
    """Level at hover thrust, heading as held."""
    if state.hold is None:
        yaw = 0.0
    else:
        yaw = state.hold.target.yaw
    return AttitudeCommand(
        state.t_s, quaternion_from_euler(0.0, 0.0, yaw), _thrust_map(state, config).hover
    )


def step(
    state: PipelineState, sample: Sample, config: PipelineConfig
) -> tuple[PipelineState, Decision | None]:
    """Take in one sample; decide where the sample calls for a decision."""
    state, decision = answer(state, sample, config)
    return settle(state, sample, decision, config), decision


def answer(
    state: PipelineState, sample: Sample, config: PipelineConfig
) -> tuple[PipelineState, Decision | None]:
    """What ``step`` decides, and the state for ``settle``, which is due before the next sample.

    A decision follows an attitude (``Base.HOLD``) or an upstream setpoint (``Base.UPSTREAM``; while upstream is silent,
    attitudes bring decisions that say so). Stamps of the autopilot that go back by more than a second are a reboot: all
    that was known is forgotten, except the wish to stop. A gap is none: what was learned stays.
    """
    if state.heartbeat is not None and state.t_s <= 0.0 < sample.t_s:
        # Heard before the first stamp, so at an unknown time, moments ago.
        state = with_changes(state, heartbeat=dataclasses.replace(state.heartbeat, t_s=sample.t_s))
    if isinstance(sample, _STAMPED):
        if sample.t_s < state.stamped_s - _REBOOT_S:
            state = with_changes(initial_state(config), stopping=state.stopping)
        newest = {
            samples.Attitude: state.estimates.attitude,
            samples.LocalPosition: state.estimates.position,
        }
        if (seen := newest.get(type(sample))) is not None and sample.t_s < seen.t_s:
            return state, None  # out of order: a newer one has been taken in
    state = _take(state, sample, config)
    if config.survey is not None:
        state = _surveyed(state, sample, config, config.survey)
    if (
        isinstance(sample, samples.LocalPosition)
        and sample.t_s - state.disturbance_s >= _DISTURBANCE_PERIOD_S
    ):
        state = _compared(_renew_disturbance(state, sample.t_s, config), config)
    if not _calls_for_decision(state, sample, config):
        return state, None
    return _decide(state, sample.t_s, config)


def _take(state: PipelineState, sample: Sample, config: PipelineConfig) -> PipelineState:
    now = max(state.t_s, sample.t_s)
    estimates = state.estimates
    match sample:
        case samples.Attitude():
            stamped_s = max(state.stamped_s, sample.t_s)
            estimates = est.take_attitude(estimates, sample)
            return with_changes(state, t_s=now, stamped_s=stamped_s, estimates=estimates)
        case samples.LocalPosition():
            return _take_position(state, sample, now)
        case samples.Range() | samples.Ring():
            return with_changes(state, t_s=now, estimates=est.take_range(estimates, sample, config))
        case samples.RotorSpeeds():
            return with_changes(
                state, t_s=now, estimates=est.take_rotors(estimates, sample, config)
            )
        case samples.ServoOutput() if sample.port == config.vehicle.servo_port:
            return with_changes(state, t_s=now, estimates=est.take_servo(estimates, sample, config))
        case samples.Heartbeat() if (
            sample.component == AUTOPILOT_COMPONENT and sample.autopilot != NO_AUTOPILOT
        ):
            seen = engagement.hear_heartbeat(state.engagement, sample)
            if seen.mode != state.engagement.mode:
                # Another mode, another beginning: a hold that swung under the last one may try again.
                state = with_changes(state, swing=swing_detector.SwingDetector(), left=None)
            return with_changes(state, t_s=now, heartbeat=sample, engagement=seen)
        case samples.Battery():
            return with_changes(state, t_s=now, estimates=with_changes(estimates, battery=sample))
        case samples.Pressure():
            return with_changes(state, t_s=now, estimates=with_changes(estimates, pressure=sample))
        case samples.EstimatorStatus():
            return with_changes(
                state,
                t_s=now,
                estimates=with_changes(estimates, trust=estimates.trust.after(sample)),
            )
        case samples.EscTemperatures():
            return with_changes(
                state, t_s=now, estimates=est.take_temperatures(estimates, sample.temperature_c)
            )
        case samples.AttitudeTarget():
            stamped_s = max(state.stamped_s, sample.t_s)
            hover = _learned_hover(state, sample)
            return with_changes(state, t_s=now, stamped_s=stamped_s, hover=hover)
        case samples.Imu() if state.adaptation is not None:
            here = Situation(
                estimates,
                state.disturbance,
                state.disturbance_s,
                state.air.since_s,
                state.air.landed_state,
            )
            return with_changes(
                state, adaptation=adapt.hear(state.adaptation, here, sample, config)
            )
        case samples.LandedState():
            return with_changes(
                state, t_s=now, air=state.air._replace(landed_state=sample.landed_state)
            )
        case _:
            return _take_request(state, sample, config)


def _take_position(
    state: PipelineState, sample: samples.LocalPosition, now_s: float
) -> PipelineState:
    hold = state.hold
    drift = height_drift.NO_DRIFT
    timing = hear_position(state.timing, sample.t_s, sample.late_s)
    if hold is not None:
        drift, sample = height_drift.hear(state.drift, sample)
    estimates = est.take_position(state.estimates, sample)
    stamped_s = max(state.stamped_s, sample.t_s)
    reset = estimates.reset
    if hold is not None and reset is not None and reset.t_s == sample.t_s:
        # The autopilot set its position anew: the hold point moves with it, the vehicle itself did not move.
        hold = shifted(hold, reset.by_ned)
    return with_changes(
        state,
        t_s=now_s,
        stamped_s=stamped_s,
        estimates=estimates,
        timing=timing,
        drift=drift,
        hold=hold,
    )


def _take_request(state: PipelineState, sample: Sample, config: PipelineConfig) -> PipelineState:
    """What others ask for: parameters' answers, targets for the hold, an upstream controller's setpoints."""
    match sample:
        case samples.Parameter():
            return with_changes(state, parameters={**state.parameters, sample.name: sample.value})
        case samples.SetPositionTarget() if sample.target_component == OWN_COMPONENT:
            return _retarget(state, sample)
        case samples.SetAttitudeTarget() if (
            config.base is Base.UPSTREAM and sample.component != OWN_COMPONENT
        ):
            return with_changes(state, upstream=sample)
    return state


def _surveyed(
    state: PipelineState, sample: Sample, config: PipelineConfig, box: SurveyBox
) -> PipelineState:
    """A survey moves the hold by the messages that a pilot would send; a pilot's own message ends it."""
    if isinstance(sample, samples.SetPositionTarget) and sample.target_component == OWN_COMPONENT:
        return with_changes(state, survey=aborted(state.survey, "a target came from outside"))
    position = state.estimates.position
    disturbance = state.disturbance
    if not isinstance(sample, samples.LocalPosition) or position is None:
        return state
    height = math.nan
    wall = math.nan
    towards = None
    if disturbance is not None:
        if disturbance.ground.known:
            height = min(disturbance.h_m)
        else:
            height = math.nan
        if disturbance.wall.known:
            wall = min(disturbance.d_m)
        else:
            wall = math.nan
        towards = level_wall(disturbance)
    seen = Whereabouts(
        t_s=sample.t_s,
        engaged=state.hold is not None,
        position=np.asarray(position.position_ned),
        height_m=height,
        wall_m=wall,
        towards=towards,
    )
    survey, wanted = advance(state.survey, box, seen)
    state = with_changes(state, survey=survey)
    if wanted is None:
        return state
    return _take(state, as_message(wanted, sample, OWN_COMPONENT), config)


def _compared(state: PipelineState, config: PipelineConfig) -> PipelineState:
    """The ranges to ground and wall beside the newest position, while the hold flies by it."""
    estimates = state.estimates
    disturbance = state.disturbance
    position = estimates.position
    reset = estimates.reset
    if state.hold is None or position is None:
        if state.wall_drift is NO_WALL_DRIFT:
            return state
        return with_changes(state, wall_drift=NO_WALL_DRIFT)
    t_s = position.t_s
    if disturbance is None:
        ground, wall = (est.surface(estimates, config, what, t_s) for what in ("ground", "wall"))
    else:
        ground = disturbance.ground
        wall = disturbance.wall
    near_m = NO_MATTER_RADII * config.vehicle.rotor_radius_m
    beside = compare_wall(
        state.wall_drift, wall, position, near_m, -math.inf if reset is None else reset.t_s
    )
    notice: tuple[Notice, float] | None
    if beside.drifts and not state.wall_drift.drifts:
        notice = (Notice.POSITION_DRIFTS, t_s)
    else:
        notice = state.notice
    drift = height_drift.compare(state.drift, ground, position)
    return with_changes(state, drift=drift, wall_drift=beside, notice=notice)


def _retarget(state: PipelineState, sample: samples.SetPositionTarget) -> PipelineState:
    """A target moves the hold that is engaged; one that came before is not kept."""
    position = state.estimates.position
    rows = state.estimates.rows
    if state.hold is None or state.stopping or position is None or rows is None:
        return state
    yaw = math.atan2(rows[1][0], rows[0][0])
    target = read_target(sample, state.hold.target, position.position_ned, yaw)
    if target is None:
        return with_changes(state, notice=(Notice.FRAME_REFUSED, sample.t_s))
    return with_changes(state, hold=state.hold._replace(target=target))


def _calls_for_decision(state: PipelineState, sample: Sample, config: PipelineConfig) -> bool:
    if isinstance(sample, samples.SetAttitudeTarget):
        return config.base is Base.UPSTREAM and sample.component != OWN_COMPONENT
    if not isinstance(sample, samples.Attitude):
        return False
    if config.base is Base.UPSTREAM and not upstream_silent(state, config, sample.t_s):
        return False
    return not 0.0 <= sample.t_s - state.decided_s < _SHORTEST_PERIOD_S


def _decide(
    state: PipelineState, t_s: float, config: PipelineConfig
) -> tuple[PipelineState, Decision]:
    dt = min(max(t_s - state.decided_s, 0.0), 0.1)
    if not 0.0 <= t_s - state.disturbance_s <= 2.0 * _DISTURBANCE_PERIOD_S:
        state = _renew_disturbance(state, t_s, config)
    late_s = lateness(state.estimates, config)
    if late_s > LATE_STOP_S:
        late_since_s = min(state.late_since_s, t_s)
    else:
        late_since_s = math.inf
    state = _airborne(state, config, t_s, late_since_s)
    if state.tuned is None:
        state = retuned(state, config, t_s)
    thrust = _thrust_map(state, config)
    reasons = refusals(state, config, t_s)
    held_back = {reason for reason in reasons if reason in HOLDS_BACK_EVERYTHING}

    had_hold = state.hold is not None
    state, base = _base(state, bool(held_back), thrust, config, t_s)
    before = state.offsets.applied
    state = with_changes(
        state,
        offsets=_offsets(
            state=state,
            base=base,
            reasons=reasons,
            held_back=bool(held_back),
            thrust=thrust,
            config=config,
            dt_s=dt,
        ),
    )
    applied = state.offsets.applied
    if reasons and not held_back:
        state = _keep_balance(state, before, applied, thrust, config)
    command: Command | None = None
    hand_over = None
    if held_back:
        if had_hold:
            state = _let_go(with_changes(state, left=_left(state, held_back, t_s)), held_back, t_s)
        command = _command_held_back(state, held_back, thrust, config, t_s)
        if command is not None:
            hand_over = state.hand_over
    elif base is not None:
        command = _command(state, base, applied, thrust, config, t_s)
    hold = None if held_back else state.hold
    state = with_changes(state, decided_s=t_s, hold=hold, hand_over=hand_over)
    return state, Decision(
        t_s=t_s,
        command=command,
        reasons=reasons,
        authority=state.offsets.authority,
        offset=applied,
        base=base,
        disturbance=state.disturbance,
        late_s=late_s,
        tuned=state.tuned if config.base is Base.HOLD else None,
        notice=state.notice,
        adaptation=state.adaptation,
    )


def _offsets(
    state: PipelineState,
    base: BaseSetpoint | None,
    reasons: tuple[Reason, ...],
    held_back: bool,
    thrust: ThrustMap,
    config: PipelineConfig,
    dt_s: float,
) -> Offsets:
    """The offset to apply, one step on."""
    old = state.offsets
    disturbance = state.disturbance
    rows = state.estimates.rows
    usable = disturbance is not None and not reasons
    wanted = old.wanted
    washout = old.washout
    if disturbance is not None and rows is not None and base is not None:
        fresh, washout = wanted_offset(
            disturbance=disturbance,
            washout=washout,
            config=config,
            thrust=thrust,
            base_thrust=base.thrust,
            rotation=rows,
            dt_s=dt_s,
        )
        if usable:
            wanted = fresh  # otherwise the last good one stays while the authority fades
    if usable:
        trusted = 1.0
    else:
        trusted = 0.0
    if held_back:
        authority = 0.0
    else:
        authority = fade(old.authority, trusted, dt_s)
    if authority > 0.0:
        offset = slewed(old.offset, wanted, config, dt_s)
    else:
        offset = Offset()
    # A fade adds to the slew of what fades: the sum is held to the slew rates too.
    if authority == 1.0:
        faded = offset
    else:
        faded = offset.scaled(authority)
    if held_back:
        applied = Offset()
    else:
        applied = slewed(old.applied, faded, config, dt_s)
    return Offsets(authority, offset, wanted, applied, washout)


def _renew_disturbance(state: PipelineState, t_s: float, config: PipelineConfig) -> PipelineState:
    rotors = est.rotor_speeds(state.estimates, config, t_s)
    rows = state.estimates.rows
    if rotors is None or rows is None:
        return with_changes(state, disturbance=None, disturbance_s=t_s)
    if state.adaptation is None:
        correction = None
    else:
        correction = state.adaptation.applied
    disturbance = modelled_disturbance(
        estimates=state.estimates,
        config=config,
        rotor_rpm=rotors,
        rotation=rows,
        t_s=t_s,
        damping_1_s=damping_1_s(state, config),
        correction=correction,
    )
    share = state.lift_share
    if state.air.flies(t_s):
        now = disturbance.free_lift_n / (config.vehicle.mass_kg * GRAVITY)
        share += min(max(t_s - state.disturbance_s, 0.0) / _LIFT_TIME_S, 1.0) * (now - share)
    return with_changes(state, disturbance=disturbance, disturbance_s=t_s, lift_share=share)


def damping_1_s(state: PipelineState, config: PipelineConfig) -> float:
    """Velocity damping of the loop in charge."""
    if config.base is Base.UPSTREAM:
        return _UPSTREAM_DAMPING_1_S
    return (FULL if state.tuned is None else state.tuned.gains).velocity_1_s


def _airborne(
    state: PipelineState, config: PipelineConfig, t_s: float, late_since_s: float
) -> PipelineState:
    """Whether the vehicle flies, and since when its telemetry is late."""
    position = state.estimates.position
    vehicle = config.vehicle
    notice = state.notice
    air = landed.watch(
        state.air,
        state.disturbance,
        vehicle.mass_kg * GRAVITY,
        t_s,
        telemetered=vehicle.telemetered,
        holding=state.hold is not None,
    )
    if air.overruled and (notice is None or notice[0] is not Notice.LANDED_OVERRULED):
        notice = (Notice.LANDED_OVERRULED, t_s)
    if position is None:
        climb = None
    else:
        climb = position.velocity_ned[2]
    seen = engagement.watch_take_off(state.engagement, t_s, climb, air)
    return with_changes(state, air=air, engagement=seen, notice=notice, late_since_s=late_since_s)


def _thrust_map(state: PipelineState, config: PipelineConfig) -> ThrustMap:
    hover = hover_thrust.best_hover(state.hover, state.parameters, config.vehicle.hover_thrust)
    return thrust_map(stack_of(state.heartbeat), state.parameters, hover)


def _learned_hover(state: PipelineState, sample: samples.AttitudeTarget) -> HoverThrust:
    """The autopilot's own hover command, free of what the ground gives, while it still flies by itself."""
    position = state.estimates.position
    heartbeat = state.heartbeat
    own = heartbeat is not None and (
        stack_of(heartbeat) is not Stack.PX4 or not takes_setpoints(heartbeat)
    )
    flying = own and state.hold is None and state.hand_over is None and state.upstream is None
    hovers = (
        flying
        and state.air.since_s < sample.t_s - AIRBORNE_AFTER_S
        and state.air.landed_state in (0, IN_AIR)
        and position is not None
        and abs(position.velocity_ned[2]) <= _HOVER_CLIMB_M_S
    )
    if not hovers:
        return hover_thrust.heard(state.hover, sample.t_s, sample.thrust)
    return hover_thrust.learn(
        state.hover, sample.t_s, sample.thrust, cushion=state.offsets.wanted.thrust
    )


def _base(
    state: PipelineState, held_back: bool, thrust: ThrustMap, config: PipelineConfig, t_s: float
) -> tuple[PipelineState, BaseSetpoint | None]:
    """The setpoint that the offset is added to, and the hold one step on."""
    if config.base is Base.UPSTREAM:
        upstream = state.upstream
        if upstream is None:
            return state, None
        return state, BaseSetpoint(math.nan, math.nan, math.nan, upstream.thrust)
    estimates = state.estimates
    if estimates.attitude is None or estimates.position is None or estimates.rows is None:
        return state, None
    if held_back:
        # Nothing flies, but the thrust it would ask for lets the report say what the offset would be.
        return state, BaseSetpoint(math.nan, math.nan, math.nan, thrust.hover)
    (north, _, x), (east, _, y), (_, _, z) = estimates.rows
    yaw = math.atan2(east, north)
    position = estimates.position
    authority = state.offsets.authority
    offset = state.offsets.offset
    seen = state.disturbance
    wall_ahead = watch_wall(state.wall_ahead, seen, position.velocity_ned, t_s)
    near_m = _NEAR_RADII * config.vehicle.rotor_radius_m
    clear_of_wall = seen is not None and seen.wall.seen in _SENSED and min(seen.d_m) > near_m
    pushed = _level_acceleration(offset.roll * authority, offset.pitch * authority, yaw)
    motion = Motion(
        position=position.position_ned,
        velocity=position.velocity_ned,
        body_down=(x, y, z),
        yaw=yaw,
        age_s=t_s - position.t_s,
        offset=pushed,
        wall=wall_ahead,
        clear=clear_of_wall,
        balance=state.balance.acceleration,
    )
    assert state.tuned is not None
    gains = state.tuned.gains
    hold = state.hold
    if hold is None:
        fresh = t_s - state.hover.now_s < hover_thrust.HEARD_AGE_S
        if fresh:
            thrust_now = state.hover.now
        else:
            thrust_now = thrust.hover
        balance = engagement.watch_balance(state.balance, t_s, motion.velocity, motion.body_down)
        vehicle = config.vehicle
        drag = (
            drag_prior(vehicle)[0] * mass_flow(vehicle, vehicle.mass_kg * GRAVITY) / vehicle.mass_kg
        )
        hold = engage(
            t_s=t_s,
            motion=motion,
            balance=balance.acceleration,
            thrust_now=thrust_now,
            thrust=thrust,
            lag_s=gains.lag_s,
            drag_1_s=drag,
        )
        hold = _returned(hold, state.left, motion.position, t_s)
    hold, base = fly(hold, gains, config.vehicle.limits, t_s, motion, thrust)
    return with_changes(state, hold=hold, wall_ahead=wall_ahead, left=None), base


def _left(state: PipelineState, held_back: set[Reason], t_s: float) -> tuple[Target, float] | None:
    """Where the hold that ends was to stay, unless others fly or the position is not to be believed."""
    if state.hold is None or held_back & (NOT_OURS | {Reason.POSITION_UNTRUSTED}):
        return None
    target = settled_target(state.hold)
    north, east, down = target.position
    return with_changes(target, position=(north, east, down - state.drift.correction_m)), t_s


def _returned(hold: Hold, left: tuple[Target, float] | None, position: Vector3, t_s: float) -> Hold:
    """A hold that was let go a moment ago goes on to where it was to stay: a stall is no new beginning."""
    if (
        left is None
        or not 0.0 <= t_s - left[1] <= _RETURN_S
        or math.dist(left[0].position, position) > _RETURN_M
    ):
        return hold
    return hold._replace(target=with_changes(left[0], set_s=t_s))


def _level_acceleration(roll: float, pitch: float, yaw: float) -> tuple[float, float]:
    """North and east [m/s^2]: what the tilt of an offset gives."""
    forward = -GRAVITY * math.tan(pitch)
    right = GRAVITY * math.tan(roll)
    c = math.cos(yaw)
    s = math.sin(yaw)
    return c * forward - s * right, s * forward + c * right


def _keep_balance(
    state: PipelineState, before: Offset, after: Offset, thrust: ThrustMap, config: PipelineConfig
) -> PipelineState:
    """What an offset that fades out balanced, the hold balances from here on: the air did not change with the input."""
    hold = state.hold
    rows = state.estimates.rows
    lost = before.thrust - after.thrust
    roll = before.roll - after.roll
    pitch = before.pitch - after.pitch
    if (
        hold is None
        or rows is None
        or config.carrier is not Carrier.ATTITUDE
        or lost == roll == pitch == 0.0
    ):
        return state
    north, east = _level_acceleration(roll, pitch, math.atan2(rows[1][0], rows[0][0]))
    down = -lost * thrust.slope * GRAVITY
    return with_changes(state, hold=balanced(hold, (north, east, down)))


def _let_go(state: PipelineState, held_back: set[Reason], t_s: float) -> PipelineState:
    assert state.hold is not None
    if state.last is None or not 0.0 <= t_s - state.decided_s <= HAND_OVER_S:
        return state  # after a gap the autopilot has long let go of what was sent last
    places = state.heartbeat is not None and mode_name(state.heartbeat) != "GUIDED_NOGPS"
    return with_changes(
        state,
        hand_over=begin_hand_over(
            state.last, held_back, t_s, places, hand_over_place(state, state.hold)
        ),
    )


def hand_over_place(state: PipelineState, hold: Hold) -> Vector3:
    """Where the autopilot is to stay when the hold ends, NED."""
    place = place_of(hold, state.drift.correction_m)
    towards = level_wall(state.disturbance)
    if towards is None:
        return place
    return held_off(place, state.balance.acceleration, towards)


def _command_held_back(
    state: PipelineState,
    held_back: set[Reason],
    thrust: ThrustMap,
    config: PipelineConfig,
    t_s: float,
) -> Command | None:
    """What is sent although nothing is compensated: the end of a hold, or what PX4 needs before OFFBOARD."""
    if state.hand_over is not None and not held_back & NOT_OURS:
        return hand_over_command(state.hand_over, thrust, held_back, t_s)
    rows = state.estimates.rows
    if not waits_for_mode(state.heartbeat, held_back) or rows is None:
        return None
    if config.base is Base.UPSTREAM:
        upstream = state.upstream
        assert upstream is not None
        return AttitudeCommand(
            t_s, upstream.q_ned_frd, upstream.thrust, upstream.type_mask, upstream.rates_frd
        )
    yaw = math.atan2(rows[1][0], rows[0][0])
    return AttitudeCommand(t_s, quaternion_from_euler(0.0, 0.0, yaw), thrust.hover)


def _command(
    state: PipelineState,
    base: BaseSetpoint,
    offset: Offset,
    thrust: ThrustMap,
    config: PipelineConfig,
    t_s: float,
) -> Command | None:
    if config.carrier is Carrier.ACCELERATION:
        if state.hold is None:
            return None
        place = place_of(state.hold, state.drift.correction_m)
        return PositionCommand(t_s, place, state.hold.target.yaw, offset.acceleration)
    floor = max(_LEAST_THRUST_SHARE * thrust.hover, MIN_THRUST)
    ceiling = min(thrust.hover + _MOST_THRUST_ABOVE_HOVER, MAX_THRUST)
    value = base.thrust + offset.thrust
    if config.base is Base.UPSTREAM:
        upstream = state.upstream
        assert upstream is not None
        # An upstream controller's own extremes are its business; the offset never goes past the limits.
        value = base.thrust + min(
            max(offset.thrust, min(floor - base.thrust, 0.0)), max(ceiling - base.thrust, 0.0)
        )
        q = tilt_by(upstream.q_ned_frd, offset.roll, offset.pitch)
        return AttitudeCommand(
            t_s, q, min(max(value, 0.0), 1.0), upstream.type_mask, upstream.rates_frd
        )
    q = quaternion_from_euler(base.roll, base.pitch, base.yaw)
    return AttitudeCommand(
        t_s, tilt_by(q, offset.roll, offset.pitch), min(max(value, floor), ceiling)
    )
