"""The chain of ``Adopt``: fly under an unknown ceiling, diagnose the recording, decide again with the amended model."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from flight import amended_hover

import models
from companion.sim.body import Surroundings
from companion.sim.scenario import ROUNDING_S, Scenario, Waypoint
from replay.cli import main


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return amended_hover.vehicle_file(tmp_path_factory.mktemp("vehicle"))


@pytest.fixture(scope="module")
def recording(vehicle: Path) -> Path:
    """Eighteen seconds: twice up to a gap of 1.2 radii, so that one visit can be held out, and down. Simulated."""
    gaps = (
        (0.0, 1.4),
        (2.0, 1.4),
        (5.0, 0.2),
        (8.0, 0.2),
        (10.0, 0.8),
        (13.0, 0.2),
        (16.0, 0.2),
        (18.0, 0.8),
    )
    waypoints = tuple(Waypoint(at, 0.0, amended_hover.CEILING_M - gap) for at, gap in gaps)
    log = vehicle.parent / "flight.tlog"
    flown = amended_hover.fly(
        5, None, vehicle, log, Scenario("up", Surroundings(), waypoints, ROUNDING_S)
    )
    assert flown.touched_s == 0.0
    assert flown.rms("height") < 60.0
    return log


@pytest.mark.slow
def test_an_unknown_ceiling_is_named_adopted_and_then_compensated(
    recording: Path, vehicle: Path
) -> None:
    folder = recording.parent
    model, answer = amended_hover.diagnose([recording], vehicle, folder)
    effects = {e["name"]: e for e in answer["effects"]}
    assert "ceiling" in effects
    # More than half of the energy of the residual on time that the fit did not see.
    assert answer["axes"]["Fz"]["rms_after"] ** 2 < 0.5 * answer["axes"]["Fz"]["rms_before"] ** 2
    assert (folder / "report.html").stat().st_size > 10_000
    assert "ceiling" in {e.name for e in models.load(model).effects}
    target = folder / "run.json"
    arguments = [
        "run",
        str(recording),
        "--vehicle",
        str(vehicle),
        "--model",
        str(model),
        "--json",
        str(target),
    ]
    assert main([*arguments, "--quiet"]) == 0
    # The ceiling draws up by a few percent of the weight: the amended model takes thrust away there.
    assert json.loads(target.read_text())["thrust"]["min"] < -0.005
