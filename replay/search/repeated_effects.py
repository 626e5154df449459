"""Effects that a vehicle may have several times, such as a second weak fan: asked for once the first is in the set.

Each time is a term of its own, with the same prior, in another first shape. It is taken where the set with it is
likelier by ``ALIAS_NATS``: what is nearly as likely without it has no name of its own. In place of another term it is
taken where that set is likelier.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from replay.search.evidence import Fit
from replay.search.posterior import Sets, Walked
from replay.search.terms import Term
from replay.search.thresholds import ALIAS_NATS, TRUST
from replay.search.walk import lighter

TRIED = 3
"""Shapes that are weighed in full."""
MOST = 4
"""Times that one effect is looked for."""


def with_others(walked: Walked) -> Walked:
    """The best set, and what of it is there once more."""
    for _ in range(MOST - 1):
        more = _once_more(walked)
        if more is None:
            return walked
        walked = more
    return walked


def _once_more(walked: Walked) -> Walked | None:
    """A likelier set with one more term of an effect that it has; None where there is none."""
    best = walked.best
    sets = Sets(walked.evidence, dict(walked.fits))
    found: list[Fit] = []
    for term in _first_ones(best):
        found += _with_another(sets, best, term)
    most = max(found, key=lambda fit: fit.score, default=best)
    # Of nearly equal sets the one with fewer terms answers.
    if most.score <= best.score + ALIAS_NATS * (len(most.terms) > len(best.terms)):
        return None
    return replace(walked, fits=sets.fits, best=most)


def _first_ones(fit: Fit) -> list[Term]:
    """Terms of effects that may be there several times, one of each effect and flight."""
    out = []
    for term in fit.of_effects:
        if term.named.search.several and term.instance == 1:
            out.append(term)
    return out


def _with_another(sets: Sets, fit: Fit, term: Term) -> list[Fit]:
    """Sets with another term like ``term``: beside all others, or in place of one of them."""
    same = [t for t in fit.terms if t.name == term.name and t.flight == term.flight]
    taken = {t.shape[0] for t in same}
    others = sets.evidence.library.again(term, len(same) + 1, taken)
    if not others:
        return []
    bases = [fit]
    for gone in fit.terms:
        if gone not in same:
            bases.append(sets.weigh(fit.terms_without(gone), fit))
    grown: list[Fit] = []
    for base in bases:
        grown += _grown(sets, base, others)
    likeliest = max(grown, key=lambda new: new.score_at_any_size)
    return [lighter(sets, likeliest)]


def _grown(sets: Sets, base: Fit, others: Sequence[Term]) -> list[Fit]:
    """A set with each of the likeliest of ``others``, which are one effect in all its shapes."""
    library = sets.evidence.library
    key = others[0].key
    screened = sets.evidence.screen(base, key)
    odds = {}
    for number in library.numbers_of[key]:
        term = library.terms[number]
        odds[term] = TRUST * float(screened[number]) + term.prior
    likely = sorted(others, key=lambda t: -odds[t])
    return [sets.weigh([*base.terms, other], base) for other in likely[:TRIED]]
