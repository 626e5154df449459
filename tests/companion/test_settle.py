"""What is worked out after a setpoint has left: averages, swings and gains, and nothing after other messages."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

from flying import bench, with_plant

from companion.config import PipelineConfig
from companion.control.reasons import Notice
from companion.mavlink.samples import Attitude, LandedState
from companion.pipeline import answer
from companion.settle import retuned, settle
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState


@cache
def flying() -> tuple[PipelineState, PipelineConfig]:
    b = bench()
    b.run(3.0)
    return b.state, b.config


SAMPLE = Attitude(0.0, 1, 1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION")


def answered() -> tuple[PipelineState, Attitude, Decision | None, PipelineConfig]:
    """After a decision, before its work is done."""
    state, config = flying()
    sample = replace(SAMPLE, t_s=state.t_s + 0.02)
    state, decision = answer(state, sample, config)
    return state, sample, decision, config


def test_other_messages_and_an_attitude_that_was_overtaken_change_nothing() -> None:
    state, config = flying()
    assert settle(state, LandedState(state.t_s, 1, 1, 2), None, config) is state
    overtaken = replace(SAMPLE, t_s=state.t_s - 0.1)
    state, decision = answer(state, overtaken, config)
    assert decision is None
    assert settle(state, overtaken, decision, config) is state


def test_an_attitude_and_its_setpoint_are_taken_in() -> None:
    done = settle(*answered())
    assert done.plant.response.commands[-1][0] == done.t_s, (
        "the setpoint that the attitude is to answer"
    )


def test_a_dry_run_commands_nothing_that_an_attitude_could_answer() -> None:
    state, sample, decision, config = answered()
    done = settle(state, sample, decision, replace(config, dry_run=True))
    assert done.plant.response.commands == state.plant.response.commands


def test_gains_are_chosen_once_a_second() -> None:
    state, config = flying()
    assert retuned(state, config, state.plant.tuned_s + 0.9) is state
    assert (
        retuned(state, config, state.plant.tuned_s + 1.0).plant.tuned_s == state.plant.tuned_s + 1.0
    )


def test_a_swing_softens_the_gains_at_once_and_is_said() -> None:
    state, config = flying()
    firm = retuned(with_plant(state, tuned_s=-math.inf), config, state.t_s)
    swing = replace(firm.plant.swing, level=1, stepped_s=state.t_s, swung_s=state.t_s)
    swung = with_plant(firm, swing=swing, tuned_s=-math.inf)
    soft = retuned(swung, config, state.t_s)
    assert firm.plant.tuned is not None
    assert soft.plant.tuned is not None
    assert soft.plant.tuned.share < firm.plant.tuned.share
    assert soft.notice != (Notice.SLOW_PLANT, state.t_s), (
        "gains that a swing made soft say nothing of the vehicle"
    )
