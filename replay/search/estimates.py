"""Sizes of a named effect with their intervals: as they were fitted, and as people say them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri_exp

from models.common.frames import Array
from models.effects import Coefficient, Context, Effect
from replay.search.channel import hundredths
from replay.search.evidence import Evidence, Fit
from replay.search.held_out import FlightFit, folds_of
from replay.search.posterior import Walked
from replay.search.terms import Term
from replay.search.thresholds import (
    BOUND_SHARE,
    FEWEST_WITHIN,
    LEARNT,
    LEAST_SHOWN,
    TRUST,
)

DRAWS = 4000
"""Of the joint posterior: the ends of a 95 % interval are then sure to 2 % of its width."""
SIDE = 1.96
"""Standard deviations from the middle to the end of a 95 % interval."""


@dataclass(frozen=True, kw_only=True)
class IntervalEstimate:
    """One parameter with its 95 % interval; ``at_bound``: at the edge of what was tried or is possible."""

    name: str
    value: float
    ci95: tuple[float, float] | None
    """None: a kind (a fan's number) or a reference, which is not estimated."""
    unit: str
    at_bound: bool = False
    determined: bool = True
    """Whether the flights say more about it than was assumed before."""

    def as_json(self) -> dict[str, Any]:
        """Value, interval and unit; what is not determined has no value, and what is not estimated no interval."""
        out: dict[str, Any] = {"value": self.value if self.determined else None}
        if self.ci95 is not None:
            out["ci95"] = self.ci95
        out["unit"] = self.unit
        if self.at_bound:
            out["at_bound"] = True
        return out

    @property
    def holds_zero(self) -> bool:
        """Whether zero lies within its interval."""
        return self.ci95 is not None and self.ci95[0] <= 0.0 <= self.ci95[1]

    @property
    def sign_probability(self) -> float:
        """That it has the sign of its value, Phi(|b| / s); 1 where the interval leaves zero out."""
        if not self.holds_zero or not self.width:
            return 1.0
        return float(ndtr(abs(self.value) / self.width * 2.0 * SIDE))

    @property
    def width(self) -> float:
        """Of its interval; 0 where it is not estimated."""
        if self.ci95 is None:
            return 0.0
        low, high = self.ci95
        return high - low

    def times(self, factor: float, unit: str) -> IntervalEstimate:
        """In another unit."""
        scaled = replace(self, value=self.value * factor, unit=unit)
        if self.ci95 is None:
            return scaled
        low, high = self.ci95
        return replace(scaled, ci95=(low * factor, high * factor))


@dataclass(frozen=True)
class Sizes:
    """The parameters of an effect on one flight."""

    fitted: tuple[IntervalEstimate, ...]
    """As a model directory keeps them."""
    said: tuple[IntervalEstimate, ...]
    """As people say them: ``Effect.shown``."""


def sizes(walked: Walked, term: Term, fit: FlightFit, shapes: Sequence[IntervalEstimate]) -> Sizes:
    """Coefficients on a flight, then the shape (``shape_estimates``).

    Variance: the larger of the posterior's, over TRUST, and the folds' (jackknife: Efron & Stein 1981, Annals of
    Statistics 9, 586), and beside it that between the sets that hold the effect.
    """
    effect = term.named
    best = walked.best
    flight = fit.index
    context = fit.record.context
    part = best.part(term)
    place = term.place(flight)
    mean = effect.mixed(best.sizes(term, flight), term.shape)
    root = np.linalg.cholesky(best.cov[part, part][np.ix_(place, place)])
    root = effect.mixed((term.scale[place, None] * root).T, term.shape)
    posterior = (root**2).sum(axis=0) / TRUST
    drawn = effect.mixed(fit.effects[term.key].folds, term.shape)
    variance = np.maximum(posterior, _jackknife(drawn))
    sd = np.sqrt(variance + _between(walked, term, flight, mean))
    fitted: list[IntervalEstimate] = []
    possible: list[IntervalEstimate] = []
    for i, coefficient in enumerate(effect.coefficients):
        shown = 1.0
        if coefficient.foretold:
            wrenches, _ = walked.evidence.library.wrenches(term, flight)
            shown = _share_of_lines(fit, mean[i] * wrenches[..., i])
        one, within = _interval(effect, coefficient, context, mean[i], float(sd[i]), shown)
        fitted.append(one)
        possible.append(replace(one, ci95=within))
    # The correlations are the posterior's, the spreads those of the intervals.
    wider = sd / np.sqrt(np.maximum(posterior, 1e-300) * TRUST)
    normal = np.random.default_rng(0).standard_normal((DRAWS, len(mean)))
    draws = _within(mean + (normal @ root) * wider, effect, context)
    by_name = {c.name: draws[:, i] for i, c in enumerate(effect.coefficients)}
    by_name |= {e.name: _drawn(e, len(draws)) for e in shapes}
    return Sizes(
        fitted=(*fitted, *shapes), said=said(effect, context, [*possible, *shapes], by_name)
    )


def _interval(
    effect: Effect, c: Coefficient, context: Context, mean: float, sd: float, shown: float
) -> tuple[IntervalEstimate, tuple[float, float]]:
    """A coefficient of N(``mean``, ``sd``^2), and the part of its interval that is possible.

    ``shown``: share of the line that least squares show, by which the upper end is divided.
    """
    low = c.least(context)
    high = c.most(context)
    typical = c.spread(context)
    value = float(np.clip(mean, low, high))
    half = SIDE * sd
    edge = BOUND_SHARE * min(high - low, 10.0 * typical)
    at_bound = min(value - low, high - value) < edge and half > 0.0
    estimate = IntervalEstimate(
        name=c.name,
        value=value,
        ci95=(min(value, mean - half), max(value, mean + half) / shown),
        unit=c.unit,
        at_bound=at_bound and c.name in effect.main_names,
        determined=sd < LEARNT / np.sqrt(TRUST) * typical,
    )
    least, most = _within_bounds(mean, sd, low, high)
    return estimate, (least, min(most / shown, high))


def _drawn(shape: IntervalEstimate, count: int) -> Array:
    """Draws (count,) of a shape parameter: normal, with its interval, and within it."""
    if shape.ci95 is None:
        return np.full(count, shape.value)
    low, high = shape.ci95
    sd = shape.width / (2.0 * SIDE)
    return np.clip(shape.value + sd * np.random.default_rng(1).standard_normal(count), low, high)


def said(
    effect: Effect, context: Context, fitted: Sequence[IntervalEstimate], draws: Mapping[str, Array]
) -> tuple[IntervalEstimate, ...]:
    """Parameters as people say them, by draws (m,) of all of them: weighted quantiles of the quantities."""
    shown = effect.shown
    quantities = {q.instead_of: q for q in shown.quantities}
    if shown.log_weight is None:
        log_weight = np.zeros(1)
    else:
        log_weight = shown.log_weight(context, draws)
    weight = np.exp(log_weight - log_weight.max())
    out = []
    for e in fitted:
        quantity = quantities.get(e.name)
        if quantity is None:
            out.append(e)
        elif quantity.of is None:
            out.append(replace(e, name=quantity.name, unit=quantity.unit))
        else:
            low, value, high = _quantiles(quantity.of(context, draws), weight)
            out.append(
                IntervalEstimate(
                    name=quantity.name,
                    value=value,
                    ci95=(low, high),
                    unit=quantity.unit,
                    at_bound=e.at_bound,
                    determined=e.determined,
                )
            )
    return tuple(out)


def shape_estimates(
    walked: Walked, term: Term, flights: Sequence[int]
) -> tuple[IntervalEstimate, ...]:
    """Every shape parameter of a term of the best set."""
    return tuple(_shape_estimate(walked, term, i, flights) for i in range(len(term.named.shapes)))


def _share_of_lines(fit: FlightFit, wrench: Array) -> float:
    """r^2 of a contribution x (n, 6) and of y, itself and what is left beside it, over all axes on which it acts.

    Where x has errors of its own, least squares of y on x give too little, and those of x on y, the first over r^2, too
    much: the truth lies between both (Frisch 1934, Statistical Confluence Analysis; Klepper & Leamer 1984, Econometrica
    52, 163).
    """
    valid = fit.record.valid
    unit = hundredths(fit.record.context)
    x = (wrench / unit)[valid]
    acts = np.isin(np.arange(6), fit.record.axes) & (x != 0.0).any(axis=0)
    x = x[:, acts]
    y = (fit.rest / unit)[valid][:, acts] + x
    own = float((x**2).sum())
    both = float((x * y).sum())
    energy = float((y**2).sum())
    if both <= 0.0:
        return LEAST_SHOWN
    return float(np.clip(both**2 / (own * energy), LEAST_SHOWN, 1.0))


def _jackknife(values: Array) -> Array:
    """Variance (k,) by the folds' values (folds, k): (F - 1) / F of their sum of squares about the mean."""
    spread = values - values.mean(axis=0)
    return np.asarray((len(spread) - 1) / len(spread) * (spread**2).sum(axis=0))


def _within_bounds(mean: float, sd: float, low: float, high: float) -> tuple[float, float]:
    """The part of a 95 % interval within bounds; where hardly any is, that of the normal cut off at them."""
    near, far = np.clip([mean - SIDE * sd, mean + SIDE * sd], low, high)
    ends = (low - mean) / sd, (high - mean) / sd
    least = mean + sd * _cut_off_quantile(0.025, *ends)
    most = mean + sd * _cut_off_quantile(0.975, *ends)
    return min(float(near), least), max(float(far), most)


def _cut_off_quantile(p: float, low: float, high: float) -> float:
    """Quantile of the standard normal cut off at bounds: F(x) = (1 - p) F(low) + p F(high), in logarithms.

    ``scipy.stats`` has it as well; to import that takes longer than to judge a short flight.
    """
    if low > 0.0:  # logarithms are exact in the lower tail
        return -_cut_off_quantile(1.0 - p, -high, -low)
    shares = math.log1p(-p) + log_ndtr(low), math.log(p) + log_ndtr(high)
    return float(ndtri_exp(np.logaddexp(*shares)))


def _within(draws: Array, effect: Effect, context: Context) -> Array:
    """Draws (m, k) within all bounds; all of them, moved to the bounds, where hardly any is."""
    low = np.array([c.least(context) for c in effect.coefficients])
    high = np.array([c.most(context) for c in effect.coefficients])
    inside = ((draws >= low) & (draws <= high)).all(axis=1)
    if inside.mean() < FEWEST_WITHIN:
        return np.clip(draws, low, high)
    return np.asarray(draws[inside])


def _quantiles(values: Array, weight: Array) -> tuple[float, float, float]:
    """The 2.5, 50 and 97.5 % quantiles of draws (m,) with weights (m,) or (1,)."""
    order = np.argsort(values)
    total = np.cumsum(np.broadcast_to(weight, values.shape)[order])
    share = (total - 0.5 * np.diff(total, prepend=0.0)) / total[-1]
    low, middle, high = np.interp([0.025, 0.5, 0.975], share, values[order])
    return float(low), float(middle), float(high)


def _between(walked: Walked, term: Term, flight: int, mean: Array) -> Array:
    """Variance (k,) of the coefficients b_S over the sets S that hold the effect, by their probability p_S.

    sum p_S (b_S - ``mean``)^2 / sum p_S: Hoeting et al. 1999, Statistical Science 14, 382.
    """
    out = np.zeros_like(mean)
    total = 0.0
    for fit, weight in walked.weighted():
        for t in fit.of_effects:
            if t.key == term.key and flight in t.places:
                off = t.named.mixed(fit.sizes(t, flight), t.shape) - mean
                out += weight * off**2
                total += weight
    return out / max(total, 1e-12)


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
    weight = np.exp([gains[v] - max(gains.values()) for v in tried])
    edges = np.concatenate([tried[:1], (tried[1:] + tried[:-1]) / 2.0, tried[-1:]])
    total = np.concatenate([[0.0], np.cumsum(weight * np.diff(edges))])
    low, high = np.interp([0.025, 0.975], total / total[-1], edges)
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
        without_interval, ci95=(float(low), float(high)), at_bound=bool(at_edge and not free)
    )


def _profile(walked: Walked, term: Term, i: int) -> dict[float, float]:
    """By value of a shape parameter the largest TRUST gain in log evidence beside the other terms of the best set."""
    evidence = walked.evidence
    shape = term.named.shapes[i]
    beside = evidence.refit(walked.best.beside(term), walked.best.noise)
    screened = evidence.screen(beside, term.key)
    gains: dict[float, float] = {}
    for number in evidence.library.numbers_of[term.key]:
        value = evidence.library.terms[number].shape[i]
        gain = TRUST * float(screened[number])
        if value not in shape.kinds:
            gains[value] = max(gains.get(value, -np.inf), gain)
    return gains


def _between_shapes(walked: Walked, term: Term, i: int) -> float:
    """Variance of a shape parameter over the sets that hold the effect, by their probability, about this one."""
    out = 0.0
    total = 0.0
    for fit, weight in walked.weighted():
        for t in fit.terms:
            if t.key == term.key:
                out += weight * (t.shape[i] - term.shape[i]) ** 2
                total += weight
    return out / max(total, 1e-12)


def _folds_variance(walked: Walked, term: Term, i: int, flights: Sequence[int]) -> float:
    """Jackknife variance of a shape parameter; 0 where it was tried on one side only.

    Every fold has its own likeliest value: the vertex of the parabola through the log posteriors of the value found
    and of its neighbours on the grid.
    """
    three = _beside_each_other(walked.evidence, term, i)
    if three is None:
        return 0.0
    values = np.array([t.shape[i] for t in three])
    tried = [t.shape[i] for t in walked.evidence.library.with_key(term.key)]
    sets = []
    for t in three:
        sets.append([t if old is term else old for old in walked.best.terms])
    variance = 0.0
    for flight in flights:
        vertices = []
        for left_out in folds_of(walked.evidence.library, flight):
            heights = []
            for terms in sets:
                fit = walked.evidence.refit(terms, walked.best.noise, {flight: left_out})
                heights.append(_log_posterior(fit))
            vertices.append(_vertex(values, np.array(heights)))
        likeliest = np.clip(vertices, min(tried), max(tried))
        variance += float(_jackknife(likeliest[:, None])[0])
    return variance


def _beside_each_other(evidence: Evidence, term: Term, i: int) -> tuple[Term, Term, Term] | None:
    """The terms below, at and above a value of a shape parameter, all else the same; None at an edge."""
    kinds = term.named.shapes[i].kinds
    row = {}
    for other in evidence.library.with_key(term.key):
        value = other.shape[i]
        same = (*other.shape[:i], term.shape[i], *other.shape[i + 1 :]) == term.shape
        if same and value not in kinds:
            row[value] = other
    below = [v for v in row if v < term.shape[i]]
    above = [v for v in row if v > term.shape[i]]
    if not below or not above:
        return None
    return row[max(below)], term, row[min(above)]


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
