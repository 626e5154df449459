"""What a search found in some flights: sizes with intervals, probabilities, aliases, and what is left."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import ndtr

from models.effects import Effect
from models.frames import AXES, Array
from replay.search.evidence import TRUST, Fit
from replay.search.held_out import FlightFit, flight_fits
from replay.search.sets import Walked, aliases
from replay.search.surfaces import with_surface_law
from replay.search.terms import Key, Term
from replay.search.worth import top

BOUND_SHARE = 0.01
"""Distance to a bound, as a share of the range, within which a coefficient stands at it."""
LEARNT = 0.7
"""Posterior over prior standard deviation above which a flight has said nothing about a coefficient."""
HELD_OUT = 2.0
"""A set that leaves this much more energy of held-out time than another is not the answer, however likely it is."""
NEAR, RIVALS = 30.0, 6
"""Sets that are compared so: less likely than the best by no more than this (log), and how many."""
WORSE_SHARE = 0.005
"""Share of the residual's energy by which an effect may make held-out time worse: noise, where it is hardly excited."""


@dataclass(frozen=True)
class IntervalEstimate:
    """One parameter with its 95 % interval; ``at_bound``: at the edge of what was tried or is possible."""

    name: str
    value: float
    ci95: tuple[float, float]
    unit: str
    at_bound: bool = False
    determined: bool = True
    """Whether the flights say more about it than was assumed before."""

    def as_json(self) -> dict[str, Any]:
        """Value, interval and unit."""
        out = {"value": self.value, "ci95": self.ci95, "unit": self.unit}
        return out | ({"at_bound": True} if self.at_bound else {})

    @property
    def sign_probability(self) -> float:
        """That it has the sign of its value, Phi(|b| / s); 1 where the interval leaves zero out."""
        low, high = self.ci95
        return float(ndtr(abs(self.value) / (high - low) * 2.0 * 1.96)) if low <= 0.0 <= high and low < high else 1.0


@dataclass(frozen=True)
class Found:
    """An effect that was adopted, over all flights that show it.

    Its parameters are those of ``flight``, where it explains most: flights differ in weather and load.
    """

    effect: Effect
    estimates: tuple[IntervalEstimate, ...]
    axes: tuple[str, ...]
    explains: float
    probability: float
    aliases: tuple[str, ...]
    flight: int
    without: tuple[str, ...] = ()
    """Axes on which it does not act: there it raises the error of held-out time."""
    confirmed_by: tuple[int, ...] = ()
    """Flights whose residual it lowers where it was fitted on the others."""
    of_flight: dict[int, dict[str, float]] = field(default_factory=dict)
    """Parameters of every flight on which it acts."""

    @property
    def parameters(self) -> dict[str, float]:
        """As a model directory keeps them."""
        return {e.name: e.value for e in self.estimates}

    @property
    def status(self) -> str:
        """``confirmed`` (lowers the residual of a flight that it was not fitted on, too), or ``candidate``."""
        return "confirmed" if self.confirmed_by and not self.at_bound else "candidate"

    @property
    def at_bound(self) -> bool:
        """Whether a parameter stands at the edge of what was tried."""
        return any(e.at_bound for e in self.estimates)


@dataclass(frozen=True)
class Rejected:
    """An effect that was not adopted, and why; ``excited`` is False where the flights could not have shown it."""

    name: str
    reason: str
    excited: bool
    p: float | None = None


@dataclass(frozen=True)
class Searched:
    """The answer of a search over some flights together."""

    traces: tuple[FlightFit, ...]
    """Every flight under the best set."""
    found: tuple[Found, ...]
    rejected: tuple[Rejected, ...]
    left_out: tuple[str, ...]
    """What was not tried, because it would have taken too long."""


def summarise(walked: Walked) -> Searched:
    """Everything that a reader needs to judge what was found.

    The order of the passes matters: held-out time, then the map of surfaces, which corrects the laws that are left,
    and last what raises the error of held-out time. Each takes the best set of the pass before and gives its own;
    probabilities are those of the sets that remain.
    """
    walked, fits = _helpful(_predictive(walked))
    others = aliases(walked)
    mapped = with_surface_law(walked)
    if mapped is not walked:
        walked, fits = _helpful(mapped)
    chosen = [t for t in walked.best.terms if t.effect is not None]
    joint = corrected_together(t.effect for t in chosen if t.effect is not None)
    fits, without = _by_axis(fits, [t.key for t in chosen if t.name not in joint])
    names = dict.fromkeys(t.name for t in chosen)
    found = _at_most_all([_found(walked, [t for t in chosen if t.name == n], fits, others, without) for n in names])
    found.sort(key=lambda f: (-round(f.explains, 6), f.effect.name))
    return Searched(tuple(fits), tuple(found), _rejected(walked, set(names)), walked.left_out)


def corrected_together(effects: Iterable[Effect]) -> set[str]:
    """A map of surfaces and the laws that it corrects: only their sum is known well."""
    return {name for effect in effects if effect.remainder for name in (effect.name, *effect.aliases)}


def _at_most_all(found: Sequence[Found]) -> list[Found]:
    """Shares that add up to 1 at most: what effects take back from each other is explained by neither."""
    total = max(sum(max(f.explains, 0.0) for f in found), 1.0)
    return [replace(f, explains=f.explains / total) for f in found]


def _predictive(walked: Walked) -> Walked:
    """Pass over sets that fit well and leave far more of held-out time than others: they cancel or chase noise.

    The likeliest set is taken whose energy of held-out time is no more than ``HELD_OUT`` times the least. More effects
    of the same kind always leave less: whether they are large enough to be named is decided already.
    """
    likeliest: dict[frozenset[str], Fit] = {}
    for fit in (walked.best, *walked.ranked()):
        names = frozenset(t.name for t in fit.terms if t.effect is not None)
        more = any(other < names for other in likeliest)
        if fit.score > walked.best.score - NEAR and len(likeliest) < RIVALS and not more:
            likeliest.setdefault(names, fit)
    left = {fit.key: sum(f.energy(f.after) for f in flight_fits(walked.evidence, fit)) for fit in likeliest.values()}
    least = min(left.values())
    chosen = next(fit for fit in likeliest.values() if left[fit.key] <= HELD_OUT * least)
    return walked if chosen.key == walked.best.key else walked.at_most(chosen)


def _helpful(walked: Walked) -> tuple[Walked, list[FlightFit]]:
    """The best set without the effects that raise the error of held-out time, and every flight under it."""
    fits = flight_fits(walked.evidence, walked.best)
    gains = {t.key: _share(fits, t.key) for t in walked.best.terms if t.effect is not None}
    worst = min(gains, key=lambda key: gains[key], default=None)
    if worst is None or gains[worst] > -WORSE_SHARE:
        return walked, fits
    return _helpful(replace(walked.without(worst), worse=walked.worse | {worst[0]}))


def _by_axis(fits: Sequence[FlightFit], keys: Sequence[Key]) -> tuple[list[FlightFit], dict[Key, tuple[str, ...]]]:
    """Every flight without effects on axes of which they raise the error of held-out time; by ``keys``, these axes.

    One after the other, the worst first: the others are judged beside what is left.
    """
    fits = list(fits)
    without: dict[Key, tuple[str, ...]] = {}
    while True:
        gains = {
            (key, axis): _share(fits, key, [axis])
            for axis in sorted({axis for f in fits for axis in f.record.axes})
            for key in keys
            if AXES[axis] not in without.get(key, ())
        }
        worst = min(gains, key=lambda pair: gains[pair], default=None)
        if worst is None or gains[worst] > -WORSE_SHARE:
            return fits, without
        key, axis = worst
        fits = [f.without_axis(key, axis) if key in f.effects else f for f in fits]
        without[key] = (*without.get(key, ()), AXES[axis])


def _share(fits: Sequence[FlightFit], key: Key, axes: Sequence[int] | None = None) -> float:
    """Share of the energy of held-out time, of all or of some axes, that one effect removes beside the others."""
    before = max(sum(f.energy(f.before, axes) for f in fits), 1e-12)
    return round(sum(f.gain(key, axes) for f in fits) / before, 9)


def _found(
    walked: Walked, terms: Sequence[Term], fits: Sequence[FlightFit], others: Mapping[Key, Sequence[str]],
    without: Mapping[Key, tuple[str, ...]],
) -> Found:  # fmt: skip
    """One effect; where every flight has a term of its own, its numbers are those of the one that explains most."""
    shares = {t.key: _share(fits, t.key) for t in terms}
    term = max(terms, key=lambda t: (shares[t.key], -_shown_by(t, fits)))
    carried = {axis for f in fits if term.key in f.effects for axis in f.effects[term.key].axes}
    instead = tuple(others.get(term.key, ()))
    flight = _shown_by(term, fits)
    estimates = _estimates(walked, term, fits[flight])
    main = {c.name for c in term.named.coefficients if term.named.is_main(c)}
    sign = max((e.sign_probability for e in estimates if e.name in main), default=1.0)
    return Found(
        effect=term.named,
        estimates=estimates,
        axes=tuple(a for a in AXES if a in carried),
        explains=sum(shares.values()),
        probability=round(min(walked.probability(term.name, instead), sign), 3),
        aliases=instead,
        flight=flight,
        without=without.get(term.key, ()),
        confirmed_by=tuple(f.index for f in fits if any(t.key in f.confirms for t in terms)),
        of_flight={f.index: f.effects[t.key].parameters for t in terms for f in fits if t.key in f.effects},
    )


def _estimates(walked: Walked, term: Term, fit: FlightFit) -> tuple[IntervalEstimate, ...]:
    """Coefficients on the flight that they are shown by, then the shape.

    Variance: the larger of the posterior's, over TRUST, and the folds' (jackknife: Efron & Stein 1981, Annals of
    Statistics 9, 586), and beside it that between the sets that hold the effect.
    """
    effect, best, flight, context = term.named, walked.best, fit.index, fit.record.context
    part, place = best.part(term), term.place(flight)
    mean = effect.mixed(best.sizes(term, flight), term.shape)
    root = np.linalg.cholesky(best.cov[part, part][np.ix_(place, place)])
    variance = (effect.mixed((term.scale[place, None] * root).T, term.shape) ** 2).sum(axis=0) / TRUST
    drawn = effect.mixed(fit.effects[term.key].folds, term.shape)
    spread = drawn - drawn.mean(axis=0)
    variance = np.maximum(variance, (len(spread) - 1) / len(spread) * (spread**2).sum(axis=0))
    sd = np.sqrt(variance + _between(walked, term, flight, mean))
    out = []
    for c, m, s in zip(effect.coefficients, mean, sd.tolist(), strict=True):
        low, typical = c.least(context), c.spread(context)
        value, half = float(np.clip(m, low, c.high)), 1.96 * s
        at = min(value - low, c.high - value) < BOUND_SHARE * min(c.high - low, 10.0 * typical)
        at = at and half > 0.0 and (not effect.main or c.name in effect.main)
        interval = min(value, m - half), max(value, m + half)
        out.append(IntervalEstimate(c.name, value, interval, c.unit, at, s < LEARNT / np.sqrt(TRUST) * typical))
    for i, shape in enumerate(effect.shapes):
        low, high, at = _shape_interval(walked, term, i)
        out.append(IntervalEstimate(shape.name, float(term.shape[i]), (low, high), shape.unit, at))
    return tuple(out)


def _shown_by(term: Term, fits: Sequence[FlightFit]) -> int:
    """The first flight on which an effect acts; of weather or load the one on which it does most."""
    if term.named.kept or len(term.places) < 2:
        return min(term.places)
    return max(term.places, key=lambda i: fits[i].energy(fits[i].effects[term.key].held_out))


def _between(walked: Walked, term: Term, flight: int, mean: Array) -> Array:
    """Variance (k,) of the coefficients b_S over the sets S that hold the effect, by their probability p_S.

    sum p_S (b_S - ``mean``)^2 / sum p_S: Hoeting et al. 1999, Statistical Science 14, 382.
    """
    out, total = np.zeros_like(mean), 0.0
    for fit, weight in walked.weighted():
        for t in fit.terms:
            if t.effect is not None and t.key == term.key and flight in t.places:
                out += weight * (t.effect.mixed(fit.sizes(t, flight), t.shape) - mean) ** 2
                total += weight
    return out / max(total, 1e-12)


def _shape_interval(walked: Walked, term: Term, i: int) -> tuple[float, float, bool]:
    """95 % interval of a shape parameter beside the others, and whether it stands at the grid's edge.

    The density over the values tried goes with exp(TRUST gain in log evidence), each to half way to the next.
    """
    shape, value, evidence = term.named.shapes[i], float(term.shape[i]), walked.evidence
    if not shape.continuous or value in shape.kinds:
        return value, value, False
    beside = [t for t in walked.best.terms if t is not term]
    screened = evidence.screen(evidence.refit(beside, walked.best.noise), term.key)
    gains: dict[float, float] = {}
    for number in evidence.library.numbers_of[term.key]:
        other = evidence.library.terms[number].shape
        if other[:i] + other[i + 1 :] == term.shape[:i] + term.shape[i + 1 :] and other[i] not in shape.kinds:
            gains[other[i]] = TRUST * float(screened[number])
    if len(gains) < 2:
        return value, value, False
    tried = np.array(sorted(gains))
    weight = np.exp([gains[v] - max(gains.values()) for v in tried])
    edges = np.concatenate([tried[:1], (tried[1:] + tried[:-1]) / 2.0, tried[-1:]])
    total = np.concatenate([[0.0], np.cumsum(weight * np.diff(edges))])
    low, high = np.interp([0.025, 0.975], total / total[-1], edges)
    at = value in (tried[0], tried[-1]) and not (value == 0.0 and shape.free_at_zero)
    return float(min(low, value)), float(max(high, value)), bool(at)


def _rejected(walked: Walked, taken: set[str]) -> tuple[Rejected, ...]:
    """Every effect that is not in the answer, and why."""
    library = walked.evidence.library
    out = [Rejected(name, reason, False) for name, reason in library.lacking.items()]
    gain = walked.evidence.screen(walked.best)
    numbers: dict[str, list[int]] = {}
    for i, t in enumerate(library.terms):
        if t.effect is not None and t.name not in taken:
            numbers.setdefault(t.name, []).append(i)
    for name, own in numbers.items():
        term = library.terms[max(own, key=lambda i: float(gain[i]))]
        excited = name in walked.worse or _excited(walked, term)
        reason = walked.why_not(name) if excited else "this flight hardly excites it: " + term.named.excite
        out.append(Rejected(name, reason, excited, walked.probability(name, ())))
    return tuple(out)


def _excited(walked: Walked, term: Term) -> bool:
    """Whether the flights would know one of its main coefficients, beside the set.

    Its standard deviation s / sqrt(TRUST) makes less than a hundredth of the weight, the smallest effect that is named.
    """
    evidence = walked.evidence
    fit = evidence.refit([*walked.best.terms, term], walked.best.noise)
    part = fit.part(term)
    error = np.sqrt(np.diag(fit.cov[part, part]) / TRUST)
    # Where the prior alone says as much, the flight has said nothing.
    known = error < LEARNT / np.sqrt(TRUST)
    unit = np.zeros(len(term.columns))
    for channel in evidence.library.channels:
        for i, at in enumerate(channel.where[term.columns]):
            if at >= 0:
                unit[i] = max(unit[i], float(top(channel.rows[at], channel.count)) / channel.limit)
    return bool((known & (term.main > 0) & (error * unit < 1.0)).any())
