"""A walk over sets of effects: a beam that adds, takes away and exchanges, and remembers every set it weighed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.effects import Effect
from replay.residual.record import Record
from replay.search.evidence import TRUST, Evidence, Fit, Noise
from replay.search.terms import Library, Term

MOST = 9
BEAM = 5
TRIED = 6
"""How many additions to a set are weighed in full."""


@dataclass(frozen=True)
class Walked:
    evidence: Evidence
    fits: dict[frozenset, Fit]
    best: Fit

    def ranked(self) -> list[Fit]:
        return sorted(self.fits.values(), key=lambda f: -f.score)


def walk(records: Sequence[Record], effects: Sequence[Effect]) -> Walked:
    evidence = Evidence(Library(records, effects))
    library = evidence.library
    fits: dict[frozenset, Fit] = {}

    def weigh(terms: Sequence[Term], near: Fit) -> Fit:
        key = frozenset(t.key for t in terms)
        fit = evidence.fit(sorted(terms, key=lambda t: t.key[0]), near.noise)
        if key not in fits or fit.score > fits[key].score:
            fits[key] = fit
        return fits[key]

    empty = evidence.fit([], evidence.start())
    quiet = evidence.quiet()
    fits[frozenset()] = empty
    beam = [empty]
    for _ in range(MOST):
        grown: list[Fit] = []
        for fit in beam:
            for term in _best_additions(evidence, fit, quiet):
                new = weigh([*fit.terms, term], fit)
                if new.score > fit.score:
                    grown.append(new)
        if not grown:
            break
        unique = {frozenset(t.key for t in f.terms): f for f in grown}
        top = sorted(unique.values(), key=lambda f: -f.score)[:BEAM]
        beam = []
        for fit in top:
            fit = _reshaped(evidence, fit, weigh)
            fit = _sharpened(evidence, fit, weigh)
            fit = _lighter(fit, weigh)
            beam.append(fit)
        beam = list({frozenset(t.key for t in f.terms): f for f in beam}.values())
    best = max(fits.values(), key=lambda f: f.score)
    best = _settled(evidence, best, weigh, quiet)
    best = _sharpened(evidence, best, weigh)
    best = _settled(evidence, best, weigh, quiet)
    return Walked(evidence, fits, best)


def _excluded(fit: Fit) -> set[str]:
    out: set[str] = set()
    for t in fit.terms:
        if t.effect is not None:
            out |= set(t.effect.contains)
    return out


def _contains_taken(term: Term, fit: Fit) -> bool:
    names = {t.name for t in fit.terms}
    return term.effect is not None and bool(names & set(term.effect.contains))


def _best_additions(evidence: Evidence, fit: Fit, quiet: Noise, tried: int = TRIED) -> list[Term]:
    """The best shape of every term that is not in the set, best first."""
    taken = {t.key for t in fit.terms}
    out = _excluded(fit)
    open_ = [t for t in evidence.library.terms if t.key not in taken and t.name not in out and not _contains_taken(t, fit)]
    if not open_:
        return []
    out_terms: list[Term] = []
    for noise in dict.fromkeys((fit.noise, quiet)):
        near = fit if noise is fit.noise else evidence.refit(fit.terms, noise)
        gain = TRUST * evidence.screen(near, open_) + np.array([evidence._prior(t) for t in open_])
        best: dict[tuple, tuple[float, Term]] = {}
        for g, term in zip(gain, open_, strict=True):
            if term.key not in best or g > best[term.key][0] + 1e-9:
                best[term.key] = (float(g), term)
        ranked = sorted(best.values(), key=lambda p: -p[0])
        out_terms += [t for g, t in ranked[:tried] if g > -3.0 and t not in out_terms]
    return out_terms


def _reshaped(evidence: Evidence, fit: Fit, weigh, only: tuple | None = None) -> Fit:
    """Every member's best shape beside the others."""
    for term in list(fit.terms):
        if term not in fit.terms or (only is not None and term.key != only):
            continue
        others = [t for t in fit.terms if t is not term]
        base = evidence.fit(others, fit.noise, rounds=0)
        rivals = [t for t in evidence.library.terms if t.key == term.key]
        if len(rivals) < 2:
            continue
        gain = TRUST * evidence.screen(base, rivals) + np.array([t.log_shape for t in rivals])
        rival = rivals[int(np.argmax(np.round(gain, 6)))]
        if rival is not term:
            new = weigh([*others, rival], fit)
            if new.score > fit.score:
                fit = new
    return fit


def _sharpened(evidence: Evidence, fit: Fit, weigh) -> Fit:
    """Shapes between the points of the grid, halved twice."""
    for _ in range(2):
        for term in list(fit.terms):
            if term.shape and term in fit.terms and evidence.library.finer(term, 0.5):
                fit = _reshaped(evidence, fit, weigh, only=term.key)
    return fit


def _lighter(fit: Fit, weigh) -> Fit:
    """Less whatever the others do without."""
    again = True
    while again and len(fit.terms) > 1:
        again = False
        for term in fit.terms:
            new = weigh([t for t in fit.terms if t is not term], fit)
            if new.score > fit.score:
                fit, again = new, True
                break
    return fit


def _settled(evidence: Evidence, fit: Fit, weigh, quiet: Noise) -> Fit:
    """Exchange, add and take away one at a time until nothing is better."""
    for _ in range(6):
        best = fit
        for term in fit.terms:
            less = weigh([t for t in fit.terms if t is not term], fit)
            if less.score > best.score:
                best = less
            for other in _best_additions(evidence, less, quiet, 4):
                new = weigh([*less.terms, other], less)
                if new.score > best.score:
                    best = new
        for other in _best_additions(evidence, fit, quiet):
            new = weigh([*fit.terms, other], fit)
            if new.score > best.score:
                best = new
        best = _reshaped(evidence, best, weigh)
        if best is fit or best.score <= fit.score + 1e-6:
            break
        fit = best
    return fit
