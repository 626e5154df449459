"""A set of effects on time that its fit never saw: every run of time by coefficients of the others."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from models.frames import AXES, Array
from replay.residual.record import Record
from replay.search.evidence import Evidence, Fit
from replay.search.free_curves import Channel
from replay.search.library import Library
from replay.search.noise import FOLDS, block_numbers, embargo_blocks, fold_of_block, training_blocks
from replay.search.terms import Key, Term
from replay.search.walk import Walked

CARRIES = 0.25
"""An effect carries an axis where it is this strong beside its strongest axis, in hundredths of the weight."""
BLOCK_S = 1.5
"""Unit of the time that is held out [s]."""
EMBARGO_S = 1.0
"""Correlation time of the remainder that the embargo beside it is set by [s]."""
LOUD = 0.6
"""RMS of a free curve, in hundredths of the weight, from which on it is reported.

So much is left near the ground where nothing is missing: by the declared model's own error, and by 2 cm of range.
"""
CONFIRM_SHARE = 0.01
"""Smallest share of the energy that an effect has to take off a flight that confirms it."""
CONFIRM_BLOCK_S = 5.0
"""Blocks of the bootstrap [s]: longer than the remainder is correlated."""
DRAWS = 1000
"""Of the bootstrap."""


@dataclass
class FlightFit:
    """One flight under the best set. Residuals are (n, 6)."""

    record: Record
    index: int
    before: Array
    after: Array
    """With every effect, on time that its fit never saw."""
    rest: Array
    """With every effect and its error of form, fitted on all time."""
    unexplained: Array
    """``after`` less the free curves and the trims: no error of form is forgiven."""
    unit: Array
    """One hundredth of the weight (times the lever), (6,)."""
    without: dict[Key, Array] = field(default_factory=dict)
    carried: dict[Key, tuple[str, ...]] = field(default_factory=dict)
    folds: dict[Key, Array] = field(default_factory=dict)
    """Coefficients of every fold (FOLDS, k)."""
    parameters: dict[Key, dict[str, float]] = field(default_factory=dict)
    borne_out: dict[Key, bool] = field(default_factory=dict)
    curves: tuple[Channel, ...] = ()
    curve_gain: float = 0.0

    def loud(self, axis: str, share: float) -> bool:
        """Whether that share of what is left on an axis is worth a pilot's attention."""
        a = AXES.index(axis)
        left = share * float((self.rest[self.record.valid, a] ** 2).mean())
        return left > (LOUD * float(self.unit[a])) ** 2

    def left(self, channel: Channel) -> float:
        """Energy that a channel carries of what is left on its axis, in hundredths of the weight."""
        return channel.score * self._energy_of(self.rest, channel.axis)

    def removed(self, axis: str) -> float:
        """Energy that the effects took off an axis, in hundredths of the weight."""
        return max(self._energy_of(self.before, axis) - self._energy_of(self.rest, axis), 0.0)

    def _energy_of(self, residual: Array, axis: str) -> float:
        a = AXES.index(axis)
        return float(((residual[self.record.valid, a] / self.unit[a]) ** 2).sum())

    def energy(self, residual: Array) -> float:
        """Of the judged axes, in hundredths of the weight."""
        axes = list(self.record.axes)
        return float(((residual[self.record.valid][:, axes] / self.unit[axes]) ** 2).sum())


def flight_fits(walked: Walked, best: Fit) -> list[FlightFit]:
    """Every flight under the best set."""
    evidence = walked.evidence
    out = []
    for f, record in enumerate(evidence.library.records):
        out.append(_one(evidence, best, f, record))
    if len(out) > 1:
        _confirm(evidence, best, out)
    return out


def _one(evidence: Evidence, best: Fit, f: int, record: Record) -> FlightFit:
    library = evidence.library
    unit = 0.01 * record.context.weight * np.where(np.arange(6) < 3, 1.0, record.context.lever)
    judged = np.isin(np.arange(6), record.axes)
    seen = judged | np.isin(np.arange(6), record.blind)
    before = np.where(seen, np.nan_to_num(record.residual), 0.0)
    fit = FlightFit(record, f, before, before.copy(), before.copy(), before.copy(), unit)
    folds = _folds(evidence, best, f, record)
    for t in best.terms:
        if t.effect is not None and f in t.places:
            _take_off(fit, evidence, best, t, folds)
    for key, held in fit.without.items():
        fit.without[key] = fit.after + np.where(judged, held, 0.0)
    fit.unexplained = fit.after.copy()
    _take_off_curves(fit, library, best)
    trim = library.trim_wrench(f, best.b[len(best.b) - len(library.trim) :])
    fit.unexplained -= trim
    fit.rest -= trim
    return fit


def _take_off(
    fit: FlightFit, evidence: Evidence, best: Fit, t: Term, folds: tuple[list[Array], NDArray[np.int64]]
) -> None:
    """One effect off the residuals of a flight: by all time, and on every fold by the others."""
    assert t.effect is not None
    record, f = fit.record, fit.index
    judged = np.isin(np.arange(6), record.axes)
    x, form = evidence.library.wrenches(t, f)
    place, part = np.searchsorted(t.columns, t.places[f]), best.part(t)
    scale = t.scale[place]
    own = x @ (best.b[part][place] * scale)
    # On axes by which it is not looked for it counts where it helps.
    for a in (a for a in range(6) if t.effect.searched and AXES[a] not in t.effect.searched):
        y = fit.before[record.valid, a]
        if ((y - own[record.valid, a]) ** 2).sum() > (y**2).sum():
            x[:, a] = 0.0
            own[:, a] = 0.0
    coefficients, fold_of = folds
    fit.folds[t.key] = np.stack([b[part][place] * scale for b in coefficients])
    per_fold = np.einsum("nak,fk->fna", x, fit.folds[t.key])
    held = np.take_along_axis(per_fold, fold_of[None, :, None], axis=0)[0]
    fit.after -= np.where(judged, held, 0.0)
    fit.without[t.key] = held
    bent = form @ best.b[part][len(t.columns) - form.shape[2] :] if form.shape[2] else 0.0
    fit.rest -= np.where(judged, own + bent, 0.0)
    strength = np.sqrt((own[record.valid] ** 2).mean(axis=0)) / fit.unit
    strongest = strength[list(record.axes)].max()
    fit.carried[t.key] = tuple(AXES[a] for a in record.axes if strength[a] > CARRIES * strongest > 0.0)
    fit.parameters[t.key] = t.effect.parameters(best.b[part][place] * scale, t.shape)


def _take_off_curves(fit: FlightFit, library: Library, best: Fit) -> None:
    """The free curves off what is unexplained, and which of them carries how much of it."""
    valid, curves = fit.record.valid, []
    for t in (t for t in best.terms if t.effect is None and fit.index in t.places):
        a = AXES.index(t.axis or "")
        with_it = float((fit.unexplained[valid, a] ** 2).sum())
        fit.unexplained[:, a] -= library.curve(t, fit.index) @ best.b[best.part(t)]
        gain = with_it - float((fit.unexplained[valid, a] ** 2).sum())
        share = gain / max(float(((fit.rest[valid, a]) ** 2).sum()), 1e-30)
        curves.append((gain / fit.unit[a] ** 2, Channel(t.name, float(np.clip(share, 0.0, 1.0)), AXES[a])))
    curves.sort(key=lambda c: -c[0])
    fit.curves = tuple(c for _, c in curves)
    fit.curve_gain = max((g for g, _ in curves), default=0.0)


def _folds(evidence: Evidence, best: Fit, f: int, record: Record) -> tuple[list[Array], NDArray[np.int64]]:
    """Coefficients without every fold of one flight, and the fold of every sample (n,)."""
    block = block_numbers(record.valid, record.step_s, BLOCK_S)
    count = int(block.max()) + 1
    length = record.seconds / count
    folds = fold_of_block(count, length)
    embargo = embargo_blocks(EMBARGO_S, length)
    every = evidence.library.every[f]
    small = block[::every]
    out = [
        evidence.refit(best.terms, best.noise, {f: ~training_blocks(folds, k, embargo)[small]}).b for k in range(FOLDS)
    ]
    return out, folds[block]


def _confirm(evidence: Evidence, best: Fit, fits: list[FlightFit]) -> None:
    """Which flights bear an effect out that was fitted on the others only."""
    for f, fit in enumerate(fits):
        record = fit.record
        left_out = {f: np.ones(len(record.valid[:: evidence.library.every[f]]), bool)}
        others = evidence.refit(best.terms, best.noise, left_out)
        for t in best.terms:
            if t.effect is None or f not in t.places:
                continue
            if len(t.places) < 2:
                fit.borne_out[t.key] = any(
                    o.key[0] == t.key[0] and o.key[1] != t.key[1] for o in best.terms if o.effect is not None
                )
                continue
            if not t.effect.kept:
                fit.borne_out[t.key] = all(
                    any(_of_the_day_removes(evidence, best, t, o) for o in part) for part in ([fit], _beside(fits, fit))
                )
                continue
            place = np.searchsorted(t.columns, t.places[f])
            x, _ = evidence.library.wrenches(t, f)
            own = x @ (others.b[others.part(t)][place] * t.scale[place])
            mine = x @ (best.b[best.part(t)][place] * t.scale[place])
            fit.borne_out[t.key] = _removes(fit, fit.rest + mine, own)


def _beside(fits: list[FlightFit], fit: FlightFit) -> list[FlightFit]:
    return [other for other in fits if other is not fit]


def _of_the_day_removes(evidence: Evidence, best: Fit, t: Term, fit: FlightFit) -> bool:
    """Whether what is of the day of an effect lowers the residual of a flight: no other flight can say so."""
    assert t.effect is not None
    if fit.index not in t.places:
        return False
    place = np.searchsorted(t.columns, t.places[fit.index])
    x, _ = evidence.library.wrenches(t, fit.index)
    of_day = np.array([t.effect.of_day(c) for c in t.effect.coefficients])
    own = x @ (best.b[best.part(t)][place] * t.scale[place] * of_day)
    return _removes(fit, fit.rest + own, own)


def _removes(fit: FlightFit, residual: Array, wrench: Array) -> bool:
    """Whether ``wrench`` (n, 6), not fitted here, lowers the residual's energy: 95 % bootstrap interval over blocks."""
    axes, valid = list(fit.record.axes), fit.record.valid
    left = residual[valid][:, axes] / fit.unit[axes]
    gain = (left**2 - (left - wrench[valid][:, axes] / fit.unit[axes]) ** 2).sum(axis=1)
    count = max(int(fit.record.seconds / CONFIRM_BLOCK_S), 2)
    blocks = np.array([part.sum() for part in np.array_split(gain, count)])
    draws = np.random.default_rng(0).choice(blocks, (DRAWS, count)).sum(axis=1)
    return bool(np.percentile(draws, 2.5) > 0.0 and gain.sum() > CONFIRM_SHARE * (left**2).sum())
