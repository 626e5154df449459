"""The filter of the sizes: least squares, a gate for what is not excited, and no run-away."""

from __future__ import annotations

from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest

from companion.adaptation import filter as sizes_filter
from companion.adaptation.filter import excites, predict
from companion.adaptation.sizes import (
    FIRST_EFFECT,
    GAINS,
    Size,
    Sizes,
    estimates,
    prior,
    size_table,
)
from companion.disturbance.adopted_effects import effects_with_size
from companion.vehicles import default_vehicle
from models import load
from models.effects import InFlight, catalogue, get
from models.effects.adopted_effect import AdoptedEffect

RNG = np.random.default_rng(5)
FREE = {"excited": 0.0, "robust_sigmas": 1e9}


def table(n: int = 4, sd: float = 1.0, per_minute: float = 0.1) -> tuple[Size, ...]:
    return tuple(
        Size(
            name=f"s{k}",
            unit="1",
            as_modelled=1.0,
            mean=1.0,
            sd=sd,
            per_minute=per_minute,
            low=-5.0,
            high=7.0,
        )
        for k in range(n)
    )


def update(
    sizes: tuple[Size, ...], believed: Sizes, value: float, row: np.ndarray, variance: float, *, excited: float,
    robust_sigmas: float,
) -> Sizes:  # fmt: skip
    """One axis, with the sizes that it excites."""
    with mock.patch.multiple(sizes_filter, _EXCITED=excited, ROBUST_SIGMAS=robust_sigmas):
        (moves,) = excites(sizes, row[None], np.array([variance]))
        return sizes_filter.update(sizes, believed, value, row, variance, moves)


def test_it_is_least_squares_with_a_prior():
    sizes = table()
    rows, noise = RNG.normal(size=(60, 4)), 0.3
    truth = np.array([0.5, -0.2, 0.1, -0.7])
    seen = rows @ truth + noise * RNG.normal(size=60)
    believed = prior(sizes)
    for row, value in zip(rows, seen, strict=True):
        believed = update(sizes, believed, float(value), row, noise**2, **FREE)
    information = rows.T @ rows / noise**2 + np.eye(4)
    assert np.allclose(believed.covariance, np.linalg.inv(information), atol=1e-9)
    assert np.allclose(
        believed.offset, np.linalg.solve(information, rows.T @ seen / noise**2), atol=1e-9
    )


def test_a_size_that_is_not_excited_keeps_its_value_and_the_covariance_stays_one():
    sizes, believed = table(), prior(table())
    both = np.array([1.0, 1.0, 0.0, 0.0])
    believed = update(sizes, believed, 1.0, both, 0.1, **FREE)
    faint = np.array([1.0, 0.01, 0.0, 0.0])
    after = update(sizes, believed, 5.0, faint, 0.1, excited=0.2, robust_sigmas=1e9)
    assert after.offset[1] == believed.offset[1]
    assert after.offset[0] != believed.offset[0]
    assert np.linalg.eigvalsh(after.covariance).min() > 0.0
    nothing = update(sizes, believed, 5.0, 0.01 * both, 0.1, excited=0.2, robust_sigmas=1e9)
    assert nothing is believed


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_a_number_is_not_learned(value):
    believed = prior(table())
    assert update(table(), believed, value, np.ones(4), 0.1, **FREE) is believed


def test_an_outlier_counts_no_more_than_its_bound():
    sizes, believed, row = table(), prior(table()), np.array([1.0, 0.0, 0.0, 0.0])
    near = update(sizes, believed, 3.0, row, 0.25, excited=0.2, robust_sigmas=2.5)
    far = update(sizes, believed, 1e6, row, 0.25, excited=0.2, robust_sigmas=2.5)
    assert far.offset[0] < 1.2 * near.offset[0]


def test_values_stay_within_their_bounds():
    sizes, believed = table(), prior(table())
    for _ in range(50):
        believed = update(sizes, believed, 100.0, np.array([1.0, 0.0, 0.0, 0.0]), 0.01, **FREE)
    assert believed.offset[0] == 6.0


def test_time_makes_less_sure_by_the_minute_and_never_less_than_before_any_flight():
    sizes, believed = table(per_minute=0.1), prior(table())
    believed = update(sizes, believed, 0.3, np.array([1.0, 0.0, 0.0, 0.0]), 1e-6, **FREE)
    minute = believed
    for _ in range(300):
        minute = predict(sizes, minute, 0.2)
    assert minute.sd(0) == pytest.approx(0.1, rel=1e-3)
    assert minute.offset[0] == believed.offset[0]
    assert predict(sizes, believed, 1e6).sd(0) == pytest.approx(1.0)
    assert predict(sizes, believed, 1e6).sd(1) == pytest.approx(1.0)


def test_the_covariance_stays_a_covariance_over_an_hour():
    sizes = size_table(default_vehicle(), load())
    believed = prior(sizes)
    for _ in range(5000):
        believed = predict(sizes, believed, 0.2)
        row = RNG.normal(size=len(sizes)) * RNG.choice([0.0, 0.1, 40.0], size=len(sizes))
        believed = update(
            sizes, believed, float(RNG.normal()), row, 0.3, excited=0.2, robust_sigmas=2.5
        )
    assert np.array_equal(believed.covariance, believed.covariance.T)
    assert np.linalg.eigvalsh(believed.covariance).min() > -1e-12
    assert np.isfinite(believed.offset).all()


def test_the_table_names_every_size_with_its_unit():
    sizes = size_table(default_vehicle(), load())
    assert tuple(s.name for s in sizes[: len(GAINS)]) == GAINS
    assert len(sizes) == FIRST_EFFECT
    values = estimates(sizes, prior(sizes))
    assert values["ground_lift"].value == 1.0
    assert values["wind_north"].unit == "m/s"
    assert all(low.low < low.mean < low.high and low.sd > 0.0 for low in sizes)


def test_sizes_are_never_changed_in_place():
    believed = prior(table())
    before = Sizes(believed.offset.copy(), believed.covariance.copy())
    update(table(), believed, 1.0, np.ones(4), 0.1, **FREE)
    predict(table(), believed, 3.0)
    assert np.array_equal(believed.offset, before.offset)
    assert np.array_equal(believed.covariance, before.covariance)


def test_only_effects_that_say_so_have_a_size_of_their_own():
    """What is not compensated in flight, or is steady, has none; a new effect has none unless its file says so."""
    effects = tuple(AdoptedEffect(e.name) for e in catalogue())
    named = [effects[k].name for k in effects_with_size(SimpleNamespace(effects=effects))]
    assert sorted(named) == [
        "ceiling",
        "corner_effect",
        "ground_effect",
        "second_wall",
        "wall_effect",
    ]
    assert all(get(name).in_flight.use is InFlight.WRENCH for name in named)
