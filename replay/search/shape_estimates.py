"""The interval of a shape parameter: by the values that were tried, the other sets, and the folds of the flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from models.common.frames import Array
from replay.search.estimates import SIDE, IntervalEstimate, jackknife
from replay.search.evidence import Evidence, Fit
from replay.search.held_out import folds_of
from replay.search.posterior import Walked
from replay.search.terms import Term
from replay.search.thresholds import TRUST


def shape_estimates(
    walked: Walked, term: Term, flights: Sequence[int]
) -> tuple[IntervalEstimate, ...]:
    """Every shape parameter of a term of the best set."""
    return tuple(_shape_estimate(walked, term, i, flights) for i in range(len(term.named.shapes)))


def _shape_estimate(walked: Walked, term: Term, i: int, flights: Sequence[int]) -> IntervalEstimate:
    """A shape parameter with its 95 % interval, and whether it stands at the grid's edge.

    The density over the values tried goes with exp(TRUST gain in log evidence), each out to half way to the next, the
    other parameters at their likeliest. It is no narrower than the folds and the other sets say.
    """
    shape = term.named.shapes[i]
    value = float(term.shape[i])
    without_interval = IntervalEstimate(name=shape.name, value=value, ci95=None, unit=shape.unit)
    if not shape.continuous or value in shape.kinds:
        return without_interval
    gains = _profile(walked, term, i)
    if len(gains) < 2:
        return without_interval
    tried = np.array(sorted(gains))
    low, high = _central_interval(tried, np.array([gains[v] for v in tried]))
    of_sets = _between_shapes(walked, term, i)
    of_folds = _folds_variance(walked, term, i, flights)
    half = SIDE * np.sqrt(of_sets + of_folds)
    low = min(low, value - half)
    high = max(high, value + half)
    if tried[0] >= 0.0:
        low = max(low, 0.0)
    at_edge = value in (tried[0], tried[-1])
    free = value == 0.0 and shape.free_at_zero
    return replace(
        without_interval,
        ci95=(float(low), float(high)),
        at_bound=bool(at_edge and not free),
    )


def _central_interval(values: Array, log_density: Array) -> tuple[float, float]:
    """95 % of a density that is constant about each of some values (v,), out to half way to the next."""
    density = np.exp(log_density - log_density.max())
    between = (values[1:] + values[:-1]) / 2.0
    edges = np.concatenate([values[:1], between, values[-1:]])
    mass = np.cumsum(density * np.diff(edges))
    cumulative = np.concatenate([[0.0], mass / mass[-1]])
    low, high = np.interp([0.025, 0.975], cumulative, edges)
    return float(low), float(high)


def _profile(walked: Walked, term: Term, i: int) -> dict[float, float]:
    """By value of a shape parameter the largest TRUST gain in log evidence beside the other terms of the best set."""
    evidence = walked.evidence
    library = evidence.library
    kinds = term.named.shapes[i].kinds
    beside = evidence.refit(walked.best.terms_without(term), walked.best.noise)
    screened = evidence.screen(beside, term.key)
    gains: dict[float, float] = {}
    for number in library.numbers_of[term.key]:
        value = library.terms[number].shape[i]
        gain = TRUST * float(screened[number])
        if value not in kinds:
            gains[value] = max(gains.get(value, -np.inf), gain)
    return gains


def _between_shapes(walked: Walked, term: Term, i: int) -> float:
    """Variance of a shape parameter over the sets that hold the effect, by their probability, about this one."""
    out = 0.0
    total = 0.0
    for fit, weight in walked.weighted():
        for other in fit.terms:
            if other.key == term.key:
                deviation = other.shape[i] - term.shape[i]
                out += weight * deviation**2
                total += weight
    return out / max(total, 1e-12)


def _folds_variance(walked: Walked, term: Term, i: int, flights: Sequence[int]) -> float:
    """Jackknife variance of a shape parameter; 0 where it was tried on one side only.

    Every fold has its own likeliest value: the vertex of the parabola through the log posteriors of the value found
    and of its neighbours on the grid.
    """
    evidence = walked.evidence
    best = walked.best
    neighbours = _beside_each_other(evidence, term, i)
    if neighbours is None:
        return 0.0
    values = np.array([t.shape[i] for t in neighbours])
    tried = [t.shape[i] for t in evidence.library.with_key(term.key)]
    number = best.terms.index(term)
    before = best.terms[:number]
    after = best.terms[number + 1 :]
    sets = [(*before, t, *after) for t in neighbours]
    variance = 0.0
    for flight in flights:
        vertices = []
        for left_out in folds_of(evidence.library, flight):
            fits = [evidence.refit(terms, best.noise, {flight: left_out}) for terms in sets]
            heights = np.array([_log_posterior(fit) for fit in fits])
            vertices.append(_vertex(values, heights))
        likeliest = np.clip(vertices, min(tried), max(tried))
        variance += float(jackknife(likeliest[:, None])[0])
    return variance


def _beside_each_other(evidence: Evidence, term: Term, i: int) -> tuple[Term, Term, Term] | None:
    """The terms below, at and above a value of a shape parameter, all else the same; None at an edge."""
    value = term.shape[i]
    kinds = term.named.shapes[i].kinds
    others = {}
    for other in evidence.library.with_key(term.key):
        with_value = (*other.shape[:i], value, *other.shape[i + 1 :])
        if with_value == term.shape and other.shape[i] not in kinds:
            others[other.shape[i]] = other
    below = [v for v in others if v < value]
    above = [v for v in others if v > value]
    if not below or not above:
        return None
    return others[max(below)], term, others[min(above)]


def _log_posterior(fit: Fit) -> float:
    """Of a refitted set beside its noise, up to what is the same for all sets: 1/2 (b^T A b + log det A^-1)."""
    b_a_b = float(fit.b @ np.linalg.solve(fit.cov, fit.b))
    log_det = float(np.linalg.slogdet(fit.cov)[1])
    return 0.5 * b_a_b + 0.5 * log_det


def _vertex(x: Array, y: Array) -> float:
    """Where the parabola through three points is highest."""
    slopes = np.diff(y) / np.diff(x)
    bend = (slopes[1] - slopes[0]) / (x[2] - x[0])
    if bend >= 0.0:
        return float(x[int(np.argmax(y))])
    return float(0.5 * (x[0] + x[1]) - slopes[0] / (2.0 * bend))
