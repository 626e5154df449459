"""Sets that share the probability: which effects could stand in each other's place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from replay.search.evidence import Fit
    from replay.search.terms import Key
    from replay.search.walk import Walked

ALIAS_NATS = 9.0
"""Sets less likely by this much (log) than the best are no alternative."""


@dataclass(frozen=True)
class Rival:
    """Effects (``names``) that do about as well as those of the best set with ``instead_of`` as keys."""

    names: tuple[str, ...]
    instead_of: frozenset[Key]
    behind: float


def rivals_of(walked: Walked) -> list[Rival]:
    """Alternatives within the best set: the same but for a few effects."""
    best = walked.best
    mine = {t.key: t for t in best.terms}
    out: list[Rival] = []
    for fit in walked.ranked():
        behind = best.score - fit.score
        if behind > ALIAS_NATS:
            break
        theirs = {t.key: t for t in fit.terms}
        gone, new = mine.keys() - theirs.keys(), theirs.keys() - mine.keys()
        if not gone or not new or len(gone) > 2 or len(new) > 2:
            continue
        names = tuple(sorted({key[0] for key in new if theirs[key].effect is not None}))
        lost = frozenset(key for key in gone if mine[key].effect is not None)
        if names and lost and all(theirs[key].effect is not None for key in new):
            out.append(Rival(names, lost, behind))
    return out


def canonical(fits: list[Fit], margin: float) -> Fit:
    """Of the best set and others within ``margin`` of it that are no part of it.

    The fewest terms, then the likeliest, then by name: a near tie does not hang on the last bit of a sum.
    """
    best = max(fits, key=lambda f: f.score)
    near = [best, *(f for f in fits if f.score > best.score - margin and not f.key < best.key)]
    return min(near, key=lambda f: (len(f.terms), -round(f.score), tuple(t.key[0] for t in f.terms)))
