"""The sets of terms that were weighed: their probabilities, and which effects could stand in each other's place.

A set S of terms has the log posterior ``score``(S), up to a constant: the evidence to the power ``TRUST``, the share of
it within the bounds, the share of what is large enough, and the prior odds of its terms (evidence.py). Its probability
among the sets that were weighed is exp(score) over their sum (Hoeting et al. 1999, Statistical Science 14, 382).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import expit

from models.effects import Effect
from replay.search.evidence import Evidence, Fit, in_order
from replay.search.terms import Key, Term
from replay.search.thresholds import (
    ALIAS_NATS,
    MARGIN,
    MOST_MEMBERS,
    NAMED,
    NEGLIGIBLE,
    NO_MEMBER,
    SURE,
)

MOST_EXCHANGED = 2
"""Terms by which sets may differ whose effects stand in each other's place."""
Fits = dict[frozenset[Key], Fit]
"""The best fit of every set, by the keys of its terms."""


@dataclass
class Sets:
    """The memory of a walk: every set that it weighed, in the best of its shapes so far."""

    evidence: Evidence
    fits: Fits

    def weigh(self, terms: Sequence[Term], near: Fit) -> Fit:
        """The fit of a set, the best of its shapes so far."""
        fit = self.evidence.fit(in_order(terms), near.noise)
        known = self.fits.setdefault(fit.key, fit)
        if fit.score > known.score + 1e-9:
            self.fits[fit.key] = fit
        return self.fits[fit.key]


@dataclass(frozen=True, kw_only=True)
class Walked:
    """What a walk over sets came to: every set that was weighed, and the best."""

    evidence: Evidence
    fits: Mapping[frozenset[Key], Fit]
    best: Fit
    map_log_odds: float = -np.inf
    """Log odds of the map of surfaces, beside the best set."""
    dropped: Mapping[str, str] = field(default_factory=dict)
    """Effects that were taken out of a likelier set, and why."""
    left_out: tuple[str, ...] = ()
    """What was not tried, because it would have taken too long."""

    def without(self, keys: Collection[Key], why: str) -> Walked:
        """Sets without some terms. The best is what is left of the old one, a part of it, or with aliases instead."""
        sets = Sets(self.evidence, dict(self.fits))
        gone = [t for t in self.best.terms if t.key in keys]
        stand_ins = set[str]().union(*(t.named.aliases for t in gone))
        others = [t for t in self.best.terms if t.key not in keys]
        less = sets.weigh(others, self.best)
        fits = {key: fit for key, fit in sets.fits.items() if key.isdisjoint(keys)}
        rivals = [fit for fit in fits.values() if _stands_in(fit, less, stand_ins)]
        dropped = {**self.dropped, **dict.fromkeys((t.name for t in gone), why)}
        return replace(self, fits=fits, best=canonical(rivals), dropped=dropped)

    def at_most(self, best: Fit) -> Walked:
        """With this set as the best, and without those that are likelier."""
        fits = {best.key: best}
        for key, fit in self.fits.items():
            if fit.score <= best.score:
                fits[key] = fit
        return replace(self, fits=fits, best=best)

    def ranked(self) -> list[Fit]:
        """Likeliest first."""
        return sorted(self.fits.values(), key=_rank)

    def weighted(self) -> list[tuple[Fit, float]]:
        """Sets with their probability exp(score) / sum of exp(score), those of some weight."""
        top = max(f.score for f in self.fits.values())
        total = sum(_likelihood(fit, top) for fit in self.fits.values())
        out = []
        for fit in self.ranked():
            if fit.score > top - NEGLIGIBLE:
                out.append((fit, _likelihood(fit, top) / total))
        return out

    def probability(self, name: str, aliases: Sequence[str]) -> float:
        """That the effect, or one that stands in its place, acts: the sum over the sets that hold one of them.

        Of the map of surfaces, which no set of the walk holds: 1 / (1 + exp(-log odds)).
        """
        effect = next((t.effect for t in self.best.terms if t.name == name), None)
        if effect is not None and effect.search.remainder:
            p = float(expit(self.map_log_odds))
        else:
            wanted = {name, *aliases}
            p = sum(weight for fit, weight in self.weighted() if wanted & fit.effects)
        return round(min(p, SURE), 3)

    def why_not(self, name: str) -> str:
        """Why an effect is not in the answer."""
        if name in self.dropped:
            return self.dropped[name]
        fit = next((f for f in self.ranked() if name in f.effects), None)
        if fit is None:
            return "no better than chance"
        if fit.significance < -1.0:
            return "too small beside the other effects"
        if fit.evidence < self.best.evidence + 1.0:
            return "the other effects fit as well without it"
        return "not likely together with the other effects"


def _stands_in(fit: Fit, less: Fit, stand_ins: Collection[str]) -> bool:
    """Whether a set is ``less`` or a part of it, with stand-ins besides, or aliases in the place of some effects.

    What an effect that was taken out explained, a free curve may explain.
    """
    allowed = set(stand_ins)
    for term in less.terms:
        if term.effect is not None and term.key not in fit.key:
            allowed |= {term.name, *term.named.aliases}
    new = {t.name for t in fit.of_effects if t.key not in less.key}
    return new <= allowed


def aliases(walked: Walked) -> dict[Key, list[str]]:
    """By key of a term of the best set, effects that could stand in its place.

    Those of sets that are the same but for a few effects, and about as likely. What acts on none of its axes is none.
    """
    best = walked.best
    out: dict[Key, list[str]] = {term.key: [] for term in best.terms}
    for fit in walked.ranked():
        new = [t for t in fit.terms if t.key not in best.key]
        gone = [t for t in best.terms if t.key not in fit.key]
        few = 0 < len(gone) <= MOST_EXCHANGED and 0 < len(new) <= MOST_EXCHANGED
        near = fit.score >= best.score - ALIAS_NATS
        if few and near and all(t.effect is not None for t in new):
            for term in gone:
                names = {t.name for t in new if _on_common_axis(term, t)}
                known = {term.name, *out[term.key]}
                out[term.key] += sorted(names - known)
    return out


def _on_common_axis(one: Term, other: Term) -> bool:
    """Whether an effect can do something of what another one does; a free curve acts on the axis that it has."""
    axes = (one.axis,) if one.effect is None else one.effect.axes
    return not set(axes).isdisjoint(other.named.axes)


def class_of(
    walked: Walked, effect: Effect, instead: Sequence[str]
) -> tuple[tuple[str, float], ...]:
    """An effect of the best set and those that may act in its place, with their probabilities, the largest first.

    P(a) is the sum of exp(score) over the weighed sets without the effect that hold a, divided by that over all; sets
    that hold several count for each in equal parts, but not for what the effect has among its own terms. Members of
    less than ``NO_MEMBER`` are left out; empty where none is left beside the effect.
    """
    name = effect.name
    chances = dict.fromkeys((name, *instead), 0.0)
    for fit, weight in walked.weighted():
        names = fit.effects
        if name in names:
            members = [name]
        else:
            members = [other for other in instead if other in names]
        members = [one for one in members if one not in effect.contains] or members
        for member in members:
            chances[member] += weight / len(members)
    likely = {one: p for one, p in chances.items() if one == name or p >= NO_MEMBER}
    if len(likely) < 2:
        return ()
    ranked = sorted(likely, key=lambda one: (-likely[one], one))
    shown = ranked[:MOST_MEMBERS]
    if name not in shown:
        shown[-1] = name
    return tuple((one, round(min(likely[one], SURE), 3)) for one in shown)


def _likelihood(fit: Fit, top: float) -> float:
    """Over that of the best set, whose score is ``top``."""
    return float(np.exp(fit.score - top))


def _rank(fit: Fit) -> tuple[float, str]:
    """Likeliest first, then by name."""
    return -round(fit.score, 6), str(sorted(map(str, fit.key)))


def canonical(fits: list[Fit]) -> Fit:
    """Of the best set and others that are nearly as likely: the fewest terms, then the likeliest, then by name.

    A near tie does not hang on the last bit of a sum. A part of the best set answers only where its other terms are
    hardly better than nothing.
    """
    best = max(fits, key=lambda f: f.score)
    near = [f for f in fits if f.score >= best.score - MARGIN]
    near.sort(key=lambda f: [t.name for t in f.terms])
    fewest = min(near, key=lambda f: (len(f.terms), -round(f.score)))
    part_of_best = fewest.key < best.key
    if part_of_best and fewest.score < best.score - NAMED:
        return best
    return fewest
