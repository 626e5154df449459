"""Every refusal by its own cause: one thing is changed in the state of a hold that flies with its offsets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
from flying import bench

from companion.config import PipelineConfig
from companion.control.lateness import lateness
from companion.control.reasons import Reason
from companion.control.swing_detector import SWING_LEVELS
from companion.estimation.surfaces import Seen, Surface
from companion.refusals import refusals
from companion.state.pipeline_state import PipelineState

Change = Callable[[PipelineState], PipelineState]


@cache
def flying() -> tuple[PipelineState, PipelineConfig]:
    """State and configuration after four seconds of hover in the corner."""
    b = bench()
    b.run(4.0)
    return b.state, b.config


def of(path: str, **changes: object) -> Change:
    """A change of one record of the state, named as ``air.disturbance``."""
    return lambda s: changed(s, path.split("."), changes)


def changed(record: Any, path: list[str], changes: dict[str, object]) -> Any:
    """The record with these changes in the record at ``path``."""
    if path:
        first, *rest = path
        changes = {first: changed(getattr(record, first), rest, changes)}
    if isinstance(record, tuple):
        return record._replace(**changes)
    return replace(record, **changes)


def late(seconds: float) -> Change:
    """The newest attitude arrived so late."""
    return of("estimates.attitude", late_s=seconds)


CAUSES: dict[Reason, Change] = {
    Reason.NO_HEARTBEAT: of("heard", heartbeat=None),
    Reason.NOT_ARMED: of("heard.heartbeat", armed=False),
    Reason.WRONG_MODE: of("heard.heartbeat", custom_mode=5),
    Reason.STACK_UNKNOWN: of("heard.heartbeat", autopilot=0),
    Reason.THRUST_UNKNOWN: of("heard", parameters={}),
    Reason.THRUST_IS_CLIMB_RATE: of("heard", parameters={"GUID_OPTIONS": 0.0}),
    Reason.LANDED: of("air.airborne", landed_state=1, since_s=float("inf")),
    Reason.ATTITUDE_STALE: of("estimates", attitude=None),
    Reason.LATE: late(0.16),
    Reason.TOO_LATE: lambda s: of("heard", late_since_s=s.t_s - 10.0)(s),
    Reason.POSITION_STALE: of("estimates", position=None),
    Reason.NO_MARGIN: of("plant.tuned", share=0.3),
    Reason.SWINGS_ON: of("plant.swing", level=SWING_LEVELS + 1),
    Reason.SWINGING: lambda s: of("plant.swing", swung_s=s.t_s)(s),
    Reason.RPM_MISSING: of("air", disturbance=None),
    Reason.OUT_OF_DOMAIN: of("air.disturbance", trust=0.0),
    Reason.RANGE_MISSING: of("air.disturbance", ground=Surface(Seen.MISSING)),
    Reason.RANGE_LOST: of("air.disturbance", wall=Surface(Seen.LOST)),
    Reason.MODEL_WRONG: of("air", lift_share=1.7),
    Reason.ROTORS_WRONG: lambda s: of("estimates", undeclared_s=s.t_s)(s),
    Reason.STOPPING: of("requests", stopping=True),
}


def test_a_hold_that_flies_near_ground_and_wall_refuses_nothing() -> None:
    state, config = flying()
    assert state.held.hold is not None
    assert refusals(state, config, state.t_s) == ()


@pytest.mark.parametrize("reason", CAUSES, ids=lambda r: r.name)
def test_one_cause_gives_its_own_refusal_and_no_other(reason: Reason) -> None:
    state, config = flying()
    assert refusals(CAUSES[reason](state), config, state.t_s) == (reason,)


def test_several_surfaces_that_are_lost_are_said_once() -> None:
    state, config = flying()
    lost = of("air.disturbance", ground=Surface(Seen.LOST), wall=Surface(Seen.LOST))(state)
    assert refusals(lost, config, state.t_s) == (Reason.RANGE_LOST,)


def test_offsets_that_are_off_are_said_before_a_model_that_is_missing() -> None:
    state, config = flying()
    assert refusals(state, replace(config, offsets=False), state.t_s) == (Reason.OFFSETS_OFF,)


def test_the_later_of_attitude_and_position_counts_for_the_hold() -> None:
    state, config = flying()
    assert state.estimates.position is not None
    old = replace(state.estimates, position=replace(state.estimates.position, late_s=0.3))
    assert lateness(old, config) == 0.3
    assert lateness(late(0.4)(state).estimates, config) == 0.4
