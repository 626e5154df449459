"""What an attitude changes for later setpoints only, worked out once its own is on its way: see ``pipeline.step``."""

from __future__ import annotations

import math

from companion.adaptation.adapt import learn
from companion.config import Base, PipelineConfig
from companion.control import attitude_response, engagement, swing_detector
from companion.control.plant import Source, declared_loop, hear_attitude, tune
from companion.control.position_hold import BaseSetpoint
from companion.control.reasons import Notice
from companion.control.state import Decision, PipelineState
from companion.mavlink.firmware import stack_of
from companion.mavlink.samples import Sample
from companion.mavlink.setpoints import AttitudeCommand, Command
from models.common.frozen_copy import with_changes

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
    adaptation = state.adaptation
    if estimates.attitude is not sample:
        return state
    if adaptation is not None and adaptation.full is not None:
        state = with_changes(state, adaptation=learn(adaptation, config))
    t_s = sample.t_s
    rows = estimates.rows
    assert rows is not None
    (_, _, x), (_, _, y), (sp, sr, z) = rows
    timing = state.timing
    balance = state.balance
    response = state.response
    timing = hear_attitude(timing, t_s)
    if estimates.position is not None:
        balance = engagement.watch_balance(balance, t_s, estimates.position.velocity_ned, (x, y, z))
    if config.base is not Base.HOLD:
        return with_changes(state, timing=timing, balance=balance)
    if not config.dry_run:
        response = attitude_response.hear_tilt(
            response, t_s, math.atan2(sr, z), -math.asin(min(max(sp, -1.0), 1.0))
        )
    state = with_changes(state, timing=timing, balance=balance, response=response)
    if decision is None:
        return state
    if state.hold is not None and decision.base is not None:  # it flies
        state = _remember(state, decision.base, decision.command, config)
        if not config.dry_run:
            state = _watch_swing(state, decision.base, t_s)
    return retuned(state, config, t_s)


def _remember(
    state: PipelineState, base: BaseSetpoint, command: Command | None, config: PipelineConfig
) -> PipelineState:
    """What letting go begins with, and what the attitude is to answer to."""
    if not isinstance(command, AttitudeCommand):
        return with_changes(state, last=base)
    roll = base.roll + state.offsets.applied.roll
    pitch = base.pitch + state.offsets.applied.pitch
    state = with_changes(
        state, last=BaseSetpoint(roll, pitch, base.yaw, command.thrust, base.acceleration)
    )
    if config.dry_run:
        return state
    return with_changes(
        state, response=attitude_response.sent(state.response, command.t_s, roll, pitch)
    )


def _watch_swing(state: PipelineState, base: BaseSetpoint, t_s: float) -> PipelineState:
    """A hold that swings by itself gets softer gains at once."""
    assert state.hold is not None
    (north, east, down), (x, y, z) = base.acceleration, state.hold.reference.acceleration
    swing = swing_detector.watch(state.swing, t_s, (north - x, east - y, down - z))
    if swing.level == state.swing.level:
        return with_changes(state, swing=swing)
    return with_changes(state, swing=swing, tuned_s=-math.inf, notice=(Notice.SOFTENED, t_s))


def retuned(state: PipelineState, config: PipelineConfig, t_s: float) -> PipelineState:
    """Gains for the plant as it is known now, once a second."""
    if 0.0 <= t_s - state.tuned_s < _TUNE_PERIOD_S or config.base is not Base.HOLD:
        return state
    state = with_changes(state, swing=swing_detector.calmed(state.swing, t_s))
    loop = attitude_response.measured_loop(state.response)
    if loop is None:  # too little to see now: what was measured stays true
        measured = state.loop.source is Source.MEASURED
        if measured:
            loop = state.loop
        else:
            loop = declared_loop(stack_of(state.heartbeat), state.parameters)
    elif state.loop.source is not Source.MEASURED:
        # A swing under gains for another loop says nothing about this one's.
        state = with_changes(state, swing=with_changes(state.swing, level=0))
    if (
        loop.source is state.loop.source
        and abs(loop.lag_s - state.loop.lag_s) < _OTHER_LAG * state.loop.lag_s
    ):
        loop = state.loop
    softer = _SOFTER ** min(state.swing.level, swing_detector.SWING_LEVELS)
    tuned = tune(loop, state.timing, softer)
    soft = min(tuned.share, tuned.climb_share)
    before = state.tuned
    if (
        state.swing.level == 0
        and soft < _SLOW_SHARE
        and (before is None or min(before.share, before.climb_share) >= _SLOW_SHARE)
    ):
        state = with_changes(state, notice=(Notice.SLOW_PLANT, t_s))
    return with_changes(state, loop=loop, tuned=tuned, tuned_s=t_s)
