"""From the state to a decision: reasons, base, offsets, and the end of a hold."""

from __future__ import annotations

import math

from companion.adaptation.sizes import drag_prior
from companion.adaptation.steady import mass_flow
from companion.commands import command_held_back, command_of, hand_over_place, thrust_map_of
from companion.config import Base, Carrier, PipelineConfig
from companion.control import engagement, hover_thrust, landed
from companion.control.compensation import Offset, Offsets, fade, slewed, wanted_offset
from companion.control.hand_over import (
    HAND_OVER_S,
    NOT_OURS,
    begin_hand_over,
)
from companion.control.lateness import LATE_STOP_S, lateness
from companion.control.position_hold import (
    BaseSetpoint,
    Hold,
    Motion,
    balanced,
    engage,
    fly,
    settled_target,
)
from companion.control.position_target import Target
from companion.control.reasons import HOLDS_BACK_EVERYTHING, Notice, Reason
from companion.control.refusals import refusals, upstream_silent
from companion.control.state import Decision, PipelineState
from companion.control.wall_guard import watch_wall
from companion.estimation import estimator as est
from companion.mavlink import OWN_COMPONENT, samples
from companion.mavlink.firmware import (
    ThrustMap,
    mode_name,
)
from companion.mavlink.samples import Sample
from companion.mavlink.setpoints import Command
from companion.settle import retuned
from companion.surroundings import DISTURBANCE_PERIOD_S, renew_disturbance
from models.common.frames import GRAVITY
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3

_SHORTEST_PERIOD_S = 1.0 / 110.0
"""Of decisions: a little above the 100 Hz that a companion link carries."""
_RETURN_S = 10.0
_RETURN_M = 1.0
"""A hold that engages again so soon and so near goes back to the place that it had to leave."""
_SENSED = (est.Seen.SURFACE, est.Seen.NOTHING)
_NEAR_RADII = 4.0
"""Rotor radii from lip to wall within which its pull is felt: the models' data end at 3.8."""


def calls_for_decision(state: PipelineState, sample: Sample, config: PipelineConfig) -> bool:
    """Whether a setpoint is due: after an attitude, or after a setpoint of the upstream controller."""
    if isinstance(sample, samples.SetAttitudeTarget):
        return config.base is Base.UPSTREAM and sample.component != OWN_COMPONENT
    if not isinstance(sample, samples.Attitude):
        return False
    if config.base is Base.UPSTREAM and not upstream_silent(state, config, sample.t_s):
        return False
    return not 0.0 <= sample.t_s - state.decided_s < _SHORTEST_PERIOD_S


def decide(
    state: PipelineState, t_s: float, config: PipelineConfig
) -> tuple[PipelineState, Decision]:
    """The disturbance, what forbids an offset, the base, the offset, and the command of both."""
    dt = min(max(t_s - state.decided_s, 0.0), 0.1)
    if not 0.0 <= t_s - state.disturbance_s <= 2.0 * DISTURBANCE_PERIOD_S:
        state = renew_disturbance(state, t_s, config)
    late_s = lateness(state.estimates, config)
    if late_s > LATE_STOP_S:
        late_since_s = min(state.late_since_s, t_s)
    else:
        late_since_s = math.inf
    state = _airborne(state, config, t_s, late_since_s)
    if state.tuned is None:
        state = retuned(state, config, t_s)
    thrust = thrust_map_of(state, config)
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
        command = command_held_back(state, held_back, thrust, config, t_s)
        if command is not None:
            hand_over = state.hand_over
    elif base is not None:
        command = command_of(state, base, applied, thrust, config, t_s)
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
