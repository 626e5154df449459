"""The shape parameters of what was adopted: each again beside the others, then between the points of its grid."""

from __future__ import annotations

import numpy as np

from replay.search.library import Candidate, Columns, columns_of
from replay.search.workspace import Workspace

SHAPE_BIC = 6.0
"""Evidence (BIC) from which on another shape than theory's is believed."""


def refined(w: Workspace, chosen: list[Candidate]) -> list[Candidate]:
    """Every shape parameter again, given the others: the one that leaves the least residual."""
    for i, candidate in enumerate(chosen):
        others = columns_of([c for j, c in enumerate(chosen) if j != i])
        taken = {c.effect.name for c in chosen}
        best = best_shape(w, candidate.effect.name, others, taken) or candidate
        chosen = [*chosen[:i], _usual(w, best, others), *chosen[i + 1 :]]
    return chosen


def best_shape(w: Workspace, name: str, others: Columns, taken: set[str]) -> Candidate | None:
    """The plausible candidate of an effect that leaves the least residual beside other columns."""
    best, least = None, np.inf
    for candidate in w.library.candidates:
        if candidate.effect.name != name or w.ratio_again(candidate, taken):
            continue
        if not w.plausible(w.gram, others, candidate):
            continue
        columns = np.concatenate([others, candidate.columns])
        left = -float(w.gram.size(columns) @ w.gram.total_ry[columns])
        if left < least:
            best, least = candidate, left
    return best


def _usual(w: Workspace, best: Candidate, others: Columns) -> Candidate:
    """Theory's shape in place of the best one, unless that is clearly better."""
    usual = next((c for c in w.library.candidates if c.effect is best.effect and c.shape == best.effect.usual), None)
    if usual is None or not w.plausible(w.gram, others, usual):
        return best
    likelihood = []
    for candidate in (best, usual):
        columns = np.concatenate([others, candidate.columns])
        likelihood.append(float(w.gram.solve(columns) @ w.gram.total_wy[columns]))
    bic = likelihood[0] - likelihood[1] - len(best.shape) * np.log(w.gram.effective)
    return best if bic >= SHAPE_BIC else usual


def sharpened(w: Workspace, chosen: list[Candidate]) -> list[Candidate]:
    """The same effects with their shape parameters between the points of the grid."""
    finer = [f for candidate in chosen for f in w.library.finer(candidate)]
    if not finer:
        return chosen
    w.library.add(finer)
    w.take_in()
    return refined(w, chosen)
