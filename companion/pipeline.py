"""The pure heart, live and in replay: ``step(state, sample, config) -> (state, decision)``.

``step`` is ``answer`` and then ``settle``. Flight sends the setpoint between the two: what only later setpoints depend
on is worked out while this one is on its way.

No clock, no socket, no file. Time is the vehicle's boot axis, carried by the samples; without a sample nothing happens,
so no old output is ever sent again.
"""

from __future__ import annotations

import math

from companion.commands import MAX_THRUST, MIN_THRUST, hand_over_place, level_command
from companion.config import PipelineConfig
from companion.control.position_target import stay
from companion.decide import calls_for_decision, decide
from companion.intake import initial_state, take_in
from companion.mavlink.samples import Sample
from companion.settle import settle
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState
from companion.surroundings import damping_1_s
from models.common.frozen_copy import with_changes

__all__ = [
    "MAX_THRUST",
    "MIN_THRUST",
    "answer",
    "damping_1_s",
    "hand_over_place",
    "initial_state",
    "level_command",
    "ready_to_leave",
    "step",
    "stopped",
]


def stopped(state: PipelineState) -> PipelineState:
    """Ask for the end: offsets fade, and the vehicle comes to rest where it is."""
    requests = with_changes(state.requests, stopping=True)
    held = state.held
    hold = held.hold
    if hold is not None:
        rest = stay(hold.target.yaw, state.t_s)
        held = with_changes(held, hold=hold._replace(target=rest))
    return with_changes(state, requests=requests, held=held)


def ready_to_leave(state: PipelineState) -> bool:
    """After ``stopped``: whether offsets are gone and the vehicle is at rest, or not ours."""
    if state.sending.offsets.authority > 0.0:
        return False
    position = state.estimates.position
    hold = state.held.hold
    if hold is None or position is None:
        return state.sending.hand_over is None
    moving = max(*map(abs, hold.reference.velocity), math.hypot(*position.velocity_ned))
    return moving < 0.1


def step(
    state: PipelineState, sample: Sample, config: PipelineConfig
) -> tuple[PipelineState, Decision | None]:
    """Take in one sample; decide where the sample calls for a decision.

    Parameters
    ----------
    state : PipelineState
        What was known before; it is not changed.
    sample : Sample
        A message of the autopilot, as a record of ``companion.mavlink.samples``: SI, NED and FRD.
    config : PipelineConfig
        The same through a flight.

    Returns
    -------
    state : PipelineState
        What is known now.
    decision : Decision or None
        None where the sample calls for no decision.

    Examples
    --------
    >>> import companion, models
    >>> from companion.mavlink.samples import Battery
    >>> from companion.vehicles import default_vehicle
    >>> config = companion.PipelineConfig(vehicle=default_vehicle(), model=models.load())
    >>> state = companion.initial_state(config)
    >>> heard = Battery(1.0, 1, 1, voltage_v=24.0, current_a=20.0, source="battery")
    >>> state, decision = companion.step(state, heard, config)
    >>> decision is None
    True
    """
    state, decision = answer(state, sample, config)
    return settle(state, sample, decision, config), decision


def answer(
    state: PipelineState, sample: Sample, config: PipelineConfig
) -> tuple[PipelineState, Decision | None]:
    """What ``step`` decides, and the state for ``settle``, which is due before the next sample.

    A decision follows an attitude (``Base.HOLD``) or an upstream setpoint (``Base.UPSTREAM``; while upstream is silent,
    attitudes bring decisions that say so).
    """
    state, news = take_in(state, sample, config)
    if not news or not calls_for_decision(state, sample, config):
        return state, None
    return decide(state, sample.t_s, config)
