"""A set of effects on held-out time: every run of time by the coefficients of the others.

K-fold cross-validation over blocks of time, with an embargo on both sides of a fold (Bergmeir & Benitez 2012,
Information Sciences 191, 192).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.common.frames import AXES, Array
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.channel import hundredths
from replay.search.curves import CarryingChannel
from replay.search.evidence import Evidence, Fit
from replay.search.library import Library
from replay.search.regimes import by_regime
from replay.search.remainder import Outside, outside
from replay.search.terms import Key, Term
from replay.search.thresholds import (
    CARRIES,
    CONFIRM_SHARE,
)

BLOCK_S = 1.5
MOST_BLOCKS = 400
"""Unit of the time that is held out [s], and how many at most."""
FOLDS = 8
FOLD_S = 6.0
"""Long single folds would hide a manoeuvre flown once from its own fit; runs of this length [s] do not."""
EMBARGO_S = 3.0
"""Time beside a run that is fitted on neither [s]: three correlation times of the remainder."""
CONFIRM_BLOCK_S = 5.0
"""Blocks of the bootstrap [s]: longer than the remainder is correlated."""
DRAWS = 1000
"""Of the bootstrap."""


@dataclass(frozen=True)
class Acting:
    """One effect on one flight."""

    held_out: Array
    """Its wrench (n, 6) on the axes that it acts on, every sample by coefficients of the other folds."""
    axes: tuple[str, ...]
    """Those that it acts on clearly."""
    folds: Array
    """Coefficients of every fold (FOLDS, k)."""
    parameters: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class FlightFit:
    """One flight under a set. Residuals are (n, 6)."""

    record: Record
    index: int
    before: Array
    """With no effect."""
    effects: dict[Key, Acting]
    rest: Array
    """With every effect and its model-form error, and the trims, fitted on all time."""
    beside: Array
    """Free curves and trims."""
    carriers: tuple[CarryingChannel, ...] = ()
    """Channels that carry what is left: the free curves of the set, the largest first."""
    confirms: frozenset[Key] = frozenset()
    """Effects that lower the residual here where they were fitted on the other flights."""

    @cached_property
    def after(self) -> Array:
        """With every effect, on held-out time."""
        out = self.before
        for acting in self.effects.values():
            out = out - acting.held_out
        return out

    @cached_property
    def outside(self) -> tuple[Outside, ...]:
        """What acts and is in no logged channel; no model-form error is taken out."""
        return outside(self.record, self.after - self.beside)

    @cached_property
    def regimes(self) -> list[dict[str, Any]]:
        """Error of the parts of the flight, as the JSON has them."""
        return by_regime(self.record, self.before, self.after)

    def gain(self, key: Key, axes: Sequence[int] | None = None) -> float:
        """Energy that one effect removes beside the others; of all judged axes, or of some."""
        if key not in self.effects:
            return 0.0
        without = self.after + self.effects[key].held_out
        return self.energy(without, axes) - self.energy(self.after, axes)

    def without_axis(self, key: Key, axis: int) -> FlightFit:
        """The same with an effect that does not act on one axis."""
        acting = self.effects[key]
        held_out = np.where(np.arange(6) == axis, 0.0, acting.held_out)
        axes = tuple(a for a in acting.axes if a != AXES[axis])
        less = replace(acting, held_out=held_out, axes=axes)
        return replace(self, effects=self.effects | {key: less})

    def energy(self, residual: Array, axes: Sequence[int] | None = None) -> float:
        """Of all judged axes, or of some, in hundredths of the weight."""
        if axes is None:
            axes = self.record.axes
        left = residual[self.record.valid] / hundredths(self.record.context)
        return float((left[:, list(axes)] ** 2).sum())


def flight_fits(evidence: Evidence, best: Fit) -> list[FlightFit]:
    """Every flight under a set."""
    fits = [_one(evidence, best, f, record) for f, record in enumerate(evidence.library.records)]
    if len(fits) == 1:
        return fits
    return [replace(fit, confirms=_confirmed(evidence, best, fit, fits)) for fit in fits]


def folds_of(library: Library, flight: int) -> list[Mask]:
    """Of every fold, the samples (n,) of a flight's channels that it is not fitted on."""
    _, fitted = _split(library.records[flight])
    return [~rows[:: library.every[flight]] for rows in fitted]


def _one(evidence: Evidence, best: Fit, f: int, record: Record) -> FlightFit:
    library = evidence.library
    seen = np.isin(np.arange(6), (*record.axes, *record.blind))
    before = np.where(seen, np.nan_to_num(record.residual), 0.0)
    fold_of, _ = _split(record)
    folds = [
        evidence.refit(best.terms, best.noise, {f: left_out}) for left_out in folds_of(library, f)
    ]
    effects: dict[Key, Acting] = {}
    rest = before
    for t in best.of_effects:
        if f in t.places:
            effects[t.key], wrench = _acting(library, best, t, f, folds, fold_of)
            rest = rest - wrench
    fit = FlightFit(
        record=record,
        index=f,
        before=before,
        effects=effects,
        rest=rest,
        beside=np.zeros_like(rest),
    )
    carriers, curves = _curves(library, best, fit)
    trim = library.trim_wrench(f, best.b[len(best.b) - len(library.trim) :])
    return replace(fit, rest=rest - trim, beside=curves + trim, carriers=carriers)


def _acting(
    library: Library, best: Fit, t: Term, f: int, folds: Sequence[Fit], fold_of: NDArray[np.int64]
) -> tuple[Acting, Array]:
    """One effect on a flight, and its wrench (n, 6) with its model-form error by coefficients of all time."""
    record = library.records[f]
    judged = np.isin(np.arange(6), record.axes)
    x, form = library.wrenches(t, f)
    sizes = best.sizes(t, f)
    own = x @ sizes
    of_fold = np.stack([fold.sizes(t, f) for fold in folds])
    per_fold = np.einsum("nak,fk->fna", x, of_fold)
    held = np.take_along_axis(per_fold, fold_of[None, :, None], axis=0)[0]
    bent = form @ best.b[best.part(t)][len(t.columns) - form.shape[2] :]
    strength = np.sqrt((own[record.valid] ** 2).mean(axis=0)) / hundredths(record.context)
    clear = CARRIES * strength[list(record.axes)].max()
    axes = tuple(AXES[a] for a in record.axes if strength[a] > clear > 0.0)
    acting = Acting(np.where(judged, held, 0.0), axes, of_fold, t.named.parameters(sizes, t.shape))
    return acting, np.where(judged, own + bent, 0.0)


def _curves(
    library: Library, best: Fit, fit: FlightFit
) -> tuple[tuple[CarryingChannel, ...], Array]:
    """Which channel carries how much of what is left, and the sum of their free curves (n, 6)."""
    carriers = []
    curves = np.zeros_like(fit.before)
    for t in (t for t in best.terms if t.effect is None and fit.index in t.places):
        a = AXES.index(t.axis or "")
        with_it = fit.energy(fit.after - curves, [a])
        curves[:, a] += library.curve(t, fit.index) @ best.b[best.part(t)]
        gain = with_it - fit.energy(fit.after - curves, [a])
        share = gain / max(fit.energy(fit.rest, [a]), 1e-30)
        carriers.append((gain, CarryingChannel(t.name, float(np.clip(share, 0.0, 1.0)), AXES[a])))
    carriers.sort(key=lambda c: -c[0])
    return tuple(c for _, c in carriers), curves


def _split(record: Record) -> tuple[NDArray[np.int64], Mask]:
    """Fold (n,) of every sample, and the samples (FOLDS, n) that every fold is fitted on.

    Blocks are equal shares of the valid time. Runs of them are dealt to the folds in turn.
    """
    known = np.cumsum(record.valid)
    count = int(np.clip(record.seconds / BLOCK_S, FOLDS, MOST_BLOCKS))
    block = np.minimum((known - 1).clip(0) * count // max(int(known[-1]), 1), count - 1)
    length = record.seconds / count
    run = min(max(round(FOLD_S / length), 1), max(count // FOLDS, 1))
    fold = np.arange(count) // run % FOLDS
    kernel = np.ones(2 * max(int(np.ceil(EMBARGO_S / length)), 1) + 1)
    near = np.stack([np.convolve(fold == k, kernel, "same") > 0.5 for k in range(FOLDS)])
    return fold[block], ~near[:, block]


def _confirmed(
    evidence: Evidence, best: Fit, fit: FlightFit, fits: list[FlightFit]
) -> frozenset[Key]:
    """Effects that lower the residual of a flight where they were fitted on the others."""
    all_of_it = np.ones_like(fit.record.valid[:: evidence.library.every[fit.index]])
    others = evidence.refit(best.terms, best.noise, {fit.index: all_of_it})
    out = set()
    for t in best.of_effects:
        if fit.index not in t.places:
            continue
        if len(t.places) < 2:
            good = any(o.name == t.name and o.flight != t.flight for o in best.of_effects)
        elif t.named.kept:
            without = fit.rest + _wrench(evidence, best, t, fit)
            good = _removes(fit, without, _wrench(evidence, others, t, fit))
        else:
            good = _of_day_removes(evidence, best, t, fit) and any(
                _of_day_removes(evidence, best, t, fits[f]) for f in t.places if f != fit.index
            )
        if good:
            out.add(t.key)
    return frozenset(out)


def _wrench(
    evidence: Evidence, fit: Fit, t: Term, flight: FlightFit, share: Array | float = 1.0
) -> Array:
    """An effect (n, 6) on a flight by the coefficients of a fit, each times ``share`` (k,)."""
    x, _ = evidence.library.wrenches(t, flight.index)
    return np.asarray(x @ (fit.sizes(t, flight.index) * share))


def _of_day_removes(evidence: Evidence, best: Fit, t: Term, fit: FlightFit) -> bool:
    """Whether the part of an effect that is of one flight lowers its residual: no other flight can show it."""
    of_day = np.array([float(t.named.of_day(c)) for c in t.named.coefficients])
    own = _wrench(evidence, best, t, fit, of_day)
    return _removes(fit, fit.rest + own, own)


def _removes(fit: FlightFit, residual: Array, wrench: Array) -> bool:
    """Whether ``wrench`` w (n, 6), not fitted here, lowers the energy of the ``residual`` r beside it.

    The gain sum |r|^2 - |r - w|^2 is above CONFIRM_SHARE sum |r|^2, and above 0 in 97.5 % of DRAWS bootstrap samples of
    its blocks (Künsch 1989, Annals of Statistics 17, 1217).
    """
    judged = np.ix_(np.flatnonzero(fit.record.valid), np.array(fit.record.axes))
    unit = hundredths(fit.record.context)
    left = (residual / unit)[judged]
    removed = (wrench / unit)[judged]
    gain = (left**2 - (left - removed) ** 2).sum(axis=1)
    count = max(int(fit.record.seconds / CONFIRM_BLOCK_S), 2)
    blocks = np.array([part.sum() for part in np.array_split(gain, count)])
    draws = np.random.default_rng(0).choice(blocks, (DRAWS, count)).sum(axis=1)
    return bool(np.percentile(draws, 2.5) > 0.0 and gain.sum() > CONFIRM_SHARE * (left**2).sum())
