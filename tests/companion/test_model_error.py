"""How wrong the model that flies is said to be: of the model that was asked for, adopted effects included."""

from __future__ import annotations

import pytest
from adapt_models import TrueModel, WarpedModel

import models
from companion.sim.air import NOMINAL, LawError, closed_form_error, disturbed
from companion.sim.model_error import WITHOUT_OFFSETS, model_error
from companion.vehicles import QUAD, default_vehicle
from models.effects import adopted
from models.surrogate.empty import empty_model
from models.vehicle import load_vehicle

TANDEM = default_vehicle()
VEHICLES = [TANDEM, load_vehicle(QUAD)]


def shares(error: LawError) -> tuple[float, float, float]:
    return error.lift, error.pull, error.tilt


@pytest.mark.parametrize("vehicle", VEHICLES, ids=["tandem", "quad"])
def test_the_truth_is_not_wrong_its_mirror_twice_and_no_model_is_by_all_of_it(vehicle):
    true = TrueModel(vehicle, NOMINAL)
    assert shares(model_error(true, vehicle, NOMINAL)) == pytest.approx((0.0,) * 3, abs=1e-9)  # type: ignore[arg-type]
    mirrored = WarpedModel(true, gain=-1.0)
    assert shares(model_error(mirrored, vehicle, NOMINAL)) == pytest.approx((2.0,) * 3)  # type: ignore[arg-type]
    assert shares(model_error(empty_model(vehicle), vehicle, NOMINAL)) == pytest.approx(
        (WITHOUT_OFFSETS,) * 3
    )


def test_the_default_is_as_wrong_as_the_law_that_it_was_trained_on():
    law = disturbed(3)
    assert shares(model_error(models.load(), TANDEM, law)) == pytest.approx(
        shares(closed_form_error(law)), abs=0.02
    )


def test_a_model_of_another_air_is_said_to_be_worse_than_none():
    error = model_error(models.load("corner_cfd"), TANDEM, disturbed(3))
    assert error.lift > 2.0
    assert error.pull > 2.0


def test_adopted_effects_belong_to_the_model():
    ground = adopted("ground_effect", {"gain": 0.4, "length_radii": 0.7})
    error = model_error(empty_model(TANDEM).with_effects((ground,)), TANDEM, NOMINAL)
    assert error.lift < 0.9
    assert (error.pull, error.tilt) == pytest.approx((1.0, 1.0))
