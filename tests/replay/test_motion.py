"""What of the rotor speeds a log carries."""

from __future__ import annotations

import numpy as np
import pytest

from models.common.frames import Array
from replay.flightlog import Series
from replay.residual.motion import carried_hz


def series(t_s: Array) -> Series:
    return Series(t_s, np.ones((len(t_s), 1)))


def test_a_steady_record_carries_its_rate() -> None:
    assert carried_hz(series(np.arange(100) * 0.1)) == pytest.approx(10.0)


def test_every_third_sample_missing_halves_what_is_carried() -> None:
    """Two thirds of the time lie in steps of twice the length; the median step stays as it was."""
    t_s = np.arange(300) * 0.1
    thinned = series(np.delete(t_s, np.arange(2, 300, 3)))
    assert thinned.rate_hz == pytest.approx(10.0)
    assert carried_hz(thinned) == pytest.approx(5.0)


def test_a_long_gap_does_not_count() -> None:
    """What is not bridged is not judged."""
    t_s = np.concatenate([np.arange(100) * 0.1, 100.0 + np.arange(100) * 0.1])
    assert carried_hz(series(t_s)) == pytest.approx(10.0)


def test_samples_that_come_in_pairs_carry_the_rate_of_pairs() -> None:
    pairs = np.repeat(np.arange(100) * 0.1, 2)
    pairs[1::2] += 0.001
    assert carried_hz(series(pairs)) == pytest.approx(1.0 / 0.099)
