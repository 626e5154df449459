"""What is worked out after a setpoint has left: averages, swings and gains, and nothing where nothing is pending."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

from flying import bench

from companion.config import PipelineConfig
from companion.control.authority import Notice
from companion.control.state import Pending, PipelineState
from companion.mavlink.samples import Attitude
from companion.pipeline import answer
from companion.settle import retuned, settle


@cache
def flying() -> tuple[PipelineState, PipelineConfig]:
    b = bench()
    b.run(3.0)
    return b.state, b.config


def answered() -> tuple[PipelineState, PipelineConfig]:
    """After a decision, before its work is done."""
    state, config = flying()
    sample = Attitude(state.t_s + 0.02, 1, 1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION")
    return answer(state, sample, config)[0], config


def test_nothing_pending_changes_nothing() -> None:
    state, config = flying()
    assert state.pending is None
    assert settle(state, config) is state


def test_what_is_pending_is_taken_in_once() -> None:
    state, config = answered()
    assert isinstance(state.pending, Pending)
    done = settle(state, config)
    assert done.pending is None
    assert done.response.commands[-1][0] == state.t_s, "the setpoint that the attitude is to answer"
    assert settle(done, config) is done


def test_a_dry_run_commands_nothing_that_an_attitude_could_answer() -> None:
    state, config = answered()
    done = settle(state, replace(config, dry_run=True))
    assert done.response.commands == state.response.commands
    assert done.pending is None


def test_gains_are_chosen_once_a_second() -> None:
    state, config = flying()
    assert retuned(state, config, state.tuned_s + 0.9) is state
    assert retuned(state, config, state.tuned_s + 1.0).tuned_s == state.tuned_s + 1.0


def test_a_swing_softens_the_gains_at_once_and_is_said() -> None:
    state, config = flying()
    firm = retuned(replace(state, tuned_s=-math.inf), config, state.t_s)
    swung = replace(firm, swing=replace(firm.swing, level=1, stepped_s=state.t_s, swung_s=state.t_s), tuned_s=-math.inf)
    soft = retuned(swung, config, state.t_s)
    assert firm.tuned is not None
    assert soft.tuned is not None
    assert soft.tuned.share < firm.tuned.share
    assert soft.notice != (Notice.SLOW_PLANT, state.t_s), "gains that a swing made soft say nothing of the vehicle"
