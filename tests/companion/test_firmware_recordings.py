"""Recordings of real firmwares, fed through the pipeline: what is decided where a flight ended on the ground."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import models
from companion.config import PipelineConfig
from companion.control.plant import Margin
from companion.control.reasons import Notice, Reason
from companion.mavlink.setpoints import AttitudeCommand
from companion.pipeline import initial_state, step
from companion.state.decision import Decision
from models.vehicle import load_vehicle
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay


def recording(shared_data: Path, name: str, *, begun: bool = False) -> list[Decision]:
    """Decisions of a recording; ``begun``: up to the first that is flown."""
    log = shared_data / "firmware" / f"{name}.tlog"
    vehicle = log.parent / ("quad.toml" if log.parent.name == "px4" else "quad3.toml")
    if not log.exists():
        pytest.skip(f"no recording at {log}")
    config = PipelineConfig(vehicle=load_vehicle(vehicle), model=models.load())
    decisions = []
    for decision in Replay(config).decisions(read_tlog(log).frames()):
        decisions.append(decision)
        if begun and flown([decision]):
            break
    return decisions


def stepped(shared_data: Path, name: str):
    """State and decision after every sample of a recording."""
    log = shared_data / "firmware" / f"{name}.tlog"
    if not log.exists():
        pytest.skip(f"no recording at {log}")
    config = PipelineConfig(
        vehicle=load_vehicle(next(log.parent.glob("quad*.toml"))), model=models.load()
    )
    replayed, state = Replay(config), initial_state(config)
    for sample in replayed._sampled(read_tlog(log).frames()):
        state, decision = step(state, sample, config)
        yield state, decision


def flown(decisions: list[Decision]) -> list[Decision]:
    """Those that compensate or hold, in a mode that listens."""
    return [
        d
        for d in decisions
        if Reason.WRONG_MODE not in d.reasons and isinstance(d.command, AttitudeCommand)
    ]


def test_px4_excursion_before_offboard(shared_data):
    """The pilot was 4 m away when he switched: nothing leads back to where the companion was started."""
    decisions = recording(shared_data, "px4/crash_hold_engaged_before_offboard", begun=True)
    waiting = [
        d
        for d in decisions
        if Reason.WRONG_MODE in d.reasons and d.command is not None and d.t_s < 36.0
    ]
    assert len(waiting) > 100, "OFFBOARD needs a stream"
    for decision in waiting:
        w, x, y, z = decision.command.q_ned_frd
        assert abs(x) < 1e-9
        assert abs(y) < 1e-9
        assert decision.command.thrust == pytest.approx(0.49, abs=0.02)
        assert w * w + z * z == pytest.approx(1.0)
    first = flown(decisions)[0]
    assert first.t_s == pytest.approx(36.2, abs=0.3)
    assert first.command.thrust == pytest.approx(0.48, abs=0.02), "0.476 flies at that instant"


@pytest.mark.slow
def test_px4_default_hover_thrust(shared_data):
    """MPC_THR_HOVER 0.5 where 0.70 flies, and OFFBOARD a second after the companion's start: refused and said."""
    decisions = recording(shared_data, "px4/crash_default_hover_thrust")
    assert not flown(decisions)
    assert sum(Reason.HOVER_UNKNOWN in d.reasons for d in decisions) > 500


def test_px4_stall(shared_data):
    """SIGSTOP for 3 s: what was learned is still known, and flown, when data come again."""
    engaged = []
    for state, decision in stepped(shared_data, "px4/crash_companion_stalled_3s"):
        if decision is not None and decision.t_s >= 50.0:
            break
        if decision is not None and decision.t_s > 48.5:
            assert state.learned.hover.learned == pytest.approx(0.70, abs=0.01)
            assert state.heard.parameters["MPC_THR_HOVER"] == pytest.approx(0.70)
            engaged.append(isinstance(decision.command, AttitudeCommand))
    assert any(engaged), "it engages anew"


@pytest.mark.slow
def test_ardupilot_slow_loop_with_positions_at_10_hz(shared_data):
    """The recorded swing that ended on the ground is noticed; gains soften step by step, then the hold lets go."""
    decisions = recording(shared_data, "ardupilot/crash_slow_loop_10hz_position")
    softened = {
        d.notice[1] for d in decisions if d.notice is not None and d.notice[0] is Notice.SOFTENED
    }
    assert 1 <= len(softened) <= 6
    assert any(Reason.SWINGING in d.reasons for d in decisions)


GOOD = (
    "ardupilot/approach_offsets_off",
    "ardupilot/approach_amended_model",
    "px4/corner_offsets_off",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", GOOD)
def test_a_good_flight_is_not_taken_for_a_swing(shared_data, name):
    decisions = recording(shared_data, name)
    assert len(flown(decisions)) > 1000
    assert not any(Reason.SWINGING in d.reasons for d in decisions)
    assert all(
        d.tuned.margin.meets(Margin(1.5, 17.0))
        for d in decisions
        if d.tuned is not None and not d.late_s > 0.1
    )


def test_ardupilot_thrust_as_climb_rate_until_the_option_is_set(shared_data):
    first = recording(shared_data, "ardupilot/crash_body_frame_target", begun=True)[-1]
    assert flown([first])
    assert first.t_s >= 54.0, "GUID_OPTIONS is 0 until then"
    assert first.command.thrust == pytest.approx(0.437, abs=0.01), (
        "flown then: 0.436; MOT_THST_HOVER says 0.39"
    )


@pytest.mark.slow
def test_ardupilot_target_in_the_body_frame(shared_data):
    """'Climb 0.2 m' in BODY_OFFSET_NED, 2 m from the origin: the hold asks for no more than a climb."""
    seen, target = [], None
    for state, _ in stepped(shared_data, "ardupilot/crash_body_frame_target"):
        if state.held.hold is None or state.t_s < 95.0:
            target = None
        elif state.held.hold.target is not target:
            target = state.held.hold.target
            seen.append(target.position - np.asarray(state.estimates.position.position_ned))
    places = [offset for offset in seen if np.isfinite(offset).all()]
    assert places
    for offset in places:
        assert np.abs(offset[:2]).max() < 0.05
        assert offset[2] == pytest.approx(-0.2, abs=0.01)
