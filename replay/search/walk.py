"""A walk over sets of effects: a beam that adds, takes away and exchanges, and remembers every set it weighed.

A search for the mode of the posterior over sets (``score`` of evidence.py), which is too large to be summed. The best
``BEAM`` sets grow by one term, screened by ``Evidence.screen``. Each is reshaped, sharpened between the points of its
grid, and freed of what the others do without. At the end one term at a time, and two for one, are exchanged, so that
every near alternative has its weight (Occam's window: Madigan & Raftery 1994, JASA 89, 1535).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
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
    _grown(sets, empty, MOST + MOST_A_FLIGHT * (len(records) - 1), account)
    best = max(sets.fits.values(), key=lambda f: f.score)
    for _ in range(3):
        best = _sharpened(sets, _settled(sets, best, account))
        _exchanged(sets, best, account)
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


def _grown(sets: Sets, empty: Fit, most: int, account: Account) -> None:
    """Sets of one term more, again and again, from the best ones."""
    beam = [empty]
    for _ in range(most):
        if not account.lasts(GROWING, LARGER):
            break
        grown: dict[frozenset[Key], Fit] = {}
        for fit in beam:
            for term in additions(sets, fit, TRIED):
                if not account.lasts(GROWING, LARGER):
                    break
                new = _with(sets, fit, term)
                if fit.score - BETWEEN < new.score <= fit.score:
                    new = _sharpened(sets, new, only=term.key)
                if new.promise > fit.promise:
                    grown[new.key] = new
        if not grown:
            break
        polished: dict[frozenset[Key], Fit] = {}
        for fit in sorted(grown.values(), key=lambda f: -round(f.promise, 6))[:BEAM]:
            light = lighter(sets, _sharpened(sets, _reshaped(sets, fit)))
            polished[light.key] = light
        beam = list(polished.values())


def additions(sets: Sets, fit: Fit, tried: int) -> list[Term]:
    """The best shapes of what might be added, beside the set's own noise and beside quiet noise.

    What is certain but far too small for a name would stand in the way of what is larger.
    """
    evidence = sets.evidence
    taken = {t.key for t in fit.terms}
    inside: set[str] = set()
    for t in fit.of_effects:
        inside.update(t.named.contains)
    rivals = []
    names = fit.effects
    for i, t in enumerate(evidence.library.terms):
        holds_one = t.effect is not None and not names.isdisjoint(t.effect.contains)
        if t.key not in taken and t.name not in inside and not holds_one:
            rivals.append(i)
    out: list[Term] = []
    for noise in dict.fromkeys((fit.noise, evidence.noises.quiet)):
        if noise is fit.noise:
            near = fit
        else:
            near = evidence.refit(fit.terms, noise)
        likely = (t for odds, t in evidence.promising(near, rivals) if odds > WORTH_A_LOOK)
        large = (t for t in likely if evidence.stands_out(near, t) >= HOPELESS)
        out += [t for t in islice(large, tried) if t not in out]
    return out


def _with(sets: Sets, fit: Fit, term: Term) -> Fit:
    """A set and one term more; in other shapes, too, where this one fits but is not possible or worth a name.

    Of those the likely ones are weighed: the others are too small or not possible beside the set's noise already.
    """
    new = sets.weigh([*fit.terms, term], fit)
    if new.score > fit.score or new.score - new.worth - min(new.within, 0.0) <= fit.score:
        return new
    evidence = sets.evidence
    numbers = evidence.library.numbers_of[term.key]
    if len(numbers) == 1:
        return new
    screened = evidence.screen(evidence.refit(fit.terms, fit.noise), term.key)
    likely: dict[Term, float] = {}
    for i in numbers:
        other = evidence.library.terms[i]
        likely[other] = TRUST * float(screened[i]) + other.prior
    odds: dict[Term, float] = {}
    best = -math.inf
    for other in sorted(likely, key=lambda t: -likely[t]):
        together = [*fit.terms, other]
        least = best - ALIAS_NATS - likely[other]
        if likely[other] > WORTH_A_LOOK and evidence.possible(together) > least:
            odds[other] = likely[other] + evidence.deserved(together, fit.noise, least)
            best = max(best, odds[other])
    for other in sorted(odds, key=lambda t: -odds[t])[:SHAPES]:
        if odds[other] > best - ALIAS_NATS:
            new = sets.weigh([*fit.terms, other], fit)
    return new


def _reshaped(sets: Sets, fit: Fit, only: Key | None = None) -> Fit:
    """Every member's best shape beside the others."""
    evidence = sets.evidence
    for term in (t for t in fit.terms if only in (None, t.key)):
        numbers = evidence.library.numbers_of[term.key]
        if len(numbers) < 2 or term not in fit.terms:
            continue
        others = fit.beside(term)
        screened = evidence.screen(evidence.refit(others, fit.noise), term.key)
        odds: dict[Term, float] = {}
        for i in numbers:
            other = evidence.library.terms[i]
            odds[other] = round(TRUST * float(screened[i]) + other.log_shape, 6)
        rival = max(odds, key=lambda t: odds[t])
        if rival is not term:
            new = sets.weigh([*others, rival], fit)
            if new.score > fit.score:
                fit = new
    return fit


def _sharpened(sets: Sets, fit: Fit, only: Key | None = None) -> Fit:
    """Shapes between the points of the grid."""
    halvings = {t.key: t.named.search.halvings for t in fit.of_effects if only in (None, t.key)}
    for done in range(max(halvings.values(), default=0)):
        for term in fit.terms:
            wanted = halvings.get(term.key, 0) > done
            if wanted and term in fit.terms and sets.evidence.library.finer(term, 0.5):
                fit = _reshaped(sets, fit, only=term.key)
    return fit


def lighter(sets: Sets, fit: Fit) -> Fit:
    """Less whatever the others do without."""
    for term in fit.terms:
        if len(fit.terms) > 1:
            new = sets.weigh(fit.beside(term), fit)
            if new.promise > fit.promise:
                return lighter(sets, new)
    return fit


def _settled(sets: Sets, fit: Fit, account: Account) -> Fit:
    """Exchange, add and take away one at a time until nothing is better."""
    for _ in range(6):
        best = fit
        for term in fit.terms:
            if not account.lasts(SETTLING, "one effect in place of another"):
                return best
            less = sets.weigh(fit.beside(term), fit)
            tried = [less, *(_with(sets, less, other) for other in additions(sets, less, 4))]
            best = max([best, *tried], key=lambda f: f.score)
        grown = [_with(sets, fit, other) for other in additions(sets, fit, TRIED)]
        best = _reshaped(sets, max([best, *grown], key=lambda f: f.score))
        if best.score <= fit.score + 1e-6:
            return best
        fit = best
    return fit


def _exchanged(sets: Sets, fit: Fit, account: Account) -> None:
    """Weigh one in place of two, and two in place of one, so that every alternative is known."""

    def others(gone: Sequence[Term], tried: int) -> list[Fit]:
        less = sets.weigh([t for t in fit.terms if t not in gone], fit)
        return [_with(sets, less, other) for other in additions(sets, less, tried)]

    for pair in combinations(fit.terms, 2):
        if account.lasts(1.0, "one effect in place of two"):
            others(pair, 2)
    for term in fit.terms:
        if not account.lasts(1.0, "two effects in place of one"):
            return
        for grown in others([term], 3):
            if term.key not in grown.key and grown.score > fit.score - EXCHANGE_LOSS:
                for other in additions(sets, grown, 4):
                    sets.weigh([*grown.terms, other], grown)
