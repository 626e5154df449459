"""What changed on a vehicle: effects of a flight that lie outside what its good flights differ by themselves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import expit

from models.effects import AdoptedEffect, BelongsTo, Context, Effect, catalogue, get
from replay.changes.spread import VarianceComponent, as_flown, usual
from replay.diagnosis.weights import in_shares
from replay.residual.record import Record
from replay.search.design import Design
from replay.search.estimates import DRAWS, SIDE, IntervalEstimate, shown_parameters
from replay.search.evidence import Evidence, Fit
from replay.search.library import Library
from replay.search.significance import Contributions, beyond_bounds, tops
from replay.search.terms import Shape, Term
from replay.search.thresholds import SURE as MOST_SURE
from replay.search.thresholds import TRUST
from replay.search.walk import walk

OF_A_VEHICLE = (BelongsTo.VEHICLE, BelongsTo.LOAD, BelongsTo.INSTRUMENT)
"""What can change on a vehicle, but for laws; weather and place change with every flight."""
SURE = 1.0
"""Log posterior odds from which a change is named: nothing changed is the usual answer."""
NEAR = 2.0
"""Log odds within which another change could stand in place of one."""
RATHER_THE_SAME = 0.5
"""Log odds of an effect that no good flight could show over a change of it."""
TRIED = 8
MOST = 6
"""Terms that are weighed in full at every step, and steps."""


@dataclass(frozen=True)
class Change:
    """One effect that is not as it was, by how much, and what else it could be."""

    effect: Effect
    estimates: tuple[IntervalEstimate, ...]
    probability: float
    aliases: tuple[str, ...]
    since: str = ""
    """The first log that shows it, where it stays."""

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.effect.name

    def as_json(self) -> dict[str, Any]:
        """Name, parameters, probability and what else it could be."""
        return {
            "name": self.name,
            "parameters": {e.name: e.as_json() for e in self.estimates},
            "probability": self.probability,
            "aliases": self.aliases,
        }


@dataclass(frozen=True)
class Baseline:
    """A vehicle as its good flights show it: the effects that they have in common, and how sizes spread among them."""

    records: tuple[Record, ...]
    found: tuple[AdoptedEffect, ...]
    sizes: tuple[VarianceComponent, ...]


def learn(records: Sequence[Record]) -> Baseline:
    """The vehicle of some flights on which nothing was wrong."""
    effects = _without_remainder()
    walked = walk(records, [_shared(e) for e in effects])
    best = walked.best
    found = []
    explained = [np.zeros_like(r.residual) for r in records]
    for term in best.of_effects:
        for flight in term.places:
            wrenches, _ = walked.evidence.library.wrenches(term, flight)
            sizes = best.sizes(term, flight)
            explained[flight] += wrenches @ sizes
        found.append(AdoptedEffect(term.name, term.named.parameters(sizes, term.shape)))
    left = []
    for record, wrench in zip(records, explained, strict=True):
        left.append(replace(record, residual=record.residual - wrench))
    spread = as_flown(usual(effects, found, records[0]), left)
    return Baseline(tuple(records), tuple(found), tuple(spread))


def changes(good: Baseline, today: Record) -> tuple[Change, ...]:
    """What is not as it was, the likeliest first; empty where nothing lies outside the good flights' own spread."""
    evidence, candidates, fit = _beside(good, today)
    for _ in range(MOST):
        grown = _grown(evidence, fit, candidates)
        gain, best = max(grown, key=lambda pair: pair[0], default=(0.0, fit))
        if gain < SURE:
            break
        fit = best
    return tuple(_named(evidence, fit, candidates))


def _beside(good: Baseline, today: Record) -> tuple[Evidence, list[int], Fit]:
    """A flight beside the good ones, the terms that it may differ by, and the fit of what all have in common."""
    flights = [*good.records, today]
    last = len(flights) - 1
    shapes = {}
    for adopted in good.found:
        parameters = get(adopted.name).shapes
        shapes[adopted.name] = tuple(adopted.parameters[s.name] for s in parameters)
    effects = [*_common(shapes), *_changes_of(shapes, today.context)]
    spread = []
    for flight in flights:
        spread.append([size.wrench(flight) for size in good.sizes])
    evidence = Evidence(Library(flights, effects, more_trims=spread))
    candidates = []
    start = []
    for number, term in enumerate(evidence.library.terms):
        if term.effect is None:
            continue
        if term.flight in (None, last):
            candidates.append(number)
        if term.flight is None and term.shape == shapes.get(term.name):
            start.append(term)
    return evidence, candidates, evidence.fit(start, evidence.noises.unfitted)


def _common(shapes: Mapping[str, Shape]) -> Iterator[Effect]:
    """What all flights may have in common, in the known shapes."""
    for effect in _without_remainder():
        # A load counts as a change; the weather of a flight is in the spread.
        if not effect.belongs_to.of_day or effect.name in shapes:
            yield _with_shape(_shared(effect), shapes.get(effect.name))


def _changes_of(shapes: Mapping[str, Shape], today: Context) -> Iterator[Effect]:
    """What may have changed since, of effects that were known or not."""
    for effect in catalogue():
        if effect.belongs_to in OF_A_VEHICLE and not effect.law:
            yield _changed(effect, effect.name in shapes, today)


def _without_remainder() -> list[Effect]:
    """The catalogue but for what corrects other effects."""
    return [e for e in catalogue() if not e.search.remainder]


def _other_shape(term: Term, fit: Fit) -> bool:
    """Whether a change would only bend what all flights have in common: that is a matter of its form."""
    if not any(shape.continuous for shape in term.named.shapes):
        return False
    shared = [one.shape for one in fit.terms if one.name == term.name]
    return any(shape != term.shape for shape in shared)


def _log_odds(fit: Fit, less: Fit, term: Term) -> float:
    """Log posterior odds of a term beside others, ``less`` the set without it.

    The odds of an effect that has kinds are those of each: every fan may have a nicked blade.
    """
    part = fit.part(term)
    within = beyond_bounds([term], fit.b[part], fit.cov[part, part])
    if any(s.continuous for s in term.named.shapes):
        kinds = 0.0
    else:
        kinds = term.log_shape
    prior = term.prior - kinds
    if term.flight is not None:
        prior -= RATHER_THE_SAME
    return TRUST * (fit.evidence - less.evidence) + within + prior


def _grown(evidence: Evidence, fit: Fit, candidates: Iterable[int]) -> list[tuple[float, Fit]]:
    """A set with one term more, the last, and what that gains, for the most promising ones."""
    terms = evidence.library.terms
    possible = []
    for number in candidates:
        term = terms[number]
        if term.key not in fit.key and not _other_shape(term, fit):
            possible.append(number)
    out = []
    for _, term in evidence.promising(fit, possible)[:TRIED]:
        grown = evidence.fit([*fit.terms, term], fit.noise)
        if term.flight is None or _stands_out(evidence, grown, term):
            out.append((_log_odds(grown, fit, term), grown))
    return out


def _named(evidence: Evidence, fit: Fit, candidates: Sequence[int]) -> list[Change]:
    """Changes of a set with their sizes, and what could stand in place of each."""
    out = []
    for term in fit.terms:
        if term.flight is None:
            continue
        less = evidence.fit(fit.terms_without(term), fit.noise)
        log_odds = _log_odds(fit, less, term)
        if log_odds < SURE:
            continue
        rivals = []
        for odds, grown in _grown(evidence, less, candidates):
            rival = grown.terms[-1]
            if rival.key != term.key and rival.flight is not None and odds > log_odds - NEAR:
                rivals.append((odds, rival.name))
        rivals.sort(key=lambda pair: -pair[0])
        probability = min(float(expit(log_odds)), MOST_SURE)
        change = Change(
            effect=get(term.name),
            estimates=_shown(fit, term, evidence.library.records[term.flight].context),
            probability=round(probability, 3),
            aliases=tuple(name for _, name in rivals),
        )
        out.append((log_odds, change))
    out.sort(key=lambda pair: -pair[0])
    return [change for _, change in out]


def _shown(fit: Fit, term: Term, context: Context) -> tuple[IntervalEstimate, ...]:
    """Sizes as people say them, by draws of every coefficient within its interval."""
    fitted = _estimates(fit, term)
    normal = np.random.default_rng(0).standard_normal((DRAWS, len(fitted)))
    draws = {}
    for i, one in enumerate(fitted):
        draws[one.name] = np.full(DRAWS, one.value)
        if one.ci95 is not None:
            low, high = one.ci95
            draws[one.name] = one.value + normal[:, i] * (high - low) / (2.0 * SIDE)
    return in_shares(shown_parameters(term.named, context, fitted, draws), context.vehicle)


def _estimates(fit: Fit, term: Term) -> tuple[IntervalEstimate, ...]:
    """Coefficients with their 95 % intervals, then the shape."""
    assert term.flight is not None
    part = fit.part(term)
    place = term.place(term.flight)
    mean = fit.sizes(term, term.flight)
    variance = np.diag(fit.cov[part, part])[place] / TRUST
    sd = np.sqrt(variance) * term.scale[place]
    low = mean - SIDE * sd
    high = mean + SIDE * sd
    out = []
    for i, coefficient in enumerate(term.named.coefficients):
        estimate = IntervalEstimate(
            name=coefficient.name,
            value=float(mean[i]),
            ci95=(float(low[i]), float(high[i])),
            unit=coefficient.unit,
        )
        out.append(estimate)
    for s, value in zip(term.named.shapes, term.shape, strict=True):
        out.append(IntervalEstimate(name=s.name, value=value, ci95=None, unit=s.unit))
    return tuple(out)


def _stands_out(evidence: Evidence, fit: Fit, term: Term) -> bool:
    """Whether a possible size that makes the effect is clearly not zero, and does a hundredth of the weight."""
    b = fit.b[fit.part(term)]
    impossible = (b < term.low) | (b > term.high)
    if impossible[term.main > 0.0].any():
        return False
    main = [e for e in _estimates(fit, term) if e.name in term.named.main_names]
    if all(e.holds_zero for e in main):
        return False
    design = Design(evidence.library, fit.terms)
    contributions = Contributions(design, fit.b, fit.cov)
    sizes = tops(contributions, contributions.main)
    of_term = sizes[fit.terms.index(term)]
    return bool((of_term > 1.0).any())


def _shared(effect: Effect) -> Effect:
    """An effect that good flights have in common, their load included; the weather is each flight's own."""
    if effect.belongs_to is BelongsTo.WEATHER:
        return effect
    coefficients = []
    for c in effect.coefficients:
        if c.belongs_to is not BelongsTo.WEATHER:
            c = replace(c, belongs_to=None)
        coefficients.append(c)
    if effect.belongs_to is BelongsTo.LOAD:
        belongs_to = BelongsTo.VEHICLE
    else:
        belongs_to = effect.belongs_to
    return replace(_from_the_start(effect), belongs_to=belongs_to, coefficients=tuple(coefficients))


def _changed(effect: Effect, known: bool, today: Context) -> Effect:
    """An effect as a change of it on one flight: about zero where the vehicle had it before, and in both directions."""
    coefficients = [replace(c, belongs_to=None) for c in effect.coefficients]
    if known:
        coefficients = [replace(c, low=-c.most(today), centre=0.0) for c in coefficients]

    def lacking(ctx: Context) -> str | None:
        if ctx is today:
            return effect.lacking(ctx)
        return "of another flight"

    return replace(
        _from_the_start(effect),
        belongs_to=BelongsTo.LOAD,
        coefficients=tuple(coefficients),
        lacking=lacking,
    )


def _from_the_start(effect: Effect) -> Effect:
    """What is picked up in flight is no change of the vehicle."""
    return replace(effect, search=replace(effect.search, may_begin=False))


def _with_shape(effect: Effect, shape: Shape | None) -> Effect:
    if shape is None:
        return effect
    return replace(effect, grid=lambda _: (shape,))
