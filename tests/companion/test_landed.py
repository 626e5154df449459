"""A land detector that is wrong in the air, and one that is right."""

from __future__ import annotations

import math

from flying import bench

from companion.control.landed import flies_all_the_same, standing_height
from companion.control.reasons import Notice, Reason
from companion.estimation.surfaces import Seen, Surface
from companion.telemetry.status import said_of

STANDING_M, HELD_M = 0.15, 0.45


def flown():
    """Stood on the ground, and is held in the air."""
    b = bench(height=STANDING_M, rpm=1200.0, landed=1)
    assert Reason.LANDED in b.run(1.0).reasons
    b.rpm, b.landed = 4000.0, 2
    for k in range(1, 31):
        b.height = STANDING_M + k / 30.0 * (HELD_M - STANDING_M)
        b.run(0.05)
    assert b.run(6.0).reasons == ()
    return b


def test_the_hold_goes_on_where_rotors_and_range_contradict_the_land_detector():
    b = flown()
    b.landed = 1
    decision = b.run(2.0)
    assert decision.reasons == ()
    assert decision.command is not None
    assert decision.notice is not None
    assert decision.notice[0] is Notice.LANDED_OVERRULED


def test_rotors_that_slow_down_are_a_landing():
    b = flown()
    b.landed, b.rpm = 1, 2500.0
    assert Reason.LANDED in b.run(1.0).reasons
    assert b.state.held.hold is None


def test_the_ground_as_near_as_before_take_off_is_a_landing():
    b = flown()
    b.height = STANDING_M + 0.02
    b.run(0.5)
    b.landed = 1
    decision = b.run(0.3)
    assert Reason.LANDED in decision.reasons
    assert decision.command is None


def test_a_companion_that_never_saw_it_stand_believes_the_land_detector():
    b = bench(height=HELD_M)
    assert b.run(4.0).reasons == ()
    b.landed = 1
    assert Reason.LANDED in b.run(0.3).reasons


def test_without_a_ground_range_the_land_detector_is_believed():
    assert not flies_all_the_same(Surface(Seen.STALE), STANDING_M, carried=True, holding=True)
    near = Surface(Seen.SURFACE, HELD_M)
    assert flies_all_the_same(near, STANDING_M, carried=True, holding=True)
    assert not flies_all_the_same(near, STANDING_M, carried=True, holding=False)
    assert math.isnan(standing_height(math.nan, Surface(Seen.LOST), airborne=False))
    assert standing_height(0.15, near, airborne=True) == 0.15


def test_a_disarmed_flag_is_obeyed_and_the_pilot_told_that_the_rotors_carry_it():
    b = flown()
    b.armed = False
    decision = b.run(1.0)
    assert decision.command is None
    assert (
        "not armed, though the vehicle flies: nothing is sent, take over"
        in said_of(b.state, decision)[0]
    )
