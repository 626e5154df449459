"""What accelerations have added since a late position was measured, against exact motions."""

from __future__ import annotations

import math

import pytest

from companion.control.dead_reckoning import KEPT_S, Reckoning, accelerated, gained_since

STEP_S = 0.02


def reckoned(seconds: float, north_m_s2: float = 1.0) -> Reckoning:
    """A vehicle that accelerates evenly."""
    out: Reckoning = ()
    for k in range(round(seconds / STEP_S) + 1):
        out = accelerated(out, k * STEP_S, STEP_S, (north_m_s2, 0.0, -2.0 * north_m_s2))
    return out


@pytest.mark.parametrize("age_s", [0.0, 0.03, 0.10, 0.25, 0.35])
def test_an_even_acceleration_adds_a_t_and_half_a_t_squared(age_s):
    gained = gained_since(reckoned(2.0), 2.0 - age_s)
    assert gained.velocity == pytest.approx((age_s, 0.0, -2.0 * age_s), abs=1e-9)
    half = 0.5 * age_s**2
    # Between two sums the place is interpolated.
    assert gained.place == pytest.approx((half, 0.0, -2.0 * half), abs=0.5 * STEP_S**2)


def test_what_was_before_the_position_does_not_count():
    reckoning = reckoned(1.0)
    for k in range(20):
        reckoning = accelerated(reckoning, 1.0 + (k + 1) * STEP_S, STEP_S, (0.0, 0.0, 0.0))
    gained = gained_since(reckoning, 1.0)
    assert gained.velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert gained.place == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_an_older_position_is_carried_on_no_further():
    reckoning = reckoned(2.0)
    assert gained_since(reckoning, -1.0) == gained_since(reckoning, 2.0 - KEPT_S)
    assert len(reckoning) <= KEPT_S / STEP_S + 2


def test_a_position_from_before_the_beginning_gets_what_is_known():
    gained = gained_since(reckoned(0.1), -0.1)
    assert gained.velocity[0] == pytest.approx(0.1)


def test_a_position_of_now_gets_nothing():
    gained = gained_since(reckoned(1.0), 1.0)
    assert gained.velocity == (0.0, 0.0, 0.0)
    assert gained.place == (0.0, 0.0, 0.0)


def test_a_swing_is_carried_on_as_it_was_flown():
    """The newest acceleration times the age would be off by half of it."""
    rate = 2.0 * math.pi
    reckoning: Reckoning = ()
    for k in range(101):
        t_s = 0.01 * k
        reckoning = accelerated(reckoning, t_s, 0.01, (math.cos(rate * t_s), 0.0, 0.0))
    exact = -math.sin(rate * 0.75) / rate
    assert gained_since(reckoning, 0.75).velocity[0] == pytest.approx(exact, abs=0.01)
