"""The corner in the air of the flow simulation: made of one half of its places, flown by what the other half taught."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import models
from companion import cli
from companion.sim import flow_air as flow
from companion.sim.air import NOMINAL, Increments
from companion.sim.compare import CompareSettings
from companion.sim.flight import SimulatedFlight
from companion.sim.flow_air import AIR_HALF, FlowAir, flow_air
from companion.sim.model_error import model_error
from companion.sim.scenario import build
from companion.sim.world import default_model, law_of
from companion.vehicles import QUAD, default_vehicle
from models.common.extras import how_to_install
from models.dataset import half, read
from models.vehicle import load_vehicle

pytest.importorskip("scipy")
RADIUS_M = 0.165
SET = read(Path(models.__file__).parent / "data" / "corner_cfd.csv")


def shares(rows) -> np.ndarray:
    """Pull, lift and tilt over the free lift at 4000 rpm."""
    free = rows.wrench[rows.free_air][0]
    return (rows.wrench - free)[:, [0, 2, 4]] / (free[2] * np.array([1.0, 1.0, RADIUS_M]))


def stated(rows) -> np.ndarray:
    air = flow_air()
    found = [
        air.increments(h / RADIUS_M, d / RADIUS_M) for h, d in zip(rows.h, rows.d, strict=True)
    ]
    return np.array([(i.x, i.z, i.my) for i in found])


def test_at_its_own_places_it_is_the_flow_simulation_and_at_the_others_near_it():
    own, other = (
        half(SET, which).take(half(SET, which).rpm == 4000.0) for which in (AIR_HALF, "odd")
    )
    assert stated(own) == pytest.approx(shares(own), abs=2e-3)
    wrong = np.sqrt(
        np.mean((stated(other) - shares(other)) ** 2, axis=0) / np.mean(shares(other) ** 2, axis=0)
    )
    assert (wrong > 0.03).all()
    assert (wrong < 0.3).all()


def test_far_from_everything_is_free_air_and_nothing_jumps():
    air = flow_air()
    free = air.increments(math.inf, math.inf)
    assert (free.x, free.z, free.my, free.mz) == pytest.approx((0.0,) * 4, abs=1e-12)
    assert free.rms == NOMINAL.rms_free
    for eta in np.linspace(0.7, 9.0, 40):
        lifts = [air.increments(eta, delta).z for delta in np.linspace(0.01, 9.0, 400)]
        assert np.abs(np.diff(lifts)).max() < 0.02


def test_the_model_of_the_other_half_flies_there_unless_another_is_named():
    settings = CompareSettings(scenario="corner_cfd")
    assert settings.choice.name == default_model("corner_cfd") == "corner_cfd_half"
    assert CompareSettings(scenario="corner").choice.name == "shipped"
    assert CompareSettings(scenario="corner_cfd", model="none").choice.name == "none"
    error = model_error(settings.choice.model, settings.flown_vehicle, law_of("corner_cfd", 1))
    assert max(error.lift, error.pull, error.tilt) < 0.25
    assert min(error.lift, error.pull, error.tilt) > 0.03


@pytest.mark.parametrize("vehicle", [default_vehicle(), load_vehicle(QUAD)], ids=["tandem", "quad"])
def test_any_vehicle_flies_in_it(vehicle):
    flight = SimulatedFlight(vehicle, build("corner_cfd", vehicle), 1)
    body = flight.body
    assert isinstance(body.law, FlowAir)
    body.position[2] = -(1.5 * vehicle.rotor_radius_m)
    body.rpm = [3000.0] * len(body.rpm)
    body.step([1500.0] * 16)
    assert body.causes.corner[2] / body.causes.free[2] == pytest.approx(
        body.law.increments(1.5, math.inf).z, rel=0.15
    )


def test_a_flight_takes_any_law():
    class Sucking:
        def increments(self, eta: float, delta: float) -> Increments:
            return Increments(z=-0.5 if math.isfinite(eta) else 0.0)

    vehicle = default_vehicle()
    body = SimulatedFlight(vehicle, build("hover", vehicle), 1, law=Sucking()).body
    body.rpm = [3000.0] * len(body.rpm)
    body.step([1500.0] * 16)
    assert body.causes.corner[2] == pytest.approx(-0.5 * body.causes.free[2])


@pytest.mark.parametrize("command", [["--compare"], [], ["--check"]])
def test_without_scipy_it_is_refused_with_what_to_install(command, monkeypatch, capsys):
    monkeypatch.setattr(flow, "find_spec", lambda name: None)
    assert cli.main(["--connect", "sim:corner_cfd", *command]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "sim:corner_cfd" in line
    assert how_to_install("replay") in line
