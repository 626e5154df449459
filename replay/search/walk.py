"""A walk over sets of effects: a beam that adds, takes away and exchanges, and remembers every set it weighed.

A search for the mode of the posterior over sets (``score`` of evidence.py), which is too large to be summed. The best
``BEAM`` sets grow by one term, screened by ``Evidence.screen``. Each is reshaped, sharpened between the points of its
grid, and freed of what the others do without. At the end one term at a time, and two for one, are exchanged, so that
every near alternative has its weight (Occam's window: Madigan & Raftery 1994, JASA 89, 1535).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, islice

from models.effects import Effect
from replay.residual.record import Record
from replay.search.evidence import Evidence, Fit
from replay.search.library import Library
from replay.search.posterior import Sets, Walked, canonical
from replay.search.terms import Key, Term
from replay.search.thresholds import ALIAS_NATS, HOPELESS, TRUST

MOST = 9
MOST_A_FLIGHT = 3
"""Terms of a set: of one flight, and more for every other."""
BEAM = 4
"""Sets that are carried on."""
TRIED = 9
"""How many additions to a set are weighed in full, for each noise that they are screened beside."""
SHAPES = 6
"""Shapes of an addition that are weighed in full: of those that became an answer, none came later than the fourth."""
WORTH_A_LOOK = -3.0
"""Log posterior odds by screening from which on a term is weighed."""
EXCHANGE_LOSS = 60.0
"""An exchange that loses less than this (log) is grown by one more term: two may stand in place of one."""
MOST_WORK = 14_000.0
LONG_S = 600.0
"""Work that a walk may do over a log of up to this time [s]; over longer or several logs it grows with them.

A core of 2023 does about 2000 a second, and ten seconds are what a user waits for: three go into starting, reading and
summing up.
"""
GROWING = 0.7
SETTLING = 0.9
"""Shares of it after which sets stop to grow, and single effects to be exchanged."""
LARGER = "larger sets of effects"
BETWEEN = 30.0
"""A term this much (log) short of being worth it may be so between the points of its grid."""


def walk(records: Sequence[Record], effects: Sequence[Effect]) -> Walked:
    """Weigh sets of effects over all flights together."""
    evidence = Evidence(Library(records, effects))
    account = Account(evidence, allowed(records))
    empty = evidence.fit([], evidence.noises.unfitted)
    sets = Sets(evidence, {empty.key: empty})
    most_terms = MOST + MOST_A_FLIGHT * (len(records) - 1)
    _grow(sets, empty, most_terms, account)
    best = _best(list(sets.fits.values()))
    for _ in range(3):
        best = _sharpened(sets, _settled(sets, best, account))
        _weigh_exchanges(sets, best, account)
        known = best.key
        best = canonical(list(sets.fits.values()))
        if best.key <= known:
            break
    return Walked(
        evidence=evidence,
        fits=sets.fits,
        best=sets.fits[best.key],
        left_out=tuple(account.left_out),
    )


def allowed(records: Sequence[Record]) -> float:
    """How much work a walk over these flights may do: for every log, or for every ``LONG_S`` of flight."""
    logs = len({r.path for r in records})
    seconds = sum(r.seconds for r in records)
    return MOST_WORK * max(logs, seconds / LONG_S)


@dataclass
class Account:
    """The work that a walk may do, and what it had to leave out."""

    evidence: Evidence
    most: float
    left_out: dict[str, None] = field(default_factory=dict)

    def lasts(self, share: float, otherwise: str) -> bool:
        """Whether less than this share of the work is done; if not, ``otherwise`` is left out."""
        if self.evidence.work < share * self.most:
            return True
        self.left_out[otherwise] = None
        return False


def _grow(sets: Sets, empty: Fit, most: int, account: Account) -> None:
    """Sets of one term more, again and again, from the best ones."""
    beam = [empty]
    for _ in range(most):
        if not account.lasts(GROWING, LARGER):
            break
        grown: dict[frozenset[Key], Fit] = {}
        for fit in beam:
            for new in _larger(sets, fit, account):
                if new.score_at_any_size > fit.score_at_any_size:
                    grown[new.key] = new
        if not grown:
            break
        likeliest = sorted(grown.values(), key=lambda f: -round(f.score_at_any_size, 6))
        polished: dict[frozenset[Key], Fit] = {}
        for fit in likeliest[:BEAM]:
            shaped = _sharpened(sets, _reshaped(sets, fit))
            light = lighter(sets, shaped)
            polished[light.key] = light
        beam = list(polished.values())


def _larger(sets: Sets, fit: Fit, account: Account) -> Iterator[Fit]:
    """A set with each of the terms that may be added; where it falls a little short, between the grid's points."""
    for term in additions(sets, fit, TRIED):
        if not account.lasts(GROWING, LARGER):
            break
        new = _with(sets, fit, term)
        if fit.score - BETWEEN < new.score <= fit.score:
            new = _sharpened(sets, new, only=term.key)
        yield new


def additions(sets: Sets, fit: Fit, most: int) -> list[Term]:
    """The best shapes of what might be added, beside the set's own noise, beside quiet noise, and within its bounds.

    What is certain but far too small for a name would stand in the way of what is larger. What a coefficient
    explains beyond its bounds is another effect's.
    """
    evidence = sets.evidence
    candidates = _candidates(evidence.library, fit)
    views = [fit]
    if evidence.noises.quiet != fit.noise:
        views.append(evidence.refit(fit.terms, evidence.noises.quiet))
    within = evidence.held_at_bounds(fit)
    if within is not None:
        views.append(within)
    out: list[Term] = []
    for near in views:
        promising = evidence.promising(near, candidates)
        likely = (term for odds, term in promising if odds > WORTH_A_LOOK)
        large = (term for term in likely if evidence.stands_out(near, term) >= HOPELESS)
        out += [term for term in islice(large, most) if term not in out]
    return out


def _candidates(library: Library, fit: Fit) -> list[int]:
    """Numbers of terms that may stand beside a set: neither in it, nor a part of what is, nor what holds one."""
    parts: set[str] = set()
    for term in fit.of_effects:
        parts.update(term.named.contains)
    names = fit.effects
    keys = fit.key
    out = []
    for number, term in enumerate(library.terms):
        holds_one = term.effect is not None and not names.isdisjoint(term.effect.contains)
        if term.key not in keys and term.name not in parts and not holds_one:
            out.append(number)
    return out


def _with(sets: Sets, fit: Fit, term: Term) -> Fit:
    """A set and one term more; in other shapes, too, where this one fits but is not possible or worth a name."""
    new = sets.weigh([*fit.terms, term], fit)
    if new.score > fit.score:
        return new
    if_possible_and_large = new.score - new.significance - min(new.log_in_bounds, 0.0)
    if if_possible_and_large <= fit.score:
        return new
    for other in _other_shapes(sets.evidence, fit, term):
        new = sets.weigh([*fit.terms, other], fit)
    return new


def _other_shapes(evidence: Evidence, fit: Fit, term: Term) -> list[Term]:
    """The likeliest shapes of a term beside a set and its noise, what they deserve counted.

    The others are too small or not possible beside the set's noise already.
    """
    if len(evidence.library.numbers_of[term.key]) == 1:
        return []
    odds_by_fit = _odds(evidence, fit.terms, fit, term.key)
    odds: dict[Term, float] = {}
    best = -math.inf
    for shape in sorted(odds_by_fit, key=lambda t: -odds_by_fit[t]):
        together = [*fit.terms, shape]
        by_fit = odds_by_fit[shape]
        least = best - ALIAS_NATS - by_fit
        if by_fit > WORTH_A_LOOK and evidence.most_log_factors(together) > least:
            odds[shape] = by_fit + evidence.log_factors(together, fit.noise, least)
            best = max(best, odds[shape])
    likeliest = sorted(odds, key=lambda t: -odds[t])
    return [shape for shape in likeliest[:SHAPES] if odds[shape] > best - ALIAS_NATS]


def _odds(evidence: Evidence, terms: Sequence[Term], fit: Fit, key: Key) -> dict[Term, float]:
    """Log posterior odds of every shape with a key beside some terms and the noise of a fit."""
    library = evidence.library
    gains = evidence.screen(evidence.refit(terms, fit.noise), key)
    out = {}
    for number in library.numbers_of[key]:
        shape = library.terms[number]
        out[shape] = TRUST * float(gains[number]) + shape.prior
    return out


def _reshaped(sets: Sets, fit: Fit, only: Key | None = None) -> Fit:
    """Every member's best shape beside the others."""
    evidence = sets.evidence
    for term in fit.terms:
        one_shape = len(evidence.library.numbers_of[term.key]) < 2
        if only not in (None, term.key) or one_shape or term not in fit.terms:
            continue
        others = fit.terms_without(term)
        odds = _odds(evidence, others, fit, term.key)
        likeliest = max(odds, key=lambda t: round(odds[t], 6))
        if likeliest is not term:
            new = sets.weigh([*others, likeliest], fit)
            if new.score > fit.score:
                fit = new
    return fit


def _sharpened(sets: Sets, fit: Fit, only: Key | None = None) -> Fit:
    """Shapes between the points of the grid."""
    library = sets.evidence.library
    halvings = {t.key: t.named.search.halvings for t in fit.of_effects if only in (None, t.key)}
    for done in range(max(halvings.values(), default=0)):
        for term in fit.terms:
            unfinished = halvings.get(term.key, 0) > done
            if unfinished and term in fit.terms and library.finer(term, 0.5):
                fit = _reshaped(sets, fit, only=term.key)
    return fit


def lighter(sets: Sets, fit: Fit) -> Fit:
    """Less whatever the others do without."""
    for term in fit.terms:
        if len(fit.terms) > 1:
            new = sets.weigh(fit.terms_without(term), fit)
            if new.score_at_any_size > fit.score_at_any_size:
                return lighter(sets, new)
    return fit


def _settled(sets: Sets, fit: Fit, account: Account) -> Fit:
    """Exchange, add and take away one at a time until nothing is better."""
    for _ in range(6):
        tried = [fit]
        for term in fit.terms:
            if not account.lasts(SETTLING, "one effect in place of another"):
                return _best(tried)
            less = sets.weigh(fit.terms_without(term), fit)
            tried.append(less)
            tried += _grown(sets, less, 4)
        tried += _grown(sets, fit, TRIED)
        best = _reshaped(sets, _best(tried))
        if best.score <= fit.score + 1e-6:
            return best
        fit = best
    return fit


def _weigh_exchanges(sets: Sets, fit: Fit, account: Account) -> None:
    """Weigh one in place of two, and two in place of one, so that every alternative is known."""
    for pair in combinations(fit.terms, 2):
        if account.lasts(1.0, "one effect in place of two"):
            others = [t for t in fit.terms if t not in pair]
            _grown(sets, sets.weigh(others, fit), 2)
    for term in fit.terms:
        if not account.lasts(1.0, "two effects in place of one"):
            return
        less = sets.weigh(fit.terms_without(term), fit)
        for grown in _grown(sets, less, 3):
            if term.key not in grown.key and grown.score > fit.score - EXCHANGE_LOSS:
                for other in additions(sets, grown, 4):
                    sets.weigh([*grown.terms, other], grown)


def with_aliases(walked: Walked) -> Walked:
    """With every set weighed in which an alias stands in the place of an effect of the best; the best of these.

    After effects were taken out the best is a set that the walk need not have had for one to exchange.
    """
    sets = Sets(walked.evidence, dict(walked.fits))
    library = walked.evidence.library
    best = walked.best
    rivals = [best]
    for term in best.of_effects:
        less = sets.weigh(best.terms_without(term), best)
        allowed = set(term.named.aliases) - set(walked.dropped)
        instead: dict[Key, Term] = {}
        for number in _candidates(library, less):
            other = library.terms[number]
            if other.name in allowed:
                instead.setdefault(other.key, other)
        rivals += [_with(sets, less, other) for other in instead.values()]
    return replace(walked, fits=sets.fits, best=canonical(rivals))


def _grown(sets: Sets, fit: Fit, most: int) -> list[Fit]:
    """A set with each of so many additions."""
    return [_with(sets, fit, term) for term in additions(sets, fit, most)]


def _best(fits: Sequence[Fit]) -> Fit:
    """The likeliest; of equals the first."""
    return max(fits, key=lambda f: f.score)
