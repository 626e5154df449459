"""The next effect to adopt: the one that stands out most from chance, unless something speaks against it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.frames import Array
from replay.search.gram import inverse
from replay.search.library import Candidate, Columns, columns_of, out_of_range
from replay.search.workspace import ALIAS_BIC, ALIAS_OF_SCORE, CLASS_SHARE, THRUST_TO_MASS, Score, Workspace

ALPHA = 0.01
SMALLEST_GAIN = 0.03
"""Smallest share of the energy of its axes that an effect must take off time that its fit never saw."""
FORM_TOLERANCE = 0.12
"""An addition below this share of what is already explained on its axes is taken for the form error of a term."""
FREE_CURVE_FACTOR = 1.5
DRIFTING_SCALES = ("battery_sag", "thermal_derating")
"""Effects that hold a scale of the thrust besides what makes them themselves."""
FEW_BLOCKS, FEW_SCORE = 6.0, 40.0
"""Evidence from so few blocks that chance has heavy tails in them has to be so strong."""


class _NotMeant(str):
    """A reason that speaks against the effect itself, not for another one: weaker candidates stay in the race."""


def step(w: Workspace, chosen: list[Candidate]) -> tuple[Candidate, float] | None:
    """The next candidate with its p value; None where nothing more stands out."""
    gram, selected = w.gram, columns_of(chosen)
    taken = {c.effect.name for c in chosen}
    scores = w.scores(gram, selected, taken)
    if not scores:
        return None
    null = w.null(gram, selected, taken)
    before = gram.held_out(selected)
    failed: list[Score] = []
    for score in scores:
        name = score.candidate.effect.name
        p = null.p(name, score.value)
        if p > ALPHA:
            w.reasons[name] = (f"no better than chance (p = {p:.2g})", p)
            continue
        same = next((f for f in failed if _same(w, score, f, selected)), None)
        if same is not None:
            w.reasons[name] = (f"{same.candidate.effect.name} explains the same much better", p)
            continue
        problem = _problem(w, score.candidate, chosen, before)
        if problem is None:
            return _preferred(w, score, scores, chosen), p
        w.reasons[name] = (problem, p)
        if not isinstance(problem, _NotMeant):
            failed.append(score)
    return None


def _same(w: Workspace, score: Score, stronger: Score, selected: Columns) -> bool:
    """Whether little is left of a weak candidate beside a much stronger one."""
    if score.value >= 0.5 * stronger.value:
        return False
    schur, _, parts = w.gram.project(np.concatenate([selected, stronger.candidate.columns]))
    columns = score.candidate.columns
    part = parts.sum(0)[columns]
    left = float(part @ inverse(schur, w.gram.total_w, columns) @ part)
    return bool(left - len(columns) * np.log(w.gram.effective) < 0.5 * score.value)


def _preferred(w: Workspace, best: Score, scores: Sequence[Score], chosen: list[Candidate]) -> Candidate:
    """Which of several that would do.

    A scale of the thrust, unless its drift with voltage or heat stands out by itself. Of the class of thrust to mass:
    density is known from pressure and temperature, and where it would do, a free mass or scale is not fitted; a load
    less than none is a scale. An error of the rangefinder before a ground effect that takes lift away.
    """
    if best.candidate.effect.name == "ground_effect" and w.size_beside(best.candidate, chosen)[0] < 0.0:
        limit = best.value - max(ALIAS_BIC, ALIAS_OF_SCORE * best.value)
        offset = next((s for s in scores if s.candidate.effect.name == "range_offset" and s.value > limit), None)
        if offset is not None and out_of_range(offset.candidate, w.size_beside(offset.candidate, chosen)) is None:
            return offset.candidate
    if best.candidate.effect.name in DRIFTING_SCALES:
        scale = next((s.candidate for s in scores if s.candidate.effect.name == "thrust_scale"), None)
        if scale is not None and not _drifts(w, best.candidate, scale, chosen):
            return scale
    if best.candidate.effect.name not in THRUST_TO_MASS or not w.from_start(best.candidate):
        return best.candidate
    near = {s.candidate.effect.name: s.candidate for s in scores if s.value > (1.0 - CLASS_SHARE) * best.value}
    for name in ("air_density", "thrust_scale"):
        candidate = near.get(name)
        if candidate is None or (name == "thrust_scale" and w.size_beside(best.candidate, chosen)[0] >= 0.0):
            continue
        if out_of_range(candidate, w.size_beside(candidate, chosen)) is None:
            return candidate
    return best.candidate


def _drifts(w: Workspace, candidate: Candidate, scale: Candidate, chosen: list[Candidate]) -> bool:
    """Whether an effect is worth a name, and stands out, beside a plain scale (or that scale may not be)."""
    if w.implausible(scale, w.size_beside(scale, chosen)) is not None:
        return True
    others = [*chosen, scale]
    if not w.large(w.beside(candidate, w.size_beside(candidate, chosen), others)):
        return False
    columns, taken = columns_of(others), {c.effect.name for c in others}
    score = next((s for s in w.scores(w.gram, columns, taken) if s.candidate.effect is candidate.effect), None)
    return score is not None and w.null(w.gram, columns, taken).p(candidate.effect.name, score.value) <= ALPHA


def _problem(w: Workspace, candidate: Candidate, chosen: list[Candidate], before: Array) -> str | None:
    """Why a significant candidate is not adopted, or None."""
    gram, selected = w.gram, columns_of([*chosen, candidate])
    coefficients = w.size_beside(candidate, chosen)
    bad = w.implausible(candidate, coefficients)
    if bad is not None:
        return _NotMeant(bad)
    late = w.late(candidate, coefficients)
    if late is not None:
        return _NotMeant(late)
    contribution = w.beside(candidate, coefficients, chosen)
    if not w.large(contribution):
        return _NotMeant("too small to matter")
    if not w.core_large(candidate, coefficients):
        return _NotMeant(f"its {' and '.join(candidate.effect.main)} are too small to matter")
    if w.core_share(candidate, coefficients) < FORM_TOLERANCE:
        return _NotMeant(f"its {' and '.join(candidate.effect.main)} are within the error of form of its other terms")
    if chosen:
        own = contribution[w.record.valid]
        rest = w.library.x[:, :, columns_of(chosen)] @ gram.size(selected)[: -len(candidate.columns)]
        strong = (own**2).mean(0) / gram.noise.total**2
        share = strong / np.maximum((rest[w.record.valid] ** 2).mean(0) / gram.noise.total**2, 1e-12)
        main = strong > 0.25 * strong.max()
        if share[main].min() < FORM_TOLERANCE**2:
            return "within the error of form of what is already adopted"
    if _once(w, candidate, columns_of(chosen)):
        return _NotMeant("seems to have happened only once, and not strongly: fly it again")
    after = gram.held_out(selected)
    gain = float(before.sum() - after.sum())
    energy = w.energy_on_axes_of(contribution, w.rest(gram, columns_of(chosen)))
    if gain < SMALLEST_GAIN * energy:
        return f"takes {max(gain, 0.0) / energy:.1%} off its axes on held-out time: too little"
    problem = w.kinematics(candidate, coefficients)
    if problem is not None:
        return _NotMeant(problem)
    free = w.free(chosen)
    limit = FREE_CURVE_FACTOR * gain + 0.02 * float(before.sum())
    if free.significant and free.gain > limit:
        return f"a free curve in {free.channels[0].name} explains far more"
    return None


def _once(w: Workspace, candidate: Candidate, selected: Columns) -> bool:
    """Whether weak evidence comes from a few blocks of time (their participation number)."""
    schur, _, parts = w.gram.project(selected)
    own = parts[:, candidate.columns]
    evidence = own @ inverse(schur, w.gram.total_w, candidate.columns) @ own.sum(0)
    total = float(evidence.sum())
    return total < FEW_SCORE and total**2 < FEW_BLOCKS * float((evidence**2).sum())
