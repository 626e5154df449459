"""The answer of ``replay diagnose``: names, verdicts, JSON, page and command, on made-up and recorded flights."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noise_records import noise_record
from pages import without_script

import models
from models.effects import catalogue, get
from replay.cli import main
from replay.diagnosis.answer import rms_interval
from replay.diagnosis.diagnose import Diagnosis, conclude
from replay.diagnosis.html_report import page
from replay.diagnosis.next_step import size_words
from replay.residual.record import Record

FEW = [
    e
    for e in catalogue()
    if e.name in ("wind", "thrust_scale", "rotor_drag", "ground_effect", "cg_offset")
]
VERDICTS = {"nothing_missing", "explained", "partly_explained", "unexplained"}


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Ninety seconds of noise."""
    return noise_record(3, 90.0, 0.3)


def with_wind(record: Record, north: float) -> Record:
    """The record with 0.6 m/s of wind (a term of the catalogue: this tests plumbing, not physics)."""
    effect = get("wind")
    coefficients = np.zeros(len(effect.coefficients))
    coefficients[:3] = north, -0.3, 1.0
    return replace(
        record, residual=record.residual + effect.regressors(record.context, (0.5,)) @ coefficients
    )


@pytest.fixture(scope="module")
def windy(quiet: Record) -> Diagnosis:
    """The answer to a flight in wind."""
    return conclude([with_wind(quiet, 0.6)], effects=FEW)


def test_noise_is_answered_nothing_missing(quiet: Record) -> None:
    answer = conclude([quiet], effects=FEW)
    assert answer.verdict == "nothing_missing"
    assert answer.as_json(None)["effects"] == []
    assert answer.rms(after=True) == pytest.approx(answer.rms(after=False))


@pytest.mark.slow
def test_wind_is_named_with_its_size_and_takes_the_residual_down(
    windy: Diagnosis, quiet: Record
) -> None:
    assert [n.effect.name for n in windy.found] == ["wind"]
    assert windy.found[0].status == "candidate"
    low, high = next(e.ci95 for e in windy.found[0].estimates if e.name == "north")
    assert 0.4 < low < high < 0.8
    assert any("one wind does not separate drag from wind" in note for note in windy.notes)
    adopted = {e.name: e.parameters for e in windy.adopted}["wind"]
    kept = 1.0 - windy.of_one_wind
    assert 0.5 < kept < 1.0
    assert adopted["own_motion"] == pytest.approx(
        kept * windy.found[0].parameters["own_motion"], rel=0.1
    )
    noise = np.sqrt((quiet.residual**2).mean(axis=0))
    assert windy.rms(after=True)[:2] == pytest.approx(noise[:2], rel=0.2)
    assert windy.rms(after=False)[0] > 1.5 * noise[0]


def test_a_wind_is_said_by_its_speed_and_the_force_that_it_makes(quiet: Record) -> None:
    """Drag of a tenth of momentum theory's."""
    context = quiet.context
    wind = get("wind")
    found = {
        "north": 0.8,
        "east": 0.0,
        "own_motion": 0.1,
        "turning": 0.0,
        "sinking": 0.3,
        "lift": 0.0,
        "above_radii": 0.5,
    }
    force = np.abs(wind.regressors(context, (0.5,))[..., :2, 0]).max() * 0.8
    assert wind.shown.in_words is not None
    said = wind.shown.in_words(context, wind.said(context, found))
    assert said.startswith("wind of 8 m/s from the south")
    assert newtons(wind.shown.push(context, found)) == pytest.approx(force, rel=0.1)


def newtons(words: str) -> float:
    """The force in ``it pushes with 0.65 N``."""
    return float(words.split(" N")[0].split()[-1])


def test_the_force_of_a_wind_does_not_hang_on_a_drag_that_is_not_known(quiet: Record) -> None:
    """In a hover the speed is a mean over drags that may be, and the drag itself may be said to be none."""
    blown = 0.6 * np.nan_to_num(get("wind").regressors(quiet.context, (0.0,)))[..., 1]
    answer = conclude([replace(quiet, residual=quiet.residual + blown)], effects=[get("wind")])
    (wind,) = answer.found
    force = float(np.linalg.norm(blown[:, :2], axis=1).mean())
    for drag in (0.0, 0.1, 1.0):
        numbers = [replace(e, value=drag) if e.name == "own_motion" else e for e in wind.estimates]
        words = size_words(replace(wind, estimates=tuple(numbers)), answer)
        assert newtons(words) == pytest.approx(force, rel=0.15)


def test_a_size_without_unit_is_a_plain_number_in_the_text(windy: Diagnosis) -> None:
    line = next(text for text in windy.as_text().splitlines() if text.startswith("  wind "))
    assert "north = " in line
    assert "turning = " in line
    assert "] 1" not in line


def test_the_json_is_the_contracts(windy: Diagnosis) -> None:
    answer = json.loads(json.dumps(windy.as_json("amended"), allow_nan=False))
    assert {
        "logs",
        "samples",
        "duration_s",
        "verdict",
        "axes",
        "effects",
        "aliases",
        "unexplained",
        "model",
    } <= set(answer)
    assert answer["verdict"] in VERDICTS
    assert answer["model"] == "amended"
    assert set(answer["axes"]["Fx"]) == {"rms_before", "rms_after", "unit"}
    effect = answer["effects"][0]
    assert {"name", "axes", "parameters", "explains", "q_value", "channels"} <= set(effect)
    assert set(effect["parameters"]["north"]) == {"value", "ci95", "unit"}
    assert 0.0 < effect["explains"] <= 1.0
    assert (effect["belongs_to"], effect["kept"]) == ("weather", False)


@pytest.mark.slow
def test_a_second_flight_confirms_or_does_not(quiet: Record) -> None:
    first, other = with_wind(quiet, 0.6), noise_record(4, 90.0, 0.3)
    same = conclude([first, with_wind(other, 0.6)], effects=FEW)
    assert {n.status for n in same.found if n.effect.name == "wind"} == {"confirmed"}
    calm = conclude([first, other], effects=FEW)
    assert {n.status for n in calm.found if n.effect.name == "wind"} == {"candidate"}


@pytest.mark.slow
def test_flights_in_different_winds_share_the_drag_and_not_the_wind(quiet: Record) -> None:
    both = conclude(
        [with_wind(quiet, 0.6), with_wind(noise_record(4, 90.0, 0.3), -0.6)], effects=FEW
    )
    (wind,) = (n for n in both.found if n.effect.name == "wind")
    first, second = wind.of_flight[0], wind.of_flight[1]
    assert first["own_motion"] == second["own_motion"]
    assert first["north"] > 0.3
    assert second["north"] < -0.3
    assert not any("one wind" in note for note in both.notes)


@pytest.mark.slow
def test_a_gust_in_step_with_the_motion_is_not_explained_away(quiet: Record) -> None:
    hz, t = 0.16, quiet.time_s
    swing = np.stack(
        [np.sin(2.0 * np.pi * hz * t), 0.2 * np.ones(len(t)), np.zeros(len(t))], axis=1
    )
    state = replace(quiet.context.state, velocity_ned=swing)
    rhythmic = replace(quiet, context=replace(quiet.context, state=state))
    gust = with_wind(rhythmic, 0.6)
    gust.residual[:, 0] += 1.5 * np.cos(2.0 * np.pi * hz * t)
    answer = conclude([gust], effects=FEW)
    assert answer.verdict in ("partly_explained", "unexplained")
    assert {n.effect.name for n in answer.found} <= {"wind", "rotor_drag"}


def test_the_page_stands_alone_and_says_what_to_do(windy: Diagnosis) -> None:
    html = page(windy, windy.records[0].context.vehicle)
    assert "<svg" in html
    assert "wind" in html
    assert "seen on one flight" in html
    assert "could not have shown" in html
    assert "http" not in without_script(html)
    assert "<script" not in without_script(html)
    assert "<img" not in html


def test_the_interval_of_an_rms_holds_the_truth() -> None:
    x = np.random.default_rng(0).standard_normal(4000)
    value, low, high = rms_interval(x, 0.15)
    assert low < 1.0 < high
    assert value == pytest.approx(1.0, abs=0.05)
    assert high - low < 0.1


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and the one line on stderr."""
    code = main(["diagnose", "--quiet", *arguments])
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return code, lines[0]


def test_bad_arguments_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    text = tmp_path / "notes.txt"
    text.write_text("hello")
    assert refused([str(tmp_path / "none.tlog")], capsys)[0] == 3
    assert refused([str(empty)], capsys)[0] == 3
    assert refused([str(text)], capsys)[0] == 3
    assert refused([str(empty), "--model", str(tmp_path)], capsys)[0] == 2
    assert refused([str(empty), "--vehicle", str(text)], capsys)[0] == 2
    assert refused([str(empty), "--target-system", "0"], capsys)[0] == 2


@pytest.mark.slow
def test_an_example_flight_gives_answer_amended_model_and_page(
    shared_data: Path, tmp_path: Path
) -> None:
    flight = shared_data / "undeclared" / "payload.tlog"
    code = main(
        ["diagnose", str(flight), "--vehicle", str(flight.with_suffix(".toml")), "--json", str(tmp_path / "a.json"),
         "--save-model", str(tmp_path / "amended"), "--report", str(tmp_path), "--quiet"]
    )  # fmt: skip
    assert code == 0
    answer = json.loads((tmp_path / "a.json").read_text())
    # The shipped model is not this flight's air; the load that was picked up stands out all the same.
    payload = {e["name"]: e for e in answer["effects"]}["payload"]
    assert 0.2 < payload["parameters"]["mass_kg"]["value"] < 0.5
    assert (payload["belongs_to"], payload["kept"]) == ("load", False)
    amended = models.load(tmp_path / "amended")
    assert "payload" not in {e.name for e in amended.effects}
    assert "payload" in amended.info["of_day"]
    assert [e["name"] for e in amended.info["learnt_from"]] == [flight.name]
    assert (tmp_path / "report.html").stat().st_size > 10_000
