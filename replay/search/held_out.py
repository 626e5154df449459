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
from replay.search.regimes import by_regime, long_regimes
from replay.search.remainder import Outside, outside
from replay.search.terms import Key, Term
from replay.search.thresholds import CARRIES, CONFIRM_SHARE, SMALL, USUAL

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


@dataclass(frozen=True, kw_only=True)
class Acting:
    """One effect on one flight."""

    held_out: Array
    """Its wrench (n, 6) on the axes that it acts on, every sample by coefficients of the other folds."""
    axes: tuple[str, ...]
    """Those that it acts on clearly."""
    main_axes: tuple[str, ...]
    """The same of the coefficients that make the effect."""
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
    """Free curves, and trims as large as usual."""
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

    def is_small(self, key: Key) -> bool:
        """Whether an effect is not worth a name: it is so small in every part of the flight.

        It is less than a hundredth of the weight (RMS), and removes less than ``SMALL`` of the energy of each axis.
        """
        of_effect = self.effects[key].held_out
        without = self.after + of_effect
        for part in (self.record.valid, *long_regimes(self.record).values()):
            within = part[:, None]
            if self.energy(of_effect * within) >= part.sum():
                return False
            for axis in self.record.axes:
                removed = self.energy(without * within, [axis])
                removed -= self.energy(self.after * within, [axis])
                if removed > SMALL * self.energy(self.before * within, [axis]):
                    return False
        return True

    def without_axis(self, key: Key, axis: int) -> FlightFit:
        """The same with an effect that does not act on one axis."""
        acting = self.effects[key]
        less = replace(
            acting,
            held_out=np.where(np.arange(6) == axis, 0.0, acting.held_out),
            axes=tuple(a for a in acting.axes if a != AXES[axis]),
        )
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
    folds = []
    for left_out in folds_of(library, f):
        folds.append(evidence.refit(best.terms, best.noise, {f: left_out}))
    effects: dict[Key, Acting] = {}
    rest = before
    for term in best.of_effects:
        if f not in term.places:
            continue
        x, form = library.wrenches(term, f)
        effects[term.key] = _acting(
            record=record,
            term=term,
            x=x,
            sizes=best.sizes(term, f),
            of_folds=np.stack([fold.sizes(term, f) for fold in folds]),
        )
        first_form = len(term.columns) - form.shape[2]
        of_form = best.b[best.part(term)][first_form:]
        wrench = x @ best.sizes(term, f) + form @ of_form
        rest = rest - _where_judged(record, wrench)
    fit = FlightFit(
        record=record,
        index=f,
        before=before,
        effects=effects,
        rest=rest,
        beside=np.zeros_like(rest),
    )
    carriers, curves = _curves(library, best, fit)
    trims = best.b[len(best.b) - len(library.trim) :]
    trim = library.trim_wrench(f, trims)
    # What is larger than a vehicle's usual trim acts, and has no name.
    usual_trim = library.trim_wrench(f, np.clip(trims, -USUAL, USUAL))
    return replace(fit, rest=rest - trim, beside=curves + usual_trim, carriers=carriers)


def _acting(record: Record, term: Term, x: Array, *, sizes: Array, of_folds: Array) -> Acting:
    """One effect with columns ``x`` (n, 6, k) on a flight, by its sizes (k,) and those of the folds (FOLDS, k)."""
    fold_of_sample, _ = _split(record)
    wrench_by_fold = np.einsum("nak,fk->fna", x, of_folds)
    held_out = np.take_along_axis(wrench_by_fold, fold_of_sample[None, :, None], axis=0)[0]
    effect = term.named
    makes_it = [c.name in effect.main_names for c in effect.coefficients]
    return Acting(
        held_out=_where_judged(record, held_out),
        axes=_clear_axes(record, x @ sizes),
        main_axes=_clear_axes(record, x @ np.where(makes_it, sizes, 0.0)),
        folds=of_folds,
        parameters=effect.parameters(sizes, term.shape),
    )


def _clear_axes(record: Record, wrench: Array) -> tuple[str, ...]:
    """Axes on which a wrench (n, 6) acts clearly: by its RMS, beside that of its strongest axis."""
    mean_square = (wrench[record.valid] ** 2).mean(axis=0)
    rms = np.sqrt(mean_square) / hundredths(record.context)
    clear = CARRIES * rms[list(record.axes)].max()
    return tuple(AXES[axis] for axis in record.axes if rms[axis] > clear > 0.0)


def _where_judged(record: Record, wrench: Array) -> Array:
    """A wrench (n, 6) on the judged axes, 0 on the others."""
    judged = np.isin(np.arange(6), record.axes)
    return np.where(judged, wrench, 0.0)


def _curves(
    library: Library, best: Fit, fit: FlightFit
) -> tuple[tuple[CarryingChannel, ...], Array]:
    """Which channel carries how much of what is left, and the sum of their free curves (n, 6)."""
    carriers = []
    curves = np.zeros_like(fit.before)
    for term in best.terms:
        if term.effect is not None or fit.index not in term.places:
            continue
        axis = AXES.index(term.axis or "")
        without = fit.energy(fit.after - curves, [axis])
        curves[:, axis] += library.curve(term, fit.index) @ best.b[best.part(term)]
        gain = without - fit.energy(fit.after - curves, [axis])
        share = gain / max(fit.energy(fit.rest, [axis]), 1e-30)
        score = float(np.clip(share, 0.0, 1.0))
        carriers.append((gain, CarryingChannel(term.name, score, AXES[axis], library.course(term))))
    carriers.sort(key=lambda pair: -pair[0])
    return tuple(carrier for _, carrier in carriers), curves


def _split(record: Record) -> tuple[NDArray[np.int64], Mask]:
    """Fold (n,) of every sample, and the samples (FOLDS, n) that every fold is fitted on.

    Blocks are equal shares of the valid time. Runs of them are dealt to the folds in turn.
    """
    blocks = int(np.clip(record.seconds / BLOCK_S, FOLDS, MOST_BLOCKS))
    valid_so_far = np.cumsum(record.valid)
    all_valid = max(int(valid_so_far[-1]), 1)
    number = (valid_so_far - 1).clip(0)
    block_of_sample = np.minimum(number * blocks // all_valid, blocks - 1)
    block_s = record.seconds / blocks
    most_in_run = max(blocks // FOLDS, 1)
    run = min(max(round(FOLD_S / block_s), 1), most_in_run)
    fold_of_block = np.arange(blocks) // run % FOLDS
    embargo = max(int(np.ceil(EMBARGO_S / block_s)), 1)
    kernel = np.ones(2 * embargo + 1)
    near = np.empty((FOLDS, blocks), bool)
    for fold in range(FOLDS):
        blocks_within = np.convolve(fold_of_block == fold, kernel)
        near[fold] = blocks_within[embargo : embargo + blocks] > 0.5
    return fold_of_block[block_of_sample], ~near[:, block_of_sample]


def _confirmed(
    evidence: Evidence, best: Fit, fit: FlightFit, fits: list[FlightFit]
) -> frozenset[Key]:
    """Effects that lower the residual of a flight where they were fitted on the others."""
    library = evidence.library
    whole_flight = np.ones_like(fit.record.valid[:: library.every[fit.index]])
    of_others = evidence.refit(best.terms, best.noise, {fit.index: whole_flight})
    out = set()
    for term in best.of_effects:
        if fit.index not in term.places:
            continue
        if len(term.places) < 2:
            confirmed = _on_another_flight(best, term)
        elif term.named.kept:
            without = fit.rest + _wrench(library, best, term, fit)
            foretold = _wrench(library, of_others, term, fit)
            confirmed = _removes(fit, without, foretold)
        else:
            removing = [f for f in term.places if _of_day_removes(library, best, term, fits[f])]
            confirmed = fit.index in removing and len(removing) > 1
        if confirmed:
            out.add(term.key)
    return frozenset(out)


def _on_another_flight(best: Fit, term: Term) -> bool:
    """Whether the effect of a term of one flight was found on another, too."""
    same = [other for other in best.of_effects if other.name == term.name]
    return any(other.flight != term.flight for other in same)


def _wrench(
    library: Library, fit: Fit, term: Term, flight: FlightFit, share: Array | float = 1.0
) -> Array:
    """An effect (n, 6) on a flight by the coefficients of a fit, each times ``share`` (k,)."""
    x, _ = library.wrenches(term, flight.index)
    sizes = fit.sizes(term, flight.index)
    return np.asarray(x @ (sizes * share))


def _of_day_removes(library: Library, best: Fit, term: Term, fit: FlightFit) -> bool:
    """Whether the part of an effect that is of one flight lowers its residual: no other flight can show it."""
    effect = term.named
    of_day = np.array([float(effect.of_day(c)) for c in effect.coefficients])
    wrench = _wrench(library, best, term, fit, of_day)
    return _removes(fit, fit.rest + wrench, wrench)


def _removes(fit: FlightFit, residual: Array, wrench: Array) -> bool:
    """Whether ``wrench`` w (n, 6), not fitted here, lowers the energy of the ``residual`` r beside it.

    The gain sum |r|^2 - |r - w|^2 is above CONFIRM_SHARE sum |r|^2, and above 0 in 97.5 % of DRAWS bootstrap samples of
    its blocks (Künsch 1989, Annals of Statistics 17, 1217).
    """
    record = fit.record
    judged = np.ix_(np.flatnonzero(record.valid), np.array(record.axes))
    unit = hundredths(record.context)
    r = (residual / unit)[judged]
    w = (wrench / unit)[judged]
    gain = (r**2 - (r - w) ** 2).sum(axis=1)
    count = max(int(record.seconds / CONFIRM_BLOCK_S), 2)
    blocks = np.array([block.sum() for block in np.array_split(gain, count)])
    samples = np.random.default_rng(0).choice(blocks, (DRAWS, count))
    surely_lower = np.percentile(samples.sum(axis=1), 2.5) > 0.0
    enough = gain.sum() > CONFIRM_SHARE * (r**2).sum()
    return bool(surely_lower and enough)
