"""A walk over sets of effects: a beam that adds, takes away and exchanges, and remembers every set it weighed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from models.effects import Effect
from models.frames import Array
from replay.residual.record import Record
from replay.search.evidence import TRUST, Evidence, Fit, Noise
from replay.search.library import Library
from replay.search.sets import canonical
from replay.search.terms import Key, Term

MOST, MOST_A_FLIGHT = 9, 3
"""Terms of a set: of one flight, and more for every other."""
BEAM = 5
"""Sets that are carried on."""
TRIED = 6
"""How many additions to a set are weighed in full, for each noise that they are screened beside."""
WORTH_A_LOOK = -3.0
"""Log posterior odds by screening from which on a term is weighed."""
BETWEEN = 30.0
"""A term this much (log) short of being worth it may be so between the points of its grid."""
SURE = 0.995
"""No more than this is claimed: models are wrong more often than the probabilities inside a model say."""


@dataclass
class Walked:
    """Every set that was weighed, by the keys of its terms."""

    evidence: Evidence
    quiet: Noise
    fits: dict[frozenset[Key], Fit] = field(default_factory=dict)
    best: Fit = field(init=False)
    map_log_odds: float = -np.inf
    """Log odds of the map of surfaces, beside the best set."""
    worse: set[str] = field(default_factory=set)
    """Effects that were taken out because they made unseen time worse."""

    def weigh(self, terms: Sequence[Term], near: Fit) -> Fit:
        """The fit of a set, the best of its shapes so far."""
        fit = self.evidence.fit(sorted(terms, key=lambda t: str(t.key)), near.noise)
        known = self.fits.setdefault(fit.key, fit)
        if fit.score > known.score + 1e-9:
            self.fits[fit.key] = fit
        return self.fits[fit.key]

    def ranked(self) -> list[Fit]:
        """Likeliest first."""
        return sorted(self.fits.values(), key=lambda f: (-round(f.score, 6), str(sorted(map(str, f.key)))))

    def weighted(self) -> list[tuple[Fit, float]]:
        """Sets with their probability, those of some weight."""
        top = max(f.score for f in self.fits.values())
        total = sum(float(np.exp(f.score - top)) for f in self.fits.values())
        return [(f, float(np.exp(f.score - top)) / total) for f in self.ranked() if f.score > top - 12.0]

    def probability(self, name: str, aliases: Sequence[str]) -> float:
        """That the effect, or one that stands in its place, acts."""
        effect = next((t.effect for t in self.best.terms if t.name == name), None)
        if effect is not None and effect.remainder:
            return round(min(1.0 / (1.0 + float(np.exp(-self.map_log_odds))), SURE), 3)
        wanted = {name, *aliases}
        p = sum(w for f, w in self.weighted() if wanted & {t.name for t in f.terms if t.effect is not None})
        return round(min(p, SURE), 3)

    def why_not(self, name: str) -> str:
        """Why an effect is not in the answer."""
        if name in self.worse:
            return "fitted on a part of the time it makes the rest worse"
        with_it = [f for f in self.ranked() if name in {t.name for t in f.terms}]
        if not with_it:
            return "no better than chance"
        fit = with_it[0]
        if fit.worth < -1.0:
            return "too small beside the others, or takes too little off its axes"
        if fit.evidence < self.best.evidence + 1.0:
            return "the other effects do as well without it"
        return "not likely beside the others"


def walk(records: Sequence[Record], effects: Sequence[Effect], beside: Sequence[Sequence[Array]] = ()) -> Walked:
    """Weigh sets of effects over all flights together; ``beside``: as of ``Library``."""
    evidence = Evidence(Library(records, effects, beside))
    walked = Walked(evidence, evidence.quiet())
    empty = evidence.fit([], evidence.unfitted())
    walked.fits[empty.key] = empty
    beam = [empty]
    for _ in range(MOST + MOST_A_FLIGHT * (len(records) - 1)):
        grown: dict[frozenset[Key], Fit] = {}
        for fit in beam:
            for term in _additions(walked, fit, TRIED):
                new = _with(walked, fit, term)
                if fit.score - BETWEEN < new.score <= fit.score:
                    new = _sharpened(walked, new, only=term.key)
                if new.promise > fit.promise:
                    grown[new.key] = new
        if not grown:
            break
        top = sorted(grown.values(), key=lambda f: -round(f.promise, 6))[:BEAM]
        polished = (_lighter(walked, _sharpened(walked, _reshaped(walked, fit))) for fit in top)
        beam = list({f.key: f for f in polished}.values())
    best = max(walked.fits.values(), key=lambda f: f.score)
    for _ in range(3):
        best = _sharpened(walked, _settled(walked, best))
        _exchanged(walked, best)
        known = best.key
        best = canonical(list(walked.fits.values()))
        if best.key <= known:
            break
    walked.best = walked.fits[best.key]
    return walked


def _additions(walked: Walked, fit: Fit, tried: int) -> list[Term]:
    """The best shapes of what might be added, beside the set's own noise and beside quiet noise."""
    evidence = walked.evidence
    taken = {t.key for t in fit.terms}
    inside = {name for t in fit.terms if t.effect is not None for name in t.effect.contains}
    names = {t.name for t in fit.terms}
    terms = evidence.library.terms
    rivals = [
        i for i, t in enumerate(terms)
        if t.key not in taken and t.name not in inside
        and (t.effect is None or not names & set(t.effect.contains))
    ]  # fmt: skip
    prior = {i: evidence.prior(terms[i]) for i in rivals}
    out: list[Term] = []
    for noise in dict.fromkeys((fit.noise, walked.quiet)):
        near = fit if noise is fit.noise else evidence.refit(fit.terms, noise)
        screened = evidence.screen(near)
        best: dict[Key, tuple[float, Term]] = {}
        for i in rivals:
            g, term = round(TRUST * float(screened[i]) + prior[i], 6), terms[i]
            if term.key not in best or g > best[term.key][0]:
                best[term.key] = (g, term)
        ranked = sorted(best.values(), key=lambda p: (-p[0], str(p[1].key)))
        out += [t for g, t in ranked[:tried] if g > WORTH_A_LOOK and t not in out]
    return out


def _with(walked: Walked, fit: Fit, term: Term) -> Fit:
    """A set and one term more; in its other shapes, too, where this one fits but is not possible or worth a name."""
    new = walked.weigh([*fit.terms, term], fit)
    if new.score > fit.score or new.score - new.worth - min(new.within, 0.0) <= fit.score:
        return new
    evidence = walked.evidence
    screened = evidence.screen(evidence.refit(fit.terms, fit.noise), term.key)
    for i, other in enumerate(evidence.library.terms):
        if other.key == term.key and TRUST * float(screened[i]) + evidence.prior(other) > WORTH_A_LOOK:
            new = walked.weigh([*fit.terms, other], fit)
    return new


def _reshaped(walked: Walked, fit: Fit, only: Key | None = None) -> Fit:
    """Every member's best shape beside the others."""
    evidence = walked.evidence
    for term in fit.terms:
        if only is not None and term.key != only:
            continue
        terms = evidence.library.terms
        rivals = [i for i, t in enumerate(terms) if t.key == term.key]
        if len(rivals) < 2 or term not in fit.terms:
            continue
        others = [t for t in fit.terms if t is not term]
        screened = evidence.screen(evidence.refit(others, fit.noise), term.key)
        rival = terms[max(rivals, key=lambda i: round(TRUST * float(screened[i]) + terms[i].log_shape, 6))]
        if rival is not term:
            new = walked.weigh([*others, rival], fit)
            if new.score > fit.score:
                fit = new
    return fit


def _sharpened(walked: Walked, fit: Fit, only: Key | None = None) -> Fit:
    """Shapes between the points of the grid."""
    for done in range(max((t.effect.halvings for t in fit.terms if t.effect is not None), default=0)):
        for term in fit.terms:
            if (only is not None and term.key != only) or term.effect is None or term.effect.halvings <= done:
                continue
            if term in fit.terms and walked.evidence.library.finer(term, 0.5):
                fit = _reshaped(walked, fit, only=term.key)
    return fit


def _lighter(walked: Walked, fit: Fit) -> Fit:
    """Less whatever the others do without."""
    for term in fit.terms:
        if term in fit.terms and len(fit.terms) > 1:
            new = walked.weigh([t for t in fit.terms if t.key != term.key], fit)
            if new.promise > fit.promise:
                return _lighter(walked, new)
    return fit


def _settled(walked: Walked, fit: Fit) -> Fit:
    """Exchange, add and take away one at a time until nothing is better."""
    for _ in range(6):
        best = fit
        for term in fit.terms:
            less = walked.weigh([t for t in fit.terms if t is not term], fit)
            tried = [less, *(_with(walked, less, other) for other in _additions(walked, less, 4))]
            best = max([best, *tried], key=lambda f: f.score)
        grown = [_with(walked, fit, other) for other in _additions(walked, fit, TRIED)]
        best = _reshaped(walked, max([best, *grown], key=lambda f: f.score))
        if best.score <= fit.score + 1e-6:
            return best
        fit = best
    return fit


def _exchanged(walked: Walked, fit: Fit) -> None:
    """Weigh one in place of two, and two in place of one, so that every alternative is known."""

    def others(gone: Sequence[Term], tried: int) -> list[Fit]:
        less = walked.weigh([t for t in fit.terms if t not in gone], fit)
        return [_with(walked, less, other) for other in _additions(walked, less, tried)]

    for pair in combinations(fit.terms, 2):
        others(pair, 2)
    for term in fit.terms:
        for grown in others([term], 3):
            if term.key not in grown.key and grown.score > fit.score - 60.0:
                for other in _additions(walked, grown, 2):
                    walked.weigh([*grown.terms, other], grown)
