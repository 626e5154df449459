"""A flight under a set: what its effects remove from time that they were not fitted on."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from made_up import biased, some

from replay.search.evidence import Evidence, Fit
from replay.search.held_out import EMBARGO_S, FOLDS, FlightFit, _split, flight_fits
from replay.search.library import Library

STEP_S = 0.02


def fitted(*records: object) -> tuple[Evidence, Fit]:
    evidence = Evidence(Library(list(records), some("imu_bias")))  # type: ignore[arg-type]
    terms = list({t.key: t for t in evidence.library.terms if t.effect is not None}.values())
    return evidence, evidence.fit(terms, evidence.noises.unfitted)


@pytest.fixture(scope="module")
def alone() -> FlightFit:
    (fit,) = flight_fits(*fitted(biased()))
    return fit


def test_a_true_effect_removes_energy_from_time_that_it_was_not_fitted_on(alone: FlightFit) -> None:
    (key,) = alone.effects
    assert alone.energy(alone.after) < 0.8 * alone.energy(alone.before)
    assert alone.gain(key, [0]) > 0.0
    assert alone.gain(key, [0]) > 10.0 * abs(alone.gain(key, [1]))


def test_before_is_after_and_what_every_effect_took_away(alone: FlightFit) -> None:
    (key,) = alone.effects
    np.testing.assert_allclose(alone.after + alone.effects[key].held_out, alone.before, atol=1e-12)
    assert alone.effects[key].folds.shape[0] > 1


def test_an_axis_is_taken_off_an_effect(alone: FlightFit) -> None:
    (key,) = alone.effects
    less = alone.without_axis(key, 0)
    np.testing.assert_allclose(less.after[:, 0], alone.before[:, 0], atol=1e-12)
    np.testing.assert_allclose(less.after[:, 1:], alone.after[:, 1:])
    assert "Fx" in alone.effects[key].axes
    assert "Fx" not in less.effects[key].axes


def test_another_flight_confirms_an_effect_that_it_has_and_none_that_it_lacks() -> None:
    both = flight_fits(*fitted(biased(), biased(seed=12)))
    assert all(fit.confirms == frozenset(fit.effects) for fit in both)
    one = flight_fits(*fitted(biased(), biased(seed=12, bias=0.0)))
    assert not one[1].confirms


@pytest.mark.parametrize("seconds", [5.8, 12.0, 40.0, 300.0])
def test_a_fold_is_fitted_on_no_time_within_the_embargo_of_its_own(seconds: float) -> None:
    count = round(seconds / STEP_S)
    record = SimpleNamespace(valid=np.ones(count, bool), seconds=seconds)
    fold_of_sample, fitted_on = _split(record)  # type: ignore[arg-type]
    time_s = STEP_S * np.arange(count)
    assert set(fold_of_sample) == set(range(FOLDS))
    for fold in range(FOLDS):
        own = time_s[fold_of_sample == fold]
        away_s = np.abs(time_s[:, None] - own).min(axis=1)
        assert not fitted_on[fold][away_s < EMBARGO_S - STEP_S].any()
