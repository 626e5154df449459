"""What the named effects leave of ground and wall: a map over height and distance, weighed after the walk.

The map has a Gaussian-process prior, so its evidence pays for its freedom (Rasmussen & Williams 2006, ch. 5). A formula
says more than a map: the map is taken where ``TRUST log p(y | set, map) + log odds`` exceeds that of the set alone by
``MARGIN``, and a term of the set is taken out where that of the rest exceeds it by as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from models.effects import Effect
from replay.search.evidence import Evidence, Fit
from replay.search.posterior import Walked
from replay.search.terms import Term, without_form
from replay.search.thresholds import MARGIN

ROUNDS = 2
"""How often every spread of the map is chosen anew beside the others."""


def with_surface_law(walked: Walked) -> Walked:
    """The best set with the map, beside its laws or in their place, where that is clearly likelier; its log odds."""
    best = walked.best
    for effect in walked.evidence.library.remainders:
        lawless = tuple(t for t in best.terms if t.name not in effect.aliases)
        candidates = []
        for terms in dict.fromkeys((best.terms, lawless)):
            mapped = _with_map(walked.evidence, terms, effect)
            candidates.append(_lighter(walked.evidence, mapped))
        mapped = max(candidates, key=lambda fit: round(fit.score_at_any_size, 6))
        odds = mapped.score_at_any_size - best.score_at_any_size
        if odds > MARGIN:
            return replace(
                walked, best=replace(mapped, significance=best.significance), map_log_odds=odds
            )
    return walked


def _with_map(evidence: Evidence, terms: Sequence[Term], effect: Effect) -> Fit:
    """A set with the map in its likeliest spread, each of its numbers in turn (empirical Bayes)."""
    library = evidence.library
    quiet = evidence.noises.quiet
    # The map takes the place of the model-form errors of the laws that it corrects.
    named = []
    for t in terms:
        if t.name in effect.aliases:
            named.append(without_form(t))
        else:
            named.append(t)
    grid = np.array(effect.shape_grid(library.records[0].context))

    @cache
    def score_at(shape: tuple[float, ...]) -> float:
        term = library.term_of(effect, shape)
        found = evidence.fit([*named, term], quiet)
        evidence.forget(term)  # its many columns would stay in the way of all others
        return found.score_at_any_size

    shape = tuple(1.0 for _ in grid.T)
    for _ in range(ROUNDS):
        for i, values in enumerate(grid.T):
            shapes = [(*shape[:i], float(v), *shape[i + 1 :]) for v in np.unique(values)]
            shape = max(shapes, key=score_at)
    return evidence.fit([*named, library.term_of(effect, shape)], quiet)


def _lighter(evidence: Evidence, fit: Fit) -> Fit:
    """Without the terms that the map, which is the last, clearly makes unnecessary."""
    lighter = []
    for term in fit.terms[:-1]:
        lighter.append(evidence.fit(fit.terms_without(term), fit.noise))
    lightest = max(lighter, key=lambda f: f.score_at_any_size, default=fit)
    if lightest.score_at_any_size > fit.score_at_any_size + MARGIN:
        return _lighter(evidence, lightest)
    return fit
