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
from replay.search.evidence import Fit
from replay.search.held_out import FlightFit
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
    shown: tuple[IntervalEstimate, ...]
    """As people say them: ``Effect.shown``."""


def sizes(walked: Walked, term: Term, fit: FlightFit, shapes: Sequence[IntervalEstimate]) -> Sizes:
    """Coefficients on a flight, then the shape (``shape_estimates``)."""
    effect = term.named
    flight = fit.index
    context = fit.record.context
    mean, sd = mean_and_spread(walked, term, fit)
    root = _root_of_covariance(walked.best, term, flight)
    fitted: list[IntervalEstimate] = []
    possible: list[IntervalEstimate] = []
    for i, coefficient in enumerate(effect.coefficients):
        share = 1.0
        if coefficient.foretold:
            wrenches, _ = walked.evidence.library.wrenches(term, flight)
            share = _share_of_lines(fit, mean[i] * wrenches[..., i])
        estimate, within = _interval(
            effect, coefficient, context, mean=mean[i], sd=float(sd[i]), share=share
        )
        fitted.append(estimate)
        possible.append(replace(estimate, ci95=within))
    # The correlations are the posterior's, the spreads those of the intervals.
    wider = sd / np.maximum(np.sqrt((root**2).sum(axis=0)), 1e-150)
    normal = np.random.default_rng(0).standard_normal((DRAWS, len(mean)))
    draws = _within(mean + (normal @ root) * wider, effect, context)
    draws_of = {c.name: draws[:, i] for i, c in enumerate(effect.coefficients)}
    for shape in shapes:
        draws_of[shape.name] = _draws_of_shape(shape, len(draws))
    return Sizes(
        fitted=(*fitted, *shapes),
        shown=shown_parameters(effect, context, [*possible, *shapes], draws_of),
    )


def mean_and_spread(walked: Walked, term: Term, fit: FlightFit) -> tuple[Array, Array]:
    """Coefficients on a flight (k,), and their standard deviations.

    Variance: the larger of the posterior's, over TRUST, and the folds' (jackknife: Efron & Stein 1981, Annals of
    Statistics 9, 586), and beside it that between the sets that hold the effect.
    """
    effect = term.named
    mean = effect.mixed(walked.best.sizes(term, fit.index), term.shape)
    root = _root_of_covariance(walked.best, term, fit.index)
    posterior = (root**2).sum(axis=0) / TRUST
    of_folds = effect.mixed(fit.effects[term.key].folds, term.shape)
    variance = np.maximum(posterior, jackknife(of_folds))
    return mean, np.sqrt(variance + _between(walked, term, fit.index, mean))


def _root_of_covariance(fit: Fit, term: Term, flight: int) -> Array:
    """R (k, k) with R^T R the posterior covariance of the coefficients on a flight, in their own units."""
    part = fit.part(term)
    place = term.place(flight)
    covariance = fit.cov[part, part][np.ix_(place, place)]
    root = np.linalg.cholesky(covariance)
    in_units = term.scale[place, None] * root
    return term.named.mixed(in_units.T, term.shape)


def _interval(
    effect: Effect, c: Coefficient, context: Context, *, mean: float, sd: float, share: float
) -> tuple[IntervalEstimate, tuple[float, float]]:
    """A coefficient of N(``mean``, ``sd``^2), and the part of its interval that is possible.

    ``share`` of the line that least squares show: the upper end is divided by it.
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
        ci95=(min(value, mean - half), max(value, mean + half) / share),
        unit=c.unit,
        at_bound=at_bound and c.name in effect.main_names,
        determined=sd < LEARNT / np.sqrt(TRUST) * typical,
    )
    least, most = _within_bounds(mean, sd, low, high)
    return estimate, (least, min(most / share, high))


def _draws_of_shape(shape: IntervalEstimate, count: int) -> Array:
    """Draws (count,) of a shape parameter: normal, with its interval, and within it."""
    if shape.ci95 is None:
        return np.full(count, shape.value)
    low, high = shape.ci95
    sd = shape.width / (2.0 * SIDE)
    normal = np.random.default_rng(1).standard_normal(count)
    return np.clip(shape.value + sd * normal, low, high)


def shown_parameters(
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


def _share_of_lines(fit: FlightFit, wrench: Array) -> float:
    """r^2 of a contribution x (n, 6) and of y, itself and what is left beside it, over all axes on which it acts.

    Where x has errors of its own, least squares of y on x give too little, and those of x on y, the first over r^2, too
    much: the truth lies between both (Frisch 1934, Statistical Confluence Analysis; Klepper & Leamer 1984, Econometrica
    52, 163).
    """
    valid = fit.record.valid
    unit = hundredths(fit.record.context)
    x = (wrench / unit)[valid]
    judged = np.isin(np.arange(6), fit.record.axes)
    acts = judged & (x != 0.0).any(axis=0)
    x = x[:, acts]
    rest = (fit.rest / unit)[valid][:, acts]
    y = rest + x
    x_x = float((x**2).sum())
    x_y = float((x * y).sum())
    y_y = float((y**2).sum())
    if x_y <= 0.0:
        return LEAST_SHOWN
    r_squared = x_y**2 / (x_x * y_y)
    return float(np.clip(r_squared, LEAST_SHOWN, 1.0))


def jackknife(values: Array) -> Array:
    """Variance (k,) by the folds' values (folds, k): (F - 1) / F of their sum of squares about the mean."""
    spread = values - values.mean(axis=0)
    return np.asarray((len(spread) - 1) / len(spread) * (spread**2).sum(axis=0))


def _within_bounds(mean: float, sd: float, low: float, high: float) -> tuple[float, float]:
    """The part of a 95 % interval within bounds; where hardly any is, that of the normal cut off at them."""
    near, far = np.clip([mean - SIDE * sd, mean + SIDE * sd], low, high)
    lowest = (low - mean) / sd
    highest = (high - mean) / sd
    least = mean + sd * _cut_off_quantile(0.025, lowest, highest)
    most = mean + sd * _cut_off_quantile(0.975, lowest, highest)
    return min(float(near), least), max(float(far), most)


def _cut_off_quantile(p: float, low: float, high: float) -> float:
    """Quantile of the standard normal cut off at bounds: F(x) = (1 - p) F(low) + p F(high), in logarithms.

    ``scipy.stats`` has it as well; to import that takes longer than to judge a short flight.
    """
    if low > 0.0:  # logarithms are exact in the lower tail
        return -_cut_off_quantile(1.0 - p, -high, -low)
    log_low = math.log1p(-p) + log_ndtr(low)
    log_high = math.log(p) + log_ndtr(high)
    return float(ndtri_exp(np.logaddexp(log_low, log_high)))


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
    in_order = np.broadcast_to(weight, values.shape)[order]
    total = np.cumsum(in_order)
    middle_of_step = total - 0.5 * np.diff(total, prepend=0.0)
    share = middle_of_step / total[-1]
    low, middle, high = np.interp([0.025, 0.5, 0.975], share, values[order])
    return float(low), float(middle), float(high)


def _between(walked: Walked, term: Term, flight: int, mean: Array) -> Array:
    """Variance (k,) of the coefficients b_S over the sets S that hold the effect, by their probability p_S.

    sum p_S (b_S - ``mean``)^2 / sum p_S: Hoeting et al. 1999, Statistical Science 14, 382.
    """
    out = np.zeros_like(mean)
    total = 0.0
    for fit, weight in walked.weighted():
        for other in fit.of_effects:
            if other.key == term.key and flight in other.places:
                size = other.named.mixed(fit.sizes(other, flight), other.shape)
                out += weight * (size - mean) ** 2
                total += weight
    return out / max(total, 1e-12)
