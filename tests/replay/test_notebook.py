"""The diagnosis in a notebook: the examples of the manual run, and an answer shows itself."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from log_writers import QUAD_MASS_KG, quad_flight, write_tlog

import replay
from companion.vehicles import QUAD
from models.vehicle import load_vehicle
from replay.diagnosis.answer import Diagnosis

DESK = Path(__file__).resolve().parents[2] / "docs" / "desk.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", DESK.read_text(encoding="utf-8"), re.S)
HEAVIER_KG = 0.6


@pytest.fixture(scope="module")
def flights(tmp_path_factory) -> Path:
    """Monday and Friday, both heavier than the vehicle file says."""
    folder = tmp_path_factory.mktemp("flights")
    for seed, day in enumerate(("monday", "friday")):
        write_tlog(
            folder / f"{day}.tlog", quad_flight(60.0, mass_kg=QUAD_MASS_KG + HEAVIER_KG, seed=seed)
        )
    (folder / "my.toml").write_text(QUAD.read_text())
    return folder


@pytest.mark.slow
def test_the_examples_run_in_order(flights, monkeypatch):
    monkeypatch.chdir(flights)
    assert len(EXAMPLES) == 3
    names: dict[str, object] = {}
    for example in EXAMPLES:
        exec(compile(example, str(DESK), "exec"), names)
    answer = names["answer"]
    assert isinstance(answer, Diagnosis)
    assert {f.effect.name for f in answer.found} & {"payload", "thrust_scale"}
    page = answer._repr_html_()
    assert page.startswith("<iframe")
    assert "Error of the model" in page
    assert "<style" not in page  # it would be that of the whole notebook


@pytest.mark.slow
def test_paths_vehicle_and_model_give_the_same_as_the_command(flights):
    from replay.diagnosis.diagnose import diagnose

    vehicle = load_vehicle(QUAD)
    told, known = (
        ask([flights / "monday.tlog"], vehicle, None) for ask in (replay.diagnose, diagnose)
    )
    assert told.as_json(None) == known.as_json(None)


@pytest.mark.slow
def test_a_vehicle_is_drafted_by_what_is_known(flights):
    answer = replay.diagnose(flights / "monday.tlog", mass_kg=QUAD_MASS_KG, propeller_inch=11.0)
    vehicle = answer.records[0].context.vehicle
    assert vehicle.mass_kg == QUAD_MASS_KG
    assert vehicle.rotor_radius_m == pytest.approx(11 * 0.0127)
    assert any("typical" in note for note in answer.notes)
