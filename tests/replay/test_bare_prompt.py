"""What a researcher types first: things show themselves in a line, and what is wrong is an error of the program."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_writers import quad_flight, write_tlog

import models
import replay
from companion.vehicles import QUAD
from models.common.errors import ConfigError, LogError, ModelError, UserError
from models.vehicle import load_vehicle
from replay import Diagnosis, FlightModel


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tlog_of(tmp_path_factory.mktemp("log") / "flight.tlog")


def write_tlog_of(path: Path) -> Path:
    write_tlog(path, quad_flight(40.0))
    return path


@pytest.fixture(scope="module")
def flight(path: Path) -> replay.FlightLog:
    (flight,) = replay.load(path)
    return flight


def test_a_flight_shows_itself_in_a_line(flight: replay.FlightLog) -> None:
    assert repr(flight).startswith("FlightLog('flight.tlog', 40.0 s, with attitude, rates, ")
    assert repr(flight.attitude) == "Series('ATTITUDE', 1000 x 4, 25 Hz)"


def test_a_record_and_an_answer_show_themselves_in_a_line(flight: replay.FlightLog) -> None:
    record = replay.build_record(flight, load_vehicle(QUAD), None)
    assert repr(record) == "Record('flight.tlog', 40.0 s judged, Fx Fy Fz Mx My Mz)"
    answer = Diagnosis(QUAD, model=None).fit(flight.path).answer_
    assert len(repr(answer)) < 200
    assert repr(answer).startswith("NotebookDiagnosis(")
    assert "s judged" in repr(answer)


def quad() -> Any:
    return load_vehicle(QUAD)


NO_LOG = "no log is given"
WRONG: dict[str, tuple[type[UserError], str, Callable[[], object]]] = {
    "no log to diagnose": (LogError, NO_LOG, lambda: replay.diagnose([])),
    "no log to fit": (LogError, NO_LOG, lambda: Diagnosis(QUAD, model=None).fit([])),
    "mass below zero": (ConfigError, "mass_kg -3", lambda: replay.diagnose("x", mass_kg=-3.0)),
    "no propeller": (
        ConfigError,
        "propeller_inch 0",
        lambda: replay.diagnose("x", propeller_inch=0),
    ),
    "model that is not there": (ModelError, "--save-model", lambda: models.load("no-such-model")),
    "no attitude": (
        ConfigError,
        "quaternion",
        lambda: replay.rollout(FlightModel(quad()), np.zeros((1, 13)), np.zeros((1, 2, 4))),
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_said_in_a_line(what: str) -> None:
    kind, said, call = WRONG[what]
    with pytest.raises(kind, match=said):
        call()


def test_a_vehicle_that_ships_is_named(path: Path) -> None:
    answer = replay.diagnose(path, "quad", model=None)
    assert answer.vehicle == quad()


def test_a_path_in_place_of_a_vehicle_is_said(flight: replay.FlightLog) -> None:
    with pytest.raises(ConfigError, match="load_vehicle"):
        replay.build_record(flight, str(QUAD), None)  # type: ignore[arg-type]


def test_a_direction_that_is_none_is_said(flight: replay.FlightLog) -> None:
    with pytest.raises(ConfigError, match="donw: is no direction; give one of down, up"):
        flight.beam("donw")


def test_no_log_to_predict_is_said(path: Path) -> None:
    fitted = Diagnosis(QUAD, model=None).fit(path)
    with pytest.raises(LogError, match=NO_LOG):
        fitted.predict([])
    with pytest.raises(ConfigError, match="horizon_s"):
        fitted.predict(path, horizon_s=-1.0)
