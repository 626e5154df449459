"""From the state to a decision: reasons, base, offsets, and the end of a hold."""

from __future__ import annotations

import math

from companion.adaptation.sizes import drag_prior
from companion.adaptation.steady import mass_flow
from companion.commands import command_held_back, command_of, hand_over_place, thrust_map_of
from companion.config import Base, Carrier, PipelineConfig
from companion.control import engagement, hover_thrust, landed
from companion.control.compensation import Offset, next_offsets
from companion.control.hand_over import (
    HAND_OVER_S,
    NOT_OURS,
    HandOver,
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
from companion.control.wall_distance import WallPlane, kept_off, see_wall, sent_to_m
from companion.control.wall_guard import watch_wall
from companion.disturbance.wall_law import NEAR_RADII
from companion.estimation import estimator as est
from companion.estimation.height_drift import HeightDrift
from companion.mavlink import OWN_COMPONENT, samples
from companion.mavlink.firmware import (
    ThrustMap,
    mode_name,
)
from companion.mavlink.samples import Sample
from companion.mavlink.setpoints import Command
from companion.refusals import refusals, upstream_silent
from companion.settle import retuned
from companion.state.decision import Decision
from companion.state.held import Held
from companion.state.pipeline_state import PipelineState
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
_SAID_AGAIN_S = 30.0
"""A notice that is still true is said again after so long."""


def calls_for_decision(state: PipelineState, sample: Sample, config: PipelineConfig) -> bool:
    """Whether a setpoint is due: after an attitude, or after a setpoint of the upstream controller."""
    if isinstance(sample, samples.SetAttitudeTarget):
        return config.base is Base.UPSTREAM and sample.component != OWN_COMPONENT
    if not isinstance(sample, samples.Attitude):
        return False
    if config.base is Base.UPSTREAM and not upstream_silent(state, sample.t_s):
        return False
    return not 0.0 <= sample.t_s - state.sending.decided_s < _SHORTEST_PERIOD_S


def decide(
    state: PipelineState, t_s: float, config: PipelineConfig
) -> tuple[PipelineState, Decision]:
    """The disturbance, what forbids an offset, the base, the offset, and the command of both."""
    dt = min(max(t_s - state.sending.decided_s, 0.0), 0.1)
    if not 0.0 <= t_s - state.air.disturbance_s <= 2.0 * DISTURBANCE_PERIOD_S:
        state = renew_disturbance(state, t_s, config)
    late_s = lateness(state.estimates, config)
    state = _watched(state, late_s, t_s, config)
    if state.plant.tuned is None:
        state = retuned(state, config, t_s)
    thrust = thrust_map_of(state, config)
    reasons = refusals(state, config, t_s)
    held_back = {reason for reason in reasons if reason in HOLDS_BACK_EVERYTHING}

    held, base = _base(state, bool(held_back), thrust, config, t_s)
    state = _told(state, held, t_s)
    offsets = next_offsets(
        state.sending.offsets,
        state.air.disturbance,
        config,
        thrust,
        base_thrust=None if base is None else base.thrust,
        rotation=state.estimates.rows,
        refused=bool(reasons),
        held_back=bool(held_back),
        dt_s=dt,
    )
    if reasons and not held_back:
        held = _keep_balance(state, held, offsets.applied, thrust, config)
    command: Command | None = None
    hand_over = None
    if held_back:
        held, hand_over = _ended(state, held, held_back, t_s)
        command = command_held_back(state, hand_over, held_back, thrust, config, t_s)
        if command is None:
            hand_over = None
    elif base is not None:
        command = command_of(
            state=state,
            hold=held.hold,
            base=base,
            offset=offsets.applied,
            thrust=thrust,
            config=config,
            t_s=t_s,
        )
    sending = with_changes(state.sending, offsets=offsets, decided_s=t_s, hand_over=hand_over)
    state = with_changes(state, held=held, sending=sending)
    return state, Decision(
        t_s=t_s,
        command=command,
        reasons=reasons,
        authority=offsets.authority,
        offset=offsets.applied,
        base=base,
        disturbance=state.air.disturbance,
        late_s=late_s,
        tuned=state.plant.tuned if config.base is Base.HOLD else None,
        notice=state.notice,
        adaptation=state.learned.adaptation,
    )


def _told(state: PipelineState, held: Held, t_s: float) -> PipelineState:
    """The state with a notice, where a target led nearer to the wall than the loop holds: not said again at once."""
    notice = state.notice
    if held.target_wall_m == state.held.target_wall_m:
        return state
    if notice is not None and notice[0] is Notice.WALL_LEAST and t_s - notice[1] < _SAID_AGAIN_S:
        return state
    return with_changes(state, notice=(Notice.WALL_LEAST, t_s))


def _watched(
    state: PipelineState, late_s: float, t_s: float, config: PipelineConfig
) -> PipelineState:
    """Whether the vehicle flies, and since when its telemetry is late."""
    heard = state.heard
    position = state.estimates.position
    vehicle = config.vehicle
    notice = state.notice
    airborne = landed.watch(
        state.air.airborne,
        state.air.disturbance,
        vehicle.mass_kg * GRAVITY,
        t_s,
        telemetered=vehicle.telemetered,
        holding=state.held.hold is not None,
    )
    if airborne.overruled and (notice is None or notice[0] is not Notice.LANDED_OVERRULED):
        notice = (Notice.LANDED_OVERRULED, t_s)
    if position is None:
        climb = None
    else:
        climb = position.velocity_ned[2]
    seen = engagement.watch_take_off(heard.engagement, t_s, climb, airborne)
    if late_s > LATE_STOP_S:
        late_since_s = min(heard.late_since_s, t_s)
    else:
        late_since_s = math.inf
    if seen is not heard.engagement or late_since_s != heard.late_since_s:
        heard = with_changes(heard, engagement=seen, late_since_s=late_since_s)
    air = with_changes(state.air, airborne=airborne)
    return with_changes(state, heard=heard, air=air, notice=notice)


def _base(
    state: PipelineState, held_back: bool, thrust: ThrustMap, config: PipelineConfig, t_s: float
) -> tuple[Held, BaseSetpoint | None]:
    """The hold one step on, and the setpoint that the offset is added to."""
    held = state.held
    if config.base is Base.UPSTREAM:
        upstream = state.requests.upstream
        if upstream is None:
            return held, None
        return held, BaseSetpoint(math.nan, math.nan, math.nan, upstream.thrust)
    estimates = state.estimates
    if estimates.attitude is None or estimates.position is None or estimates.rows is None:
        return held, None
    if held_back:
        # Nothing flies, but the thrust it would ask for lets the report say what the offset would be.
        return held, BaseSetpoint(math.nan, math.nan, math.nan, thrust.hover)
    (north, _, x), (east, _, y), (_, _, z) = estimates.rows
    yaw = math.atan2(east, north)
    position = estimates.position
    authority = state.sending.offsets.authority
    offset = state.sending.offsets.offset
    seen = state.air.disturbance
    wall_ahead = watch_wall(held.wall_ahead, seen, position.velocity_ned, t_s)
    near_m = NEAR_RADII * config.vehicle.rotor_radius_m
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
        balance=state.learned.balance.acceleration,
    )
    assert state.plant.tuned is not None
    tuned = state.plant.tuned
    hold = held.hold
    if hold is None:
        hold = _engaged(state, motion, thrust, config, t_s)
    wall = see_wall(held.wall, seen, position, t_s)
    hold, target_wall_m = _off_the_wall(hold, wall, tuned.least_wall_m, held.target_wall_m)
    hold, base = fly(hold, tuned.gains, config.vehicle.limits, t_s, motion, thrust)
    held = with_changes(
        held, hold=hold, wall=wall, target_wall_m=target_wall_m, wall_ahead=wall_ahead, left=None
    )
    return held, base


def _engaged(
    state: PipelineState, motion: Motion, thrust: ThrustMap, config: PipelineConfig, t_s: float
) -> Hold:
    """A hold that begins here, or goes back to the place that it had to leave."""
    assert state.plant.tuned is not None
    hover = state.learned.hover
    vehicle = config.vehicle
    if t_s - hover.now_s < hover_thrust.HEARD_AGE_S:
        thrust_now = hover.now
    else:
        thrust_now = thrust.hover
    balance = engagement.watch_balance(
        state.learned.balance, t_s, motion.velocity, motion.body_down
    )
    drag = drag_prior(vehicle)[0] * mass_flow(vehicle, vehicle.mass_kg * GRAVITY) / vehicle.mass_kg
    hold = engage(
        t_s=t_s,
        motion=motion,
        balance=balance.acceleration,
        thrust_now=thrust_now,
        thrust=thrust,
        lag_s=state.plant.tuned.gains.lag_s,
        drag_1_s=drag,
    )
    return _returned(hold, state.held.left, motion.position, t_s)


def _off_the_wall(
    hold: Hold, wall: WallPlane | None, least_m: float, before_m: float
) -> tuple[Hold, float]:
    """The hold with a target no nearer to the wall than its gains hold the pull, and how near it was last sent."""
    if wall is None or least_m <= 0.0:
        return hold, before_m
    kept = kept_off(hold, wall, least_m)
    if kept is hold:
        return hold, before_m
    return kept, sent_to_m(hold, wall)


def _ended(
    state: PipelineState, held: Held, held_back: set[Reason], t_s: float
) -> tuple[Held, HandOver | None]:
    """Without a hold, and what goes on in its place."""
    hold = held.hold
    if hold is None:
        return held, state.sending.hand_over
    held = with_changes(held, hold=None, left=_left(hold, held.drift, held_back, t_s))
    return held, _let_go(state, hold, held_back, t_s)


def _left(
    hold: Hold, drift: HeightDrift, held_back: set[Reason], t_s: float
) -> tuple[Target, float] | None:
    """Where the hold that ends was to stay, unless others fly or the position is not to be believed."""
    if held_back & (NOT_OURS | {Reason.POSITION_UNTRUSTED}):
        return None
    target = settled_target(hold)
    north, east, down = target.position
    return with_changes(target, position=(north, east, down - drift.correction_m)), t_s


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
    state: PipelineState, held: Held, after: Offset, thrust: ThrustMap, config: PipelineConfig
) -> Held:
    """What an offset that fades out balanced, the hold balances from here on: the air did not change with the input."""
    rows = state.estimates.rows
    before = state.sending.offsets.applied
    lost = before.thrust - after.thrust
    roll = before.roll - after.roll
    pitch = before.pitch - after.pitch
    if (
        held.hold is None
        or rows is None
        or config.carrier is not Carrier.ATTITUDE
        or lost == roll == pitch == 0.0
    ):
        return held
    north, east = _level_acceleration(roll, pitch, math.atan2(rows[1][0], rows[0][0]))
    down = -lost * thrust.slope * GRAVITY
    return with_changes(held, hold=balanced(held.hold, (north, east, down)))


def _let_go(
    state: PipelineState, hold: Hold, held_back: set[Reason], t_s: float
) -> HandOver | None:
    """What goes on in place of a hold that ends."""
    sending = state.sending
    if sending.last is None or not 0.0 <= t_s - sending.decided_s <= HAND_OVER_S:
        return sending.hand_over  # after a gap the autopilot has long let go of what was sent last
    heartbeat = state.heard.heartbeat
    places = heartbeat is not None and mode_name(heartbeat) != "GUIDED_NOGPS"
    return begin_hand_over(
        last=sending.last,
        refusals=held_back,
        t_s=t_s,
        listens_to_places=places,
        place=hand_over_place(state, hold),
    )
