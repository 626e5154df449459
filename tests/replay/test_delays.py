"""How sure it is that thrust changed by command: by the correlation of lift and accelerometer, without a threshold."""

from __future__ import annotations

import pytest

from replay.residual.delays import Delay, commanded


def sure(correlation: float, seconds: float = 50.0) -> float:
    return commanded(Delay("servo outputs", 0.0, correlation, True), seconds)


def test_no_correlation_decides_by_its_last_digits() -> None:
    assert sure(0.597) == pytest.approx(0.5, abs=0.05)
    assert abs(sure(0.603) - sure(0.597)) < 0.05


def test_a_flight_in_wind_of_which_less_is_felt_may_still_be_flown_by_command() -> None:
    """Odds that some evidence overcomes: flights in 12 m/s of wind have correlations down to a half."""
    assert sure(0.525) > 0.1
    assert sure(0.71) > 0.8
    assert sure(0.95) > 0.999


def test_noise_is_no_command() -> None:
    assert sure(0.1) < 1e-3
    assert sure(0.0, 120.0) < 1e-6
    assert sure(-0.5) < sure(0.0)


def test_a_longer_flight_says_more() -> None:
    assert sure(0.8, 300.0) > sure(0.8, 8.0)
    assert sure(0.4, 300.0) < sure(0.4, 8.0)
