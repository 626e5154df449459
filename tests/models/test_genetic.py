"""The genetic algorithm, operator by operator, against the paper's equations with their misprints resolved."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.common.frames import Array
from models.training import genetic
from models.training.genetic import Settings


def _rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_fitness_is_the_inverse_error_and_bounded_at_a_perfect_fit() -> None:
    """Eq. 13."""
    assert genetic.fitness(np.array([[0.5]]))[0, 0] == pytest.approx(2.0)
    assert np.isfinite(genetic.fitness(np.zeros((1, 1)))[0, 0])


def test_roulette_draws_in_proportion_to_fitness_and_never_across_runs() -> None:
    """Eq. 14, with the sum over the population."""
    f = np.tile(np.array([[1.0, 2.0, 3.0, 4.0]]), (5000, 1))
    chosen = genetic.select(f, _rng())
    share = np.bincount(chosen.ravel(), minlength=4) / chosen.size
    np.testing.assert_allclose(share, [0.1, 0.2, 0.3, 0.4], atol=0.02)
    lone = np.zeros((2, 50))
    lone[0, 7] = lone[1, 31] = 1.0
    assert np.all(genetic.select(lone, _rng())[0] == 7)
    assert np.all(genetic.select(lone, _rng())[1] == 31)


@settings(deadline=None)
@given(seed=st.integers(0, 1000), pop=st.integers(2, 9))
def test_crossover_mixes_two_parents(seed: int, pop: int) -> None:
    """Eq. 15 as printed mixes a gene with itself; corrected: other genes, the same sum, between the parents."""
    parents = _rng(seed).normal(size=(3, pop, 5))
    children = genetic.crossover(parents, 1.0, _rng(seed + 1))
    pairs = pop // 2 * 2
    first, second = parents[:, 0:pairs:2], parents[:, 1:pairs:2]
    a, b = children[:, 0:pairs:2], children[:, 1:pairs:2]
    np.testing.assert_allclose(a + b, first + second, atol=1e-12)
    low, high = np.minimum(first, second), np.maximum(first, second)
    for child in (a, b):
        assert np.all((child >= low - 1e-12) & (child <= high + 1e-12))
    assert not np.allclose(a, first)
    np.testing.assert_array_equal(children[:, pairs:], parents[:, pairs:])


def test_crossover_happens_to_its_share_of_pairs() -> None:
    parents = _rng(0).normal(size=(200, 50, 3))
    children = genetic.crossover(parents, 0.7, _rng(1))
    crossed = np.any(children != parents, axis=2).mean()
    assert crossed == pytest.approx(0.7, abs=0.03)


def test_mutation_probability_follows_eq_16_with_its_gaps_closed() -> None:
    s = Settings(m1=0.5, m2=0.4, least_mutation=0.01)
    f = np.array([[1.0, 2.0, 3.0, 6.0]])  # mean 3, so the third is exactly average: fit, by >=
    k = genetic.mutation_probability(f, s)[0]
    np.testing.assert_allclose(k, [0.4, 0.4, 0.5, 0.01])
    equal = genetic.mutation_probability(np.full((1, 4), 2.0), s)
    np.testing.assert_array_equal(equal, 0.4)


def test_the_fitter_of_the_fit_mutate_less() -> None:
    f = np.linspace(1.0, 10.0, 50)[None]
    k = genetic.mutation_probability(f, Settings())[0]
    fit = k[f[0] >= f.mean()]
    assert np.all(np.diff(fit) <= 0.0)


def test_mutation_shrinks_with_the_generations_and_stays_in_bounds() -> None:
    s = Settings(bound=1.0)
    genes = _rng().uniform(-1, 1, (4, 50, 46))
    early = genetic.mutate(genes, np.ones((4, 50)), 0.0, s, _rng(1)) - genes
    late = genetic.mutate(genes, np.ones((4, 50)), 0.9, s, _rng(1)) - genes
    assert np.abs(late).max() < 0.1 * np.abs(early).max()
    assert np.abs(early + genes).max() <= 1.0
    np.testing.assert_allclose(genetic.mutate(genes, np.ones((4, 50)), 1.0, s, _rng(1)), genes)


def _sphere(population: Array) -> Array:
    out: Array = ((population - 0.3) ** 2).mean(axis=-1)
    return out


def test_the_best_never_gets_worse_and_every_run_improves() -> None:
    errors = []

    def watched(population: Array) -> Array:
        mse = _sphere(population)
        errors.append(mse.min(axis=1))
        return mse

    best, mse = genetic.evolve(watched, 6, 10, _rng(), Settings(generations=60))
    starts = errors[0]
    after_mutation = np.array(errors[2::2])
    assert np.all(np.diff(np.minimum.accumulate(after_mutation, axis=0), axis=0) <= 0.0)
    assert np.all(np.diff(after_mutation, axis=0) <= 1e-15), "the elite is kept"
    assert np.all(mse < 0.2 * starts)
    np.testing.assert_allclose(_sphere(best[:, None])[:, 0], mse, rtol=1e-4)


def test_it_repeats_by_seed() -> None:
    one = genetic.evolve(_sphere, 2, 4, _rng(5), Settings(generations=10))[0]
    other = genetic.evolve(_sphere, 2, 4, _rng(5), Settings(generations=10))[0]
    np.testing.assert_array_equal(one, other)
