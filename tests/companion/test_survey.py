"""The survey: a box of heights and wall distances, flown slowly, and back to where it began."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from flight_case import Case, CasePilot, fly_case
from hypothesis import given
from hypothesis import strategies as st
from simflight import sent_and_decided, vehicle

from companion.cli import main
from companion.config import PipelineConfig
from companion.control import survey as sv
from companion.control.survey import Phase, Survey, SurveyTarget, Whereabouts, advance, plan
from companion.sim.autopilot import Mode
from companion.survey_box import SurveyBox, read_box
from models.common.errors import ConfigError
from models.surrogate.empty import empty_model

BOX = SurveyBox(0.3, 1.2, 0.3, 1.0)
EAST = np.array([0.0, 1.0])
START = np.array([2.0, 1.0, -1.1])
WALL_EAST_M = 2.6


def fly(box: SurveyBox, *, start: np.ndarray = START, until_s: float = 600.0, spoil=None):
    """A vehicle that is always where it should be, over flat ground beside a wall; (survey, [(t, place, velocity)])."""
    survey, rows, place = Survey(), [], start.copy()
    for k in range(int(until_s / 0.02)):
        t = 0.02 * k
        seen = Whereabouts(
            t_s=t,
            engaged=True,
            position=place,
            height_m=-float(place[2]),
            wall_m=WALL_EAST_M - float(place[1]),
            towards=EAST,
        )
        if spoil is not None:
            seen = spoil(seen)
        survey, wanted = advance(survey, box, seen)
        if wanted is not None:
            place = wanted.position
            rows.append((t, wanted))
        if survey.phase in (Phase.DONE, Phase.ABORTED):
            break
    return survey, rows


@pytest.mark.parametrize(
    ("text", "box"),
    [("0.3:1.2", SurveyBox(0.3, 1.2)), ("0.3:1.2:0.3:1", BOX)],
)
def test_a_box_is_read(text, box):
    assert read_box(text) == box


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1",
        "1:0.5",
        "0.05:1",
        "0.3:1:0.2",
        "0.3:1:0.05:1",
        "0.3:1:nan:1",
        "0.3:0.35",
        "0.3:9.0",
        "a:b",
    ],
)
def test_a_box_that_nobody_should_fly_is_refused_by_name(text):
    with pytest.raises(ConfigError, match="--survey"):
        read_box(text)


def test_it_sees_the_whole_box_slowly_and_ends_where_it_began():
    survey, rows = fly(BOX)
    assert survey.phase is Phase.DONE
    heights = np.array([-w.position[2] for _, w in rows])
    gaps = WALL_EAST_M - np.array([w.position[1] for _, w in rows])
    assert heights.min() == pytest.approx(BOX.height_min_m)
    assert heights.max() == pytest.approx(BOX.height_max_m)
    assert gaps[heights < 0.35].min() == pytest.approx(BOX.wall_min_m)
    assert np.linalg.norm(rows[-1][1].position - START) < 1e-9
    assert np.linalg.norm(rows[-1][1].velocity) == 0.0
    speed = max(float(np.linalg.norm(w.velocity)) for _, w in rows)
    assert speed <= sv.SPEED_M_S * 1.01
    assert rows[-1][0] < 300.0


def test_the_velocity_is_the_change_of_the_place():
    _, rows = fly(BOX)
    for (t0, a), (t1, b) in zip(rows[::7], rows[1::7], strict=False):
        change = (b.position - a.position) / (t1 - t0)
        assert np.abs(change - 0.5 * (a.velocity + b.velocity)).max() < 0.02


def test_near_the_wall_it_moves_across_only_at_the_top():
    _, rows = fly(BOX)
    for _, w in rows:
        if abs(w.velocity[1]) > 0.01:
            assert (
                -w.position[2] > BOX.height_max_m - 1e-6
                or WALL_EAST_M - w.position[1] > BOX.wall_max_m
            )


def test_without_a_wall_only_the_height_changes():
    survey, rows = fly(SurveyBox(0.3, 1.2))
    assert survey.phase is Phase.DONE
    assert all(np.allclose(w.position[:2], START[:2]) for _, w in rows)


def test_it_waits_until_the_hold_has_flown_for_a_while_and_until_ground_and_wall_are_seen():
    survey = Survey()
    unseen = Whereabouts(
        t_s=0.0, engaged=True, position=START, height_m=1.1, wall_m=math.inf, towards=None
    )
    for k in range(500):
        survey, wanted = advance(survey, BOX, dataclasses.replace(unseen, t_s=0.02 * k))
        assert wanted is None
    assert survey.phase is Phase.WAITING
    assert "wall is not seen" in survey.why
    for k in range(500, 700):
        survey, wanted = advance(
            survey,
            BOX,
            Whereabouts(
                t_s=0.02 * k,
                engaged=k > 600,
                position=START,
                height_m=1.1,
                wall_m=1.6,
                towards=EAST,
            ),
        )
        assert wanted is None or k > 600
    assert survey.phase is Phase.WAITING


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (
            lambda s: dataclasses.replace(s, wall_m=s.wall_m - 0.15) if s.t_s > 20.0 else s,
            "too close to the wall",
        ),
        (
            lambda s: dataclasses.replace(s, height_m=s.height_m - 0.15) if s.t_s > 20.0 else s,
            "too low",
        ),
        (
            lambda s: dataclasses.replace(s, wall_m=math.nan) if s.t_s > 20.0 else s,
            "a distance was lost",
        ),
        (
            lambda s: dataclasses.replace(s, position=s.position + 0.5) if s.t_s > 20.0 else s,
            "did not follow",
        ),
    ],
)
def test_what_is_wrong_sends_it_home_over_the_top(spoil, why):
    survey, rows = fly(BOX, spoil=spoil)
    assert survey.phase is Phase.DONE
    assert why in survey.why
    assert np.linalg.norm(rows[-1][1].position - START) < 1e-9
    assert rows[-1][0] < 250.0


def test_a_hold_that_lets_go_ends_it_for_good():
    survey, rows = fly(BOX, spoil=lambda s: dataclasses.replace(s, engaged=not 30.0 < s.t_s < 31.0))
    assert survey.phase is Phase.ABORTED
    assert rows[-1][0] < 30.1
    assert advance(
        survey,
        BOX,
        Whereabouts(t_s=99.0, engaged=True, position=START, height_m=1.1, wall_m=1.6, towards=EAST),
    ) == (survey, None)


@given(
    st.floats(0.1, 1.0), st.floats(0.1, 2.0), st.floats(0.1, 1.0), st.floats(0.1, 2.0), st.floats(0.1, 3.0),
    st.floats(0.1, 3.0),
)  # fmt: skip
def test_no_plan_leaves_the_box_but_on_its_way_from_and_to_the_start(
    low, span, near, width, height, gap
):
    box = SurveyBox(low, low + span, near, near + width)
    legs = plan(box, (height, gap))
    assert legs[0].start == (0.0, 0.0)
    assert legs[-1].end == pytest.approx((0.0, 0.0), abs=1e-9)
    for leg in legs[1:-2]:
        assert box.height_min_m - 1e-9 <= height + leg.end[0] <= box.height_max_m + 1e-9
        assert box.wall_min_m - 1e-9 <= gap + leg.end[1] <= box.wall_max_m + 1e-9


def test_it_needs_a_recording(capsys):
    assert main(["--connect", "sim:corner", "--survey", "0.3:1.2"]) == 2
    assert "--record" in capsys.readouterr().err


def surveying(p: CasePilot):
    yield from p.take_off(1.0)
    yield from p.hand_over()
    p.judge()
    yield 45.0


def interrupted(p: CasePilot):
    yield from p.take_off(1.0)
    yield from p.hand_over()
    yield 12.0
    p.mode(Mode.LOITER)
    yield 2.0
    p.mode(Mode.GUIDED)
    yield 3.0
    p.judge()
    yield 4.0


def flown(tmp_path, script, box: SurveyBox):
    v = vehicle("quad")
    config = dataclasses.replace(PipelineConfig(vehicle=v, model=empty_model(v)), survey=box)
    log, truth = tmp_path / "survey.tlog", tmp_path / "truth.csv"
    case = Case("survey", "a survey", script, wall_m=1.2)
    return fly_case(case, v, config, truth=truth, record=log), config, log


@pytest.mark.slow
def test_a_flight_surveys_ends_where_it_began_and_replays_bit_for_bit(tmp_path):
    outcome, config, log = flown(tmp_path, surveying, SurveyBox(0.45, 1.0))
    assert outcome.judgement.contact_s == 0.0
    assert 0.4 < outcome.judgement.height_loss_m < 0.75
    assert outcome.judgement.off_m < 0.2
    sent, decided = sent_and_decided(log, config)
    assert len(sent) > 2000
    # All but the last second: a recording does not say when the flight was told to stop.
    assert sent[:-60] == decided[: len(sent) - 60]


@pytest.mark.slow
def test_another_mode_ends_a_survey_and_it_does_not_come_back(tmp_path):
    outcome, _, _ = flown(tmp_path, interrupted, SurveyBox(0.45, 1.0))
    assert outcome.judgement.height_loss_m < 0.1
    assert outcome.judgement.speed_m_s < 0.2


def test_a_wish_is_the_message_that_a_pilot_would_send():
    from companion.mavlink.samples import LocalPosition

    heard = LocalPosition(5.0, 1, 1, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
    message = sv.as_message(SurveyTarget(np.array([1.0, 2.0, -3.0]), np.zeros(3)), heard, 191)
    assert (message.position, message.frame, message.target_component) == ((1.0, 2.0, -3.0), 1, 191)
    assert message.type_mask & 0x3F == 0
    assert message.t_s == 5.0
