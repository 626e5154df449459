"""``replay.Diagnosis`` as users of estimators expect it."""

from __future__ import annotations

from pathlib import Path

import pytest
from log_writers import QUAD_MASS_KG, quad_flight, write_tlog
from sklearn.base import clone

import models
from companion.vehicles import QUAD
from models.common.errors import LogError, NotFittedError
from replay import Diagnosis

HEAVIER_KG = 0.6


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two flights, both heavier than the vehicle file says."""
    folder = tmp_path_factory.mktemp("flights")
    out = []
    for seed, day in enumerate(("monday", "friday")):
        out.append(folder / f"{day}.tlog")
        write_tlog(out[-1], quad_flight(60.0, mass_kg=QUAD_MASS_KG + HEAVIER_KG, seed=seed))
    return out


@pytest.fixture(scope="module")
def fitted(flights: list[Path]) -> Diagnosis:
    return Diagnosis(vehicle=QUAD, model=None).fit(flights[0])


def test_before_it_is_fitted_it_says_so() -> None:
    diagnosis = Diagnosis()
    for ask in (diagnosis.plot, lambda: diagnosis.score("x.tlog"), lambda: diagnosis.save("x")):
        with pytest.raises(NotFittedError, match="call fit"):
            ask()


def test_it_can_be_cloned_and_shows_what_was_asked() -> None:
    diagnosis = clone(Diagnosis(vehicle="my.toml", mass_kg=2.0))
    assert diagnosis.get_params()["mass_kg"] == 2.0
    assert repr(diagnosis) == "Diagnosis(mass_kg=2.0, vehicle='my.toml')"


def test_effects_are_a_table_of_plain_numbers(fitted: Diagnosis) -> None:
    names = set(fitted.effects_.names)
    assert names & {"payload", "thrust_scale"}
    for row in fitted.effects_.as_dicts():
        assert row["value"] is None or type(row["value"]) is float
        assert 0.0 <= row["probability"] <= 1.0
    assert str(fitted.effects_).splitlines()[0].split()[:3] == ["effect", "parameter", "value"]
    assert fitted.effects_._repr_html_().count("<tr>") == len(fitted.effects_) + 1


def test_it_holds_on_another_flight(fitted: Diagnosis, flights: list[Path]) -> None:
    assert 0.3 < fitted.score(flights[1]) <= 1.0
    ahead = fitted.predict(flights[1], horizon_s=0.5)
    assert ahead.ahead


def test_page_and_model_are_written(fitted: Diagnosis, tmp_path: Path) -> None:
    page = fitted.plot()
    assert page.save(tmp_path / "answer.html").read_text().startswith("<!doctype html>")
    assert page._repr_html_().startswith("<iframe")
    folder = fitted.save(tmp_path / "model")
    assert models.load(folder).effects == fitted.model_.effects


def test_a_log_that_is_none(tmp_path: Path) -> None:
    file = tmp_path / "notes.tlog"
    file.write_text("no log")
    with pytest.raises(LogError, match=r"notes\.tlog"):
        Diagnosis(vehicle=QUAD).fit(file)
