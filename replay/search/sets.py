"""Sets that share the probability: which effects could stand in each other's place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from replay.search.evidence import Fit
    from replay.search.terms import Key
    from replay.search.walk import Walked

MARGIN = 4.0
"""Sets as likely as the best but for this much (log) count as equal."""
NAMED = 1.0
"""The same of sets that lack a term of the best: a name is stated from odds of e to one on."""
ALIAS_NATS = 9.0
"""Sets less likely by this much (log) than the best are no alternative."""


@dataclass(frozen=True)
class Rival:
    """Effects (``names``) that do about as well as those of the best set with ``instead_of`` as keys."""

    names: tuple[str, ...]
    instead_of: frozenset[Key]


def rivals_of(walked: Walked) -> list[Rival]:
    """Alternatives within the best set: the same but for a few effects."""
    best = walked.best
    mine = {t.key: t for t in best.terms}
    out: list[Rival] = []
    for fit in walked.ranked():
        if best.score - fit.score > ALIAS_NATS:
            break
        theirs = {t.key: t for t in fit.terms}
        gone, new = mine.keys() - theirs.keys(), theirs.keys() - mine.keys()
        if not gone or not new or len(gone) > 2 or len(new) > 2:
            continue
        names = tuple(sorted({key[0] for key in new if theirs[key].effect is not None}))
        lost = frozenset(key for key in gone if mine[key].effect is not None)
        if names and lost and all(theirs[key].effect is not None for key in new):
            out.append(Rival(names, lost))
    return [*out, *_within_form(walked)]


def _within_form(walked: Walked) -> list[Rival]:
    """Effects that would help beside an alias of theirs, but by no more than what that leaves by its error of form."""
    best = walked.best
    out = []
    for fit in walked.ranked():
        more = [t for t in fit.terms if t.key not in best.key]
        if len(more) == 1 and best.key < fit.key and fit.score - fit.worth > best.score:
            (term,) = more
            over = [t.key for t in best.terms if t.effect is not None and term.name in t.effect.aliases]
            out += [Rival((term.name,), frozenset([key])) for key in over]
    return out


def canonical(fits: list[Fit]) -> Fit:
    """Of the best set and others that are nearly as likely: the fewest terms, then the likeliest, then by name.

    A near tie does not hang on the last bit of a sum. A part of the best set answers only where its other terms are
    hardly better than nothing. No set with more effects than the best stands in for it: fewer free curves are no reason
    for a name.
    """
    best = max(fits, key=lambda f: f.score)
    near = [f for f in fits if f.score >= best.score - MARGIN and _effects(f) <= _effects(best)]
    least = min(near, key=lambda f: (len(f.terms), -round(f.score), tuple(t.key[0] for t in f.terms)))
    return best if least.key < best.key and least.score < best.score - NAMED else least


def _effects(fit: Fit) -> int:
    return sum(t.effect is not None for t in fit.terms)
