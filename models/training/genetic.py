"""The paper's genetic algorithm (section 3.3), many independent runs at once, with its printed errors resolved.

A chromosome is every weight and bias of one net: n_in n_hid + n_hid + n_hid + 1 genes (eq. 12; 46 for 3-9-1). All
arrays lead with (runs, population): no loop over individuals, only over generations. What the paper leaves open or
misprints: crossover (eq. 15) mixes a gene with itself as printed, so here with the partner's; in the adaptive mutation
(eq. 16) K is the probability of mutating a gene, f = f_avg counts as fit, and a population of equals does not divide by
zero; population, generations, crossover share and gene bounds are not given and chosen here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array

Genes = NDArray[np.float32] | Array
Index = NDArray[np.intp]
Evaluate = Callable[[Genes], Array]
"""Mean squared errors (runs, pop) of chromosomes (runs, pop, genes)."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Choices the paper does not print; gene bounds are those of the first population and of mutation."""

    population: int = 50
    generations: int = 100
    crossover_share: float = 0.7
    first_bound: float = 1.0
    bound: float = 3.0
    m1: float = 0.5
    m2: float = 0.5
    least_mutation: float = 0.01
    step: float = 0.5


def fitness(mse: Array) -> Array:
    """f = 1/MSE (eq. 13), bounded at a perfect fit."""
    return 1.0 / (mse + 1e-12)


def select(f: Array, rng: np.random.Generator) -> Index:
    """Roulette (eq. 14), p_i = f_i / sum_j f_j: indices (runs, pop) drawn with replacement within each run."""
    wheel = np.cumsum(f, axis=1)
    draws = rng.random(f.shape) * wheel[:, -1:]
    passed = draws[:, :, None] > wheel[:, None, :]
    chosen: Index = np.minimum(passed.sum(axis=2), f.shape[1] - 1)
    return chosen


def crossover(parents: Genes, share: float, rng: np.random.Generator) -> Genes:
    """Arithmetic crossover (eq. 15, corrected) of neighbours 0-1, 2-3, ..., each pair with probability ``share``.

    g'_m = g_m (1 - a) + g_n a and g'_n = g_n (1 - a) + g_m a with one a ~ U(0, 1) per pair of genes: sums are kept and
    children stay between their parents.
    """
    children = parents.copy()
    second = children[:, 1::2]
    first = children[:, ::2][:, : second.shape[1]]
    mix = rng.random(first.shape, dtype=np.float32)
    crossed = rng.random(first.shape[:2]) < share
    exchange = mix * crossed[..., None] * (second - first)
    first += exchange
    second -= exchange
    return children


def mutation_probability(f: Array, settings: Settings) -> Array:
    """K (runs, pop), eq. 16: m1 (f_max - f)/(f_max - f_avg) for f >= f_avg, else m2; the fitter the less."""
    top = f.max(axis=1, keepdims=True)
    average = f.mean(axis=1, keepdims=True)
    spread = top - average
    equal = spread < 1e-12 * np.maximum(top, 1e-300)
    of_fit = settings.m1 * (top - f) / np.where(equal, 1.0, spread)
    k = np.where((f >= average) & ~equal, of_fit, settings.m2)
    out: Array = np.clip(k, settings.least_mutation, 1.0)
    return out


def mutate(
    genes: Genes, probability: Array, progress: float, settings: Settings, rng: np.random.Generator
) -> Genes:
    """Non-uniform steps on genes chosen with K: normal, shrinking as (1 - progress)^2, clipped to the bounds.

    K of eq. 16 is spread over the chromosome's weights in fifths: 0.5 of all genes at once would be a new individual.
    """
    draws = rng.random(genes.shape, dtype=np.float32)
    hit = np.flatnonzero(draws < (0.2 * probability)[..., None])
    size = np.float32(settings.step * (1.0 - progress) ** 2)
    step = rng.standard_normal(len(hit), dtype=np.float32) * size
    mutants = genes.copy()
    flat = mutants.ravel()
    flat[hit] = np.clip(flat[hit] + step, -settings.bound, settings.bound)
    return mutants


def evolve(
    evaluate: Evaluate,
    runs: int,
    genes: int,
    rng: np.random.Generator,
    settings: Settings | None = None,
    tick: Callable[[int, int], None] = lambda *_: None,
) -> tuple[Array, Array]:
    """Evolve ``runs`` populations; returns the best chromosome (runs, genes) and its error (runs,) of each.

    The best so far replaces one individual of each new generation, so the error never grows.
    """
    s = settings or Settings()
    shape = (runs, s.population, genes)
    population: Genes = rng.uniform(-s.first_bound, s.first_bound, shape).astype(np.float32)
    every = np.arange(runs)
    mse = evaluate(population)
    leader = mse.argmin(axis=1)
    best = population[every, leader].copy()
    best_mse = mse[every, leader].copy()
    for generation in range(s.generations):
        chosen = select(fitness(mse), rng)
        parents = population[every[:, None], chosen]
        children = crossover(parents, s.crossover_share, rng)
        fit = fitness(evaluate(children))
        probability = mutation_probability(fit, s)
        progress = generation / s.generations
        population = mutate(children, probability, progress, s, rng)
        population[:, 0] = best
        mse = evaluate(population)
        leader = mse.argmin(axis=1)
        leader_mse = mse[every, leader]
        better = leader_mse < best_mse
        best[better] = population[every, leader][better]
        best_mse[better] = leader_mse[better]
        tick(generation + 1, s.generations)
    return best.astype(float), best_mse
