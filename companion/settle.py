"""What an attitude changes for later setpoints only, worked out once its own is on its way: see ``pipeline.step``."""

from __future__ import annotations

import math

from companion.adaptation.learn import learn
from companion.config import Base, PipelineConfig
from companion.control import attitude_response, engagement, swing_detector
from companion.control.attitude_response import AttitudeResponse
from companion.control.compensation import Offset
from companion.control.plant import HoldTuning, Source, declared_loop, hear_attitude, tune
from companion.control.position_hold import BaseSetpoint, Hold
from companion.control.reasons import Notice
from companion.control.wall_stability import beside_wall
from companion.mavlink.samples import Sample
from companion.mavlink.setpoints import AttitudeCommand, Command
from companion.state.decision import Decision
from companion.state.learned import Learned
from companion.state.pipeline_state import PipelineState
from companion.surroundings import wall_law_now
from models.common.frames import Rows
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3

_TUNE_PERIOD_S = 1.0
"""A plant does not change faster, and choosing gains takes milliseconds where it is new."""
_SLOW_SHARE = 0.6
"""Softer gains than this are reported to the pilot: the hold is then looser than the autopilot's own."""
_SOFTER = 0.6
"""Of the gains, after each swing that was noticed."""
_OTHER_LAG = 0.15
"""A measured attitude loop counts once its lag is this share off the one in use: noise changes no gains."""


def settle(
    state: PipelineState, sample: Sample, decision: Decision | None, config: PipelineConfig
) -> PipelineState:
    """Take an attitude, and the setpoint that answered it, into averages, measured loop, swings and gains."""
    estimates = state.estimates
    if estimates.attitude is not sample:
        return state
    t_s = sample.t_s
    plant = state.plant
    timing = hear_attitude(plant.timing, t_s)
    response = plant.response
    swing = plant.swing
    tuned_s = plant.tuned_s
    sending = state.sending
    notice = state.notice
    hold = state.held.hold
    holds = config.base is Base.HOLD
    measures = holds and not config.dry_run
    if measures:
        assert estimates.rows is not None
        response = _heard_tilt(response, t_s, estimates.rows)
    if holds and hold is not None and decision is not None and decision.base is not None:
        last = _sent(decision.base, decision.command, sending.offsets.applied)
        sending = with_changes(sending, last=last)
        if measures:
            response = _answering(response, last, decision.command)
            swing = swing_detector.watch(swing, t_s, _feedback(hold, decision.base))
        if swing.level != plant.swing.level:  # softer gains at once
            tuned_s = -math.inf
            notice = (Notice.SOFTENED, t_s)
    state = with_changes(
        state,
        learned=_learned(state, t_s, config),
        plant=with_changes(plant, timing=timing, response=response, swing=swing, tuned_s=tuned_s),
        sending=sending,
        notice=notice,
    )
    if decision is None:
        return state
    return retuned(state, config, t_s)


def _learned(state: PipelineState, t_s: float, config: PipelineConfig) -> Learned:
    """Sizes and balance with the newest attitude taken in."""
    learned = state.learned
    adaptation = learned.adaptation
    balance = learned.balance
    position = state.estimates.position
    rows = state.estimates.rows
    assert rows is not None
    if adaptation is not None and adaptation.full is not None:
        adaptation = learn(adaptation, config)
    if position is not None:
        down = (rows[0][2], rows[1][2], rows[2][2])
        balance = engagement.watch_balance(balance, t_s, position.velocity_ned, down)
    return with_changes(learned, adaptation=adaptation, balance=balance)


def _heard_tilt(response: AttitudeResponse, t_s: float, rows: Rows) -> AttitudeResponse:
    """The measured tilt of an attitude."""
    forward, right, down = rows[2]
    roll = math.atan2(right, down)
    pitch = -math.asin(min(max(forward, -1.0), 1.0))
    return attitude_response.hear_tilt(response, t_s, roll, pitch)


def _sent(base: BaseSetpoint, command: Command | None, applied: Offset) -> BaseSetpoint:
    """What letting go begins with: the setpoint with its offset."""
    if not isinstance(command, AttitudeCommand):
        return base
    return BaseSetpoint(
        roll=base.roll + applied.roll,
        pitch=base.pitch + applied.pitch,
        yaw=base.yaw,
        thrust=command.thrust,
        acceleration=base.acceleration,
    )


def _answering(
    response: AttitudeResponse, sent: BaseSetpoint, command: Command | None
) -> AttitudeResponse:
    """The tilt that the attitude is to answer to."""
    if not isinstance(command, AttitudeCommand):
        return response
    return attitude_response.sent(response, command.t_s, sent.roll, sent.pitch)


def _feedback(hold: Hold, base: BaseSetpoint) -> Vector3:
    """The acceleration [m/s^2, NED] that the hold asks for beyond its reference's own."""
    north, east, down = base.acceleration
    forward_n, forward_e, forward_d = hold.reference.acceleration
    return north - forward_n, east - forward_e, down - forward_d


def retuned(state: PipelineState, config: PipelineConfig, t_s: float) -> PipelineState:
    """Gains for the plant as it is known now, once a second."""
    plant = state.plant
    if 0.0 <= t_s - plant.tuned_s < _TUNE_PERIOD_S or config.base is not Base.HOLD:
        return state
    swing = swing_detector.calmed(plant.swing, t_s)
    known = plant.loop
    loop = attitude_response.measured_loop(plant.response)
    if loop is None:  # too little to see now: what was measured stays true
        if known.source is Source.MEASURED:
            loop = known
        else:
            loop = declared_loop(state.heard.stack, state.heard.parameters)
    elif known.source is not Source.MEASURED:
        # A swing under gains for another loop says nothing about this one's.
        swing = with_changes(swing, level=0)
    if loop.source is known.source and abs(loop.lag_s - known.lag_s) < _OTHER_LAG * known.lag_s:
        loop = known
    softer = _SOFTER ** min(swing.level, swing_detector.SWING_LEVELS)
    tuned = tune(loop, plant.timing, softer)
    law = wall_law_now(state, config, t_s)
    if law is not None:
        tuned = beside_wall(tuned, law)
    notice = state.notice
    if swing.level == 0 and _is_slow(tuned) and (plant.tuned is None or not _is_slow(plant.tuned)):
        notice = (Notice.SLOW_PLANT, t_s)
    plant = with_changes(plant, swing=swing, loop=loop, tuned=tuned, tuned_s=t_s)
    return with_changes(state, plant=plant, notice=notice)


def _is_slow(tuned: HoldTuning) -> bool:
    """Whether the gains are so soft that the pilot is told."""
    return min(tuned.share, tuned.climb_share) < _SLOW_SHARE
