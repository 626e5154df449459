"""``replay predict``: the error of a model on flights that it was not made from; only the day is learnt."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noise_records import noise_record

import models
from companion.vehicles import default_vehicle
from models.common.frames import Array
from models.effects import AdoptedEffect, adopted_wrench, get
from models.vehicle import load_vehicle
from replay.cli import main
from replay.diagnosis.amended_model import amended
from replay.predict.predict import LEARNING_S, Prediction, predict, predicted
from replay.residual.record import Record

SCALE = AdoptedEffect("thrust_scale", {"scale": 0.05})
DRAG = AdoptedEffect("wind", {"north": 0.0, "east": 0.0, "own_motion": 0.5, "turning": 0.0, "sinking": 0.0, "lift": 0.0,
                              "above_radii": 0.5})  # fmt: skip


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Ninety seconds of noise."""
    return noise_record(3, 90.0, 0.3)


def acts(record: Record, effect: AdoptedEffect) -> Array:
    return np.nan_to_num(get(effect.name).wrench(record.context, effect.parameters))


def flown(
    quiet: Record,
    true: tuple[AdoptedEffect, ...],
    known: tuple[AdoptedEffect, ...],
    *,
    frozen: bool,
):
    """The prediction of a flight on which ``true`` acts by a model that has adopted ``known``."""
    felt = quiet.residual + sum(acts(quiet, e) for e in true)
    model = amended(models.load(), default_vehicle(), known)
    told = sum((acts(quiet, e) for e in model.effects), np.zeros_like(felt))
    bare, with_effects = replace(quiet, residual=felt), replace(quiet, residual=felt - told)
    return Prediction((predicted(with_effects, bare, model, frozen=frozen),), frozen, ())


def test_what_is_of_the_vehicle_predicts_another_flight_with_nothing_fitted(quiet: Record) -> None:
    answer = flown(quiet, (SCALE,), (SCALE,), frozen=True)
    error = answer.axes()["Fz"]
    assert error["rms_with"] < 0.5 * error["rms_without"]
    assert error["interval"][0] < error["rms_with"] < error["interval"][1]
    assert answer.flights[0].day is None
    assert answer.flights[0].seconds == pytest.approx(quiet.seconds)


def test_a_wrong_size_makes_it_worse_and_the_answer_says_so(quiet: Record) -> None:
    error = flown(quiet, (), (SCALE,), frozen=True).axes()["Fz"]
    assert error["interval"][0] > error["rms_without"]


def test_the_wind_of_the_day_is_learnt_from_the_start_and_the_rest_is_judged(quiet: Record) -> None:
    windy = replace(DRAG, parameters={**DRAG.parameters, "north": 2.0, "east": -1.0})
    frozen = flown(quiet, (windy,), (windy,), frozen=True).axes()["Fx"]
    answer = flown(quiet, (windy,), (windy,), frozen=False)
    learnt = answer.axes()["Fx"]
    assert learnt["rms_with"] < 0.5 * frozen["rms_with"]
    flight = answer.flights[0]
    assert flight.seconds == pytest.approx(quiet.seconds - LEARNING_S, abs=0.5)
    assert flight.day is not None
    # A wind and an accelerometer's offset share what one heading shows.
    # Of a vehicle with half of momentum theory's drag: the air moves twice as fast as that would say.
    assert flight.day.as_json()["wind"]["north"] == pytest.approx(4.0, abs=1.4)


def test_an_effect_of_the_model_that_is_larger_on_this_day_is_learnt(quiet: Record) -> None:
    centre = AdoptedEffect("cg_offset", {"x": 0.03, "y": 0.0})
    farther = replace(centre, parameters={"x": 0.04, "y": 0.0})
    answer = flown(quiet, (farther,), (centre,), frozen=False)
    error = answer.axes()["My"]
    frozen = flown(quiet, (farther,), (centre,), frozen=True).axes()["My"]
    assert error["rms_with"] < 0.5 * frozen["rms_with"]
    (flight,) = answer.flights
    assert flight.day is not None
    assert flight.day.as_json()["cg_offset"]["larger_by"] == pytest.approx(0.33, abs=0.1)
    told = adopted_wrench(flight.day.effects(), quiet.context)
    np.testing.assert_allclose(told, flight.day.wrench, atol=1e-6)


def test_drag_is_learnt_where_the_model_says_nothing_of_it(quiet: Record) -> None:
    drag = AdoptedEffect(
        "rotor_drag", {"drag": 1.5, "turning": 0.0, "sinking": 0.0, "above_radii": 0.0}
    )
    answer = flown(quiet, (drag,), (), frozen=False)
    assert answer.axes()["Fx"]["rms_with"] < 0.6 * answer.axes()["Fx"]["rms_without"]
    (flight,) = answer.flights
    assert flight.day is not None
    assert flight.day.as_json()["rotor_drag"]["drag"] == pytest.approx(1.5, abs=0.4)
    told = adopted_wrench(flight.day.effects(), quiet.context)
    np.testing.assert_allclose(told, flight.day.wrench, atol=1e-6)
    known = flown(quiet, (drag,), (drag,), frozen=False).flights[0].day
    assert known is not None
    assert set(known.as_json()["rotor_drag"]) == {"larger_by"}


def test_a_day_without_anything_is_found_to_be_nothing(quiet: Record) -> None:
    for error in flown(quiet, (), (), frozen=False).axes().values():
        assert error["rms_with"] < 1.3 * error["rms_without"]


def test_a_moment_that_nothing_of_the_day_explains_is_no_wind(quiet: Record) -> None:
    drag = replace(DRAG, parameters={**DRAG.parameters, "above_radii": 1.0})
    centre = AdoptedEffect("cg_offset", {"x": 0.03, "y": 0.0})
    for axis, error in flown(quiet, (drag, centre), (drag,), frozen=False).axes().items():
        assert error["rms_with"] < 1.1 * error["rms_without"], axis


def test_errors_come_by_axis_and_regime_in_json_and_text(quiet: Record) -> None:
    answer = flown(quiet, (SCALE,), (SCALE,), frozen=True)
    said = json.loads(json.dumps(answer.as_json("m"), allow_nan=False))
    assert set(said["axes"]["Fz"]) == {"rms_without", "rms_with", "interval", "unit"}
    assert {"low", "far"} <= {r["regime"] for r in said["regimes"]}
    assert "Fz" in answer.as_text()


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(["predict", "--quiet", *arguments])
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return code, lines[0]


def test_bad_input_is_one_line_with_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    assert refused(capsys, str(empty), "--model", "default")[0] == 3
    assert refused(capsys, str(tmp_path / "none.tlog"), "--model", "default")[0] == 3
    assert refused(capsys, str(empty), "--model", str(tmp_path))[0] == 2
    assert refused(capsys, str(tmp_path), "--model", "default")[0] == 2


@pytest.mark.slow
def test_a_model_of_one_real_flight_predicts_another(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "measured"
    if not folder.is_dir():
        pytest.skip("no measured flights")
    first, other = folder / "imrc" / "BL_t06.tlog", folder / "imrc" / "BL_t08.tlog"
    vehicle, target = str(folder / "imrc" / "BL.toml"), tmp_path / "a.json"
    command = [
        "diagnose",
        str(first),
        "--vehicle",
        vehicle,
        "--model",
        "none",
        "--save-model",
        str(tmp_path / "m"),
    ]
    assert main([*command, "--test", str(other), "--json", str(target), "--quiet"]) == 0
    test = json.loads(target.read_text())["test"]
    assert test["axes"]["Fx"]["rms_with"] < 0.6 * test["axes"]["Fx"]["rms_without"]
    model = models.load(tmp_path / "m")
    same = predict([other], load_vehicle(Path(vehicle)), model)
    assert same.as_json(None)["axes"] == test["axes"]
    seen = predict([first, first], load_vehicle(Path(vehicle)), model, frozen=True)
    assert any("was made from this log" in note for note in seen.notes)
    assert any("given twice" in note for note in seen.notes)
