"""A model or vehicle file of another vehicle is noticed in flight, and no offset is given from it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from flying import CONFIG, Bench, bench

from companion.control.reasons import Reason
from companion.mavlink.samples import RotorSpeeds
from companion.vehicles import default_vehicle
from models.surrogate.empty import empty_model


@pytest.mark.parametrize("rpm", [8000.0, 2800.0])
def test_a_lift_that_is_not_the_weight_gives_no_offset(rpm):
    b = bench(height=0.2, rpm=rpm)
    decision = b.run(8.0)
    assert Reason.MODEL_WRONG in decision.reasons
    assert decision.offset.thrust == 0.0
    assert decision.command is not None


def test_a_climb_is_no_wrong_model():
    b = bench(height=1.0)
    b.run(3.0)
    b.rpm = 4600.0  # a third more than the weight
    assert Reason.MODEL_WRONG not in b.run(3.0).reasons


def test_more_rotors_than_the_file_names():
    b = Bench()
    assert b.run(3.0).reasons == ()
    for _ in range(20):
        b.feed(RotorSpeeds(b.t, 1, 1, 5, (4000.0, 4000.0, 0.0, 0.0), "ESC_TELEMETRY_5_TO_8"))
        decision = b.tick()
    assert Reason.ROTORS_WRONG in decision.reasons
    b.run(1.0)
    assert Reason.ROTORS_WRONG not in b.tick().reasons


def test_silent_places_of_a_group_are_no_rotors():
    b = Bench()
    b.run(3.0)
    b.feed(RotorSpeeds(b.t, 1, 1, 5, (0.0,) * 4, "ESC_TELEMETRY_5_TO_8"))
    assert Reason.ROTORS_WRONG not in b.tick().reasons


def test_without_a_model_the_hold_flies_and_says_why_there_is_no_offset():
    b = Bench(config=replace(CONFIG, model=empty_model(default_vehicle())), height=0.2)
    decision = b.run(4.0)
    assert decision.reasons == (Reason.NO_MODEL,)
    assert decision.command is not None
