"""What is no air and no vehicle of ours: no size runs away, and each is back after. Simulated."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from adapt_flights import Change, Watch, bump, dead_rotor, fly, hand, lying_range, push
from adapt_models import TrueModel
from simulated import simulated

from companion.adapt_options import Adapt
from companion.adaptation.adaptation import Adaptation
from companion.adaptation.gates import NOT_FLYING, SURFACE_STEP, SURFACE_UNKNOWN
from companion.config import PipelineConfig
from companion.sim.air import NOMINAL
from companion.sim.flight import SimulatedFlight
from companion.sim.scenario import Waypoint, build
from companion.vehicles import default_vehicle
from models.vehicle import Vehicle

VEHICLE = default_vehicle()
LOW_M = 0.28
HAPPENS_S, OVER_S, END_S = 24.0, 28.0, 43.0
"""Boot times. The script begins at 12 s."""


def low_hover() -> SimulatedFlight:
    """Down into the ground effect, which is then known; up and down again after what happens."""
    waypoints = (
        (0, 1.2),
        (2, 1.2),
        (6, LOW_M),
        (18, LOW_M),
        (21, 1.2),
        (22, 1.2),
        (26, LOW_M),
        (60, LOW_M),
    )
    scenario = replace(
        build("hover", VEHICLE),
        waypoints=tuple(Waypoint(float(t), 0.0, h, name="low") for t, h in waypoints),
        rounding_s=0.6,
    )
    return simulated(VEHICLE, scenario, 7, law=NOMINAL)


def flown(
    flight: SimulatedFlight, *changes: Change, vehicle: Vehicle = VEHICLE, **options: float
) -> Watch:
    model = TrueModel(VEHICLE, NOMINAL)
    config = PipelineConfig(vehicle=vehicle, model=model, adapt=Adapt.FULL)  # type: ignore[arg-type]
    return fly(flight, config, END_S, *changes, **options)


def ground(watch: Watch, after_s: float, before_s: float = math.inf) -> list[float]:
    return [value for _, value, _ in watch.size("ground_lift", after_s, before_s)]


def compensated(known: Adaptation) -> float:
    """Lift over ground that offsets follow at ``LOW_M``, in the true one, with a model that is right."""
    height = LOW_M / VEHICLE.rotor_radius_m
    lift, _, _ = known.applied.near.at_fan(height, math.inf)
    return known.shares[0] + lift / NOMINAL.increments(height, math.inf).z


def assert_bounded_and_back(watch: Watch) -> None:
    lifts = [(t, compensated(known)) for t, known in watch.seen]
    assert all(-0.5 < lift < 2.0 for _, lift in lifts)
    assert abs(lifts[-1][1] - 1.0) < 0.25
    before, after = ground(watch, HAPPENS_S - 2.0, HAPPENS_S)[-1], ground(watch, END_S - 1.0)[-1]
    assert abs(before - 1.0) < 0.25
    assert abs(after - 1.0) < 0.3
    for _, known in watch.seen:
        for size in known.estimates().values():
            assert math.isfinite(size.value)
            assert size.sd > 0.0
        assert all(0.0 <= share <= 1.5 for share in known.shares)
    last = watch.seen[-1][1].estimates()
    assert abs(last["thrust_scale"].value - 1.0) < 0.06
    assert math.hypot(last["wind_north"].value, last["wind_east"].value) < 1.0


@pytest.mark.slow
def test_a_bump_moves_no_size():
    flight = low_hover()
    push(flight, bump(HAPPENS_S))
    watch = flown(flight)
    assert_bounded_and_back(watch)
    assert all(abs(v - 1.0) < 0.3 for v in ground(watch, HAPPENS_S - 1.0))


@pytest.mark.slow
def test_a_hand_that_holds_the_vehicle_is_forgotten():
    flight = low_hover()
    push(flight, hand(HAPPENS_S, OVER_S))
    watch = flown(flight)
    assert_bounded_and_back(watch)
    assert all(0.4 < v < 1.6 for v in ground(watch, HAPPENS_S - 1.0))


@pytest.mark.slow
def test_a_range_that_lies_takes_the_offset_away_and_is_forgiven():
    """It says 1.1 m at 0.28 m: a step, so that nothing is learned while it is fresh."""
    watch = flown(low_hover(), lying_range(HAPPENS_S, OVER_S, 0, 1.1))
    assert_bounded_and_back(watch)
    seen = {known.paused for t, known in watch.seen if HAPPENS_S < t < OVER_S + 2.0}
    assert seen & {SURFACE_STEP, SURFACE_UNKNOWN}


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [0.0, None], ids=["reads 0", "stays where it was"])
def test_telemetry_of_one_rotor_that_dies_teaches_nothing_wrong(rpm):
    watch = flown(low_hover(), dead_rotor(HAPPENS_S, OVER_S, 2, rpm))
    assert_bounded_and_back(watch)


@pytest.mark.slow
def test_a_mass_that_is_a_third_off_is_a_thrust_scale_and_no_ground_effect():
    watch = flown(low_hover(), vehicle=replace(VEHICLE, mass_kg=1.3 * VEHICLE.mass_kg))
    last = watch.seen[-1][1].estimates()
    assert last["thrust_scale"].value == pytest.approx(1.3, abs=0.06)
    assert all(0.6 < value < 1.5 for value in ground(watch, 12.0))
    assert compensated(watch.seen[-1][1]) == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_landing_and_standing_teach_nothing():
    flight = low_hover()
    watch = flown(flight, land_s=HAPPENS_S)
    last = watch.seen[-1][1]
    assert last.paused == NOT_FLYING
    assert abs(ground(watch, END_S - 1.0)[-1] - 1.0) < 0.3
    assert abs(last.estimates()["thrust_scale"].value - 1.0) < 0.06
    touched = next(t for t, known in watch.seen if t > HAPPENS_S and known.paused == NOT_FLYING)
    assert watch.seen[-1][1].learned_s == next(
        known.learned_s for t, known in watch.seen if t > touched + 1.0
    )
