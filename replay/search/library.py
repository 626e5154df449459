"""The library: every effect in every shape and free curves of single channels, as columns of every flight's axes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, product, zip_longest
from typing import NamedTuple

import numpy as np

from models.common.frames import AXES, Array
from models.effects import Effect
from replay.residual.record import Record
from replay.search.beginnings import NONE_S, log_chance, times_of
from replay.search.channel import Columns, ResidualChannel, hundredths
from replay.search.curves import ATTITUDE, Curve, curves
from replay.search.noise_spectra import valid_before
from replay.search.terms import (
    STEP_S,
    Key,
    Shape,
    Term,
    bent_forms,
    log_shapes,
    prior_of,
    regressors_of,
    unmixed_regressors,
)
from replay.search.thresholds import AMPLITUDE, FORM_PRIOR, KINEMATIC_SD_M_S2, KNOWN
from replay.search.time_courses import TimeCourse
from replay.search.trims import trims_of


class Prior(NamedTuple):
    """Of one column: its standard deviation, and in units of that its mean and bounds."""

    column: int
    scale: float
    centre: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    main: float = 0.0
    """1 for a coefficient that makes the effect what it is, else 0."""


@dataclass(frozen=True)
class Alike:
    """Terms of one width k: their numbers (t,), columns (t, k) and prior means (t, k)."""

    numbers: list[int]
    columns: Columns
    centre: Array


class Library:
    """All terms of some flights, and the channels that they act on.

    ``more_trims``: of every flight, wrenches (n, 6) that it may have besides, each times N(0, 1), and that are not
    named.
    """

    def __init__(
        self,
        records: Sequence[Record],
        effects: Sequence[Effect],
        more_trims: Sequence[Sequence[Array]] = (),
    ) -> None:
        self.records = list(records)
        self.every = [max(round(STEP_S / r.step_s), 1) for r in records]
        """Of every flight the samples of its record between two of its channels."""
        self.terms: list[Term] = []
        self.numbers_of: dict[Key, list[int]] = {}
        """Numbers of the terms with a key: one effect in all its shapes."""
        self.taken_in = 0
        """Terms that were ever taken in."""
        self.size = 0
        """Columns."""
        self.lacking: dict[str, str] = {}
        """Effects that no flight can show, and why."""
        self.remainders: list[Effect] = []
        """Effects that are weighed after all others."""
        self.channels: list[ResidualChannel] = []
        for flight, record in enumerate(records):
            self.channels += [self._channel(flight, axis) for axis in record.axes]
        self.flights = [list(axes) for _, axes in groupby(self.channels, key=lambda c: c.flight)]
        """The channels of every flight that has some: they share its time, and are worked on together."""
        self.bias = np.empty(0)
        self.x_bias = np.empty((0, 0))
        """Offsets of all accelerometers by velocity and attitude (m,), and columns (m, K), over their error."""
        self._at = {(c.flight, c.axis): c for c in self.channels}
        self._alike: dict[Key | None, tuple[Term, list[Alike]]] = {}
        self._unmixed: dict[tuple[str, int], Columns] = {}
        """Of an effect whose shape only mixes its regressors, and a flight: the columns that are mixed."""
        self._curves: dict[tuple[int, int], Array] = {}
        self._courses: dict[int, TimeCourse | None] = {}
        self._trims: list[tuple[int, Array]] = []
        self._bias_mean = [_mean(r.kinematic_bias[r.valid]) for r in records]
        self._bias_columns: dict[int, list[tuple[Columns, Array]]] = {}
        for effect in effects:
            self._add_effect(effect)
        self._add_curves()
        self.trim = self._add_trims(more_trims or [()] * len(self.records))
        self._reach()

    def term_of(self, effect: Effect, shape: Shape) -> Term:
        """One more term: an effect of the vehicle in this shape, which is as likely as any other."""
        self._add(effect, None, self._usable(effect), shape=shape, log_shape=0.0)
        self._reach()
        return self.terms[-1]

    def alike(self, key: Key | None) -> list[Alike]:
        """All terms by their width, or those with a key."""
        numbers: Sequence[int]
        if key is None:
            numbers = range(len(self.terms))
        else:
            numbers = self.numbers_of[key]
        if not numbers:
            return []
        last = self.terms[numbers[-1]]
        known = self._alike.get(key)
        if known is not None and known[0] is last:
            return known[1]
        by_width: dict[int, list[int]] = {}
        for number in numbers:
            width = len(self.terms[number].columns)
            by_width.setdefault(width, []).append(number)
        groups = [self._together(same) for same in by_width.values()]
        self._alike[key] = last, groups
        return groups

    def _together(self, numbers: list[int]) -> Alike:
        terms = [self.terms[number] for number in numbers]
        columns = np.stack([t.columns for t in terms])
        centre = np.stack([t.centre for t in terms])
        return Alike(numbers, columns, centre)

    def again(self, term: Term, instance: int, without: Collection[float]) -> list[Term]:
        """The terms of an effect once more, for a further one of it: all shapes but some first ones."""
        key = replace(term, instance=instance).key
        if key not in self.numbers_of:
            for other in self.with_key(term.key):
                if other.shape[0] not in without:
                    self._take_in(replace(other, instance=instance))
        return self.with_key(key)

    def with_key(self, key: Key) -> list[Term]:
        """Terms with a key: one effect in all its shapes."""
        return [self.terms[number] for number in self.numbers_of.get(key, [])]

    def forget(self, term: Term) -> None:
        """Take the last term out."""
        assert self.terms[-1] is term
        self.terms.pop()
        self.numbers_of[term.key].pop()
        for channel in self.channels:
            channel.forget(term.columns)

    def finer(self, term: Term, share: float) -> list[Term]:
        """Terms between a term's shape and its neighbours on the grid, ``share`` of the way; all terms taken in."""
        effect = term.effect
        if effect is None:
            return []
        out: list[Term] = []
        for i in range(len(term.shape)):
            for between in self._between(term, i, share):
                shape = (*term.shape[:i], between, *term.shape[i + 1 :])
                flights = list(term.places)
                self._add(effect, term.flight, flights, shape=shape, log_shape=term.log_shape)
                out.append(self.terms[-1])
        if out:
            self._reach()
        return out

    def _between(self, term: Term, i: int, share: float) -> list[float]:
        """Values of a shape parameter of an effect on the way to its neighbours on the grid."""
        parameter = term.named.shapes[i]
        value = term.shape[i]
        if not parameter.continuous or value in parameter.kinds:
            return []
        tried = {t.shape[i] for t in self.with_key(term.key)}
        grid = sorted(tried - set(parameter.kinds))
        at = grid.index(value)
        out = []
        for neighbour in grid[max(at - 1, 0) : at] + grid[at + 1 : at + 2]:
            between = float(value + share * (neighbour - value))
            # A length at which a curve is linearised may not pass through none.
            through_none = term.named.search.at_shape and value * neighbour < 0.0
            nearest = np.abs(np.subtract(grid, between)).min()
            if not through_none and nearest >= 1e-9:
                out.append(between)
        return out

    def _usable(self, effect: Effect) -> list[int]:
        """Flights that can show an effect."""
        return [f for f, record in enumerate(self.records) if self._reason(effect, record) is None]

    def _reason(self, effect: Effect, record: Record) -> str | None:
        """Why a flight cannot show an effect; None where it can."""
        if effect.search.needs_moments and 3 not in record.axes:
            return "this log cannot judge moments"
        forces = {AXES.index(a) for a in effect.axes} & {0, 1, 2}
        if forces and not forces & set(record.axes):
            return "this log cannot judge the force that it makes"
        return effect.lacking(record.context)

    def _add_effect(self, effect: Effect) -> None:
        usable = self._usable(effect)
        if not usable:
            self.lacking[effect.name] = self._reason(effect, self.records[0]) or ""
        elif effect.search.remainder:
            self.remainders.append(effect)
        elif effect.all_of_day:
            for flight in usable:
                self._add_shapes(effect, flight, [flight])
        else:
            self._add_shapes(effect, None, usable)

    def _add_shapes(self, effect: Effect, flight: int | None, flights: Sequence[int]) -> None:
        """Every shape of an effect, of one flight or of the vehicle."""
        first = flights[0]
        grid = effect.shape_grid(self.records[first].context)
        shapes = list(dict.fromkeys(grid))
        priors = dict(zip(shapes, log_shapes(effect, shapes), strict=True))
        if effect.search.may_begin and (effect.all_of_day or len(self.records) == 1):
            effect = effect.for_a_time
            priors = self._begun(effect, first, priors)
        for shape, log_shape in priors.items():
            self._add(effect, flight, flights, shape=shape, log_shape=log_shape)

    def _begun(
        self, effect: Effect, flight: int, priors: Mapping[Shape, float]
    ) -> dict[Shape, float]:
        """Shapes with their log priors, all the time and for times between which a flight's residual changes."""
        record = self.records[flight]
        always = (NONE_S, NONE_S)
        out = {}
        for shape, log_shape in priors.items():
            wrench = regressors_of(effect, record, (*shape, *always))[..., 0]
            for times in (always, *times_of(record, wrench)):
                out[*shape, *times] = log_shape + log_chance(record, times)
        return out

    def _add(
        self,
        effect: Effect,
        flight: int | None,
        flights: Sequence[int],
        *,
        shape: Shape,
        log_shape: float,
    ) -> None:
        """One shape of an effect: numbers for coefficients and model-form errors, and columns in every channel."""
        context = self.records[flights[0]].context
        spread, centre = prior_of(effect, context, shape)
        places, priors = self._numbered(effect, flights, spread, centre)
        errors_of_form = []
        for f in flights:
            errors_of_form.append(self._write(effect, f, shape, spread, places[f]))
        for errors in zip_longest(*errors_of_form):
            column = np.array([self.size])
            for f, error in zip(flights, errors, strict=True):
                if error is not None:
                    axes = self._searched_axes(effect, f)
                    self._put(f, axes, column, error[..., None])
            priors.append(Prior(column=self.size, scale=FORM_PRIOR))
            self.size += 1
        columns, scale, means, low, high, main = map(np.array, zip(*priors, strict=True))
        self._take_in(
            Term(
                name=effect.name,
                effect=effect,
                shape=shape,
                columns=columns,
                scale=scale,
                centre=means,
                low=low,
                high=high,
                main=main,
                log_shape=log_shape,
                log_odds=effect.search.log_odds(context),
                places=places,
                flight=flight,
            )
        )

    def _take_in(self, term: Term) -> None:
        self.taken_in += 1
        self.numbers_of.setdefault(term.key, []).append(len(self.terms))
        self.terms.append(term)

    def _numbered(
        self, effect: Effect, flights: Sequence[int], spread: Array, centre: Array
    ) -> tuple[dict[int, Columns], list[Prior]]:
        """Numbers of an effect's coefficients on every flight, the same on all but those of one flight, and priors."""
        priors: list[Prior] = []
        places: dict[int, Columns] = {f: np.empty(len(spread), np.int64) for f in flights}
        for i, coefficient in enumerate(effect.coefficients):
            of_one_flight = effect.of_day(coefficient) and not effect.all_of_day
            for f in flights:
                if f == flights[0] or of_one_flight:
                    context = self.records[f].context
                    prior = Prior(
                        column=self.size,
                        scale=spread[i],
                        centre=centre[i] / spread[i],
                        low=coefficient.least(context) / spread[i],
                        high=coefficient.most(context) / spread[i],
                        main=float(coefficient.name in effect.main_names),
                    )
                    priors.append(prior)
                    self.size += 1
                places[f][i] = self.size - 1
        return places, priors

    def _write(
        self, effect: Effect, f: int, shape: Shape, spread: Array, place: Columns
    ) -> list[Array]:
        """Columns of an effect in the channels of one flight; its model-form errors there, (n, 6) each."""
        record = self.records[f]
        every = self.every[f]
        if effect.mixing is not None:
            self._mix(effect, f, effect.mixing(shape) * spread, place)
            return []
        x = regressors_of(effect, record, shape) * spread
        axes = self._searched_axes(effect, f)
        self._put(f, axes, place, x[::every])
        if effect.kinematic_bias is not None:
            bias = effect.kinematic_bias(record.context, shape) * spread
            self._bias_columns.setdefault(f, []).append((place, bias))
        return [error[::every] for error in _errors_of_form(effect, record, x)]

    def _mix(self, effect: Effect, f: int, mixing: Array, place: Columns) -> None:
        """Columns of an effect whose shape only mixes its regressors: these are taken in once."""
        axes = self._searched_axes(effect, f)
        if (effect.name, f) not in self._unmixed:
            x = unmixed_regressors(effect, self.records[f], ())
            first = self.size
            self.size += x.shape[2]
            columns = np.arange(first, self.size)
            self._unmixed[effect.name, f] = columns
            self._put(f, axes, columns, x[:: self.every[f]])
        for axis in axes:
            self._at[f, axis].mix(place, self._unmixed[effect.name, f], mixing)

    def _put(self, f: int, axes: Iterable[int], columns: Columns, x: Array) -> None:
        """Columns (n, 6, k) in the channels of one flight where they are not zero."""
        for axis in axes:
            on_axis = x[:, axis]
            size = np.abs(on_axis).max(axis=0)
            acting = np.flatnonzero(size > 0.0)
            if acting.size:
                self._at[f, axis].add(columns[acting], on_axis[:, acting])

    def _searched_axes(self, effect: Effect, f: int) -> list[int]:
        searched = effect.search.searched or AXES
        return [axis for axis in self.records[f].axes if AXES[axis] in searched]

    def _channel(self, f: int, axis: int) -> ResidualChannel:
        record = self.records[f]
        every = self.every[f]
        residual = np.nan_to_num(record.residual[::every, axis])
        return ResidualChannel(
            flight=f,
            axis=axis,
            y=residual,
            run=valid_before(record.valid[::every]),
            limit=hundredths(record.context)[axis],
        )

    def _add_trims(self, more_trims: Sequence[Sequence[Array]]) -> Columns:
        """What every flight has without any effect, as columns of no term."""
        first = self.size
        for f, record in enumerate(self.records):
            for x in (*trims_of(record), *more_trims[f]):
                column = np.array([self.size])
                self._put(f, record.axes, column, x[:: self.every[f], :, None])
                self._trims.append((f, x))
                self.size += 1
        return np.arange(first, self.size)

    def trim_wrench(self, flight: int, b: Array) -> Array:
        """Trims (n, 6) of a flight at the record's rate, by the scaled coefficients of all trims."""
        out = np.zeros((len(self.records[flight].valid), 6))
        for (f, x), value in zip(self._trims, b, strict=True):
            if f == flight:
                out += value * x
        return out

    def curve(self, term: Term, flight: int) -> Array:
        """Columns (n, k) of a free curve at the record's rate."""
        return self._curves[int(term.columns[0]), flight]

    def course(self, term: Term) -> TimeCourse | None:
        """What a curve over time does, where it is no smooth one."""
        return self._courses[int(term.columns[0])]

    def wrenches(self, term: Term, flight: int) -> tuple[Array, Array]:
        """Wrenches (n, 6, k) per coefficient at the record's rate, and (n, 6, m) of its model-form errors."""
        effect = term.named
        record = self.records[flight]
        x = regressors_of(effect, record, term.shape)
        spread = term.scale[term.place(flight)]
        # None where a map stands for them; on a flight that varies less there may be fewer than the term has.
        forms = int(term.form.sum())
        errors = np.zeros((len(x), 6, forms))
        for i, error in enumerate(_errors_of_form(effect, record, x * spread)[:forms]):
            errors[:, :, i] = error
        return x, errors

    def _add_curves(self) -> None:
        """Free curves; they are less likely where an effect goes with the channel."""
        known: set[tuple[str, str]] = set()
        for term in self.terms:
            known.update(product(term.named.channels, term.named.axes))
        for curve in curves(self.records):
            explained = (curve.name, AXES[curve.axis]) in known
            if explained or curve.name in ATTITUDE:
                self._add_curve(curve, curve.odds * KNOWN)
            else:
                self._add_curve(curve, curve.odds)

    def _add_curve(self, curve: Curve, odds: float) -> None:
        width = max(part.shape[1] for part in curve.parts if part is not None)
        columns = np.arange(self.size, self.size + width)
        self.size += width
        places: dict[int, Columns] = {}
        for f, part in enumerate(curve.parts):
            record = self.records[f]
            if part is None or curve.axis not in record.axes:
                continue
            places[f] = columns
            force = AMPLITUDE * hundredths(record.context)[curve.axis] * part
            self._curves[int(columns[0]), f] = force
            self._courses[int(columns[0])] = curve.course
            self._at[f, curve.axis].add(columns, force[:: self.every[f]])
        one = np.ones(width)
        self._take_in(
            Term(
                name=curve.name,
                effect=None,
                shape=(),
                columns=columns,
                scale=one,
                centre=0.0 * one,
                low=-np.inf * one,
                high=np.inf * one,
                log_shape=0.0,
                log_odds=float(np.log(odds)),
                main=one,
                places=places,
                flight=None,
                axis=AXES[curve.axis],
            )
        )

    def _reach(self) -> None:
        """Let every channel, and the offsets of the accelerometers, know of all columns."""
        for channel in self.channels:
            channel.reach(self.size)
        known = [f for f, mean in enumerate(self._bias_mean) if np.isfinite(mean).all()]
        means = [self._bias_mean[f] / KINEMATIC_SD_M_S2 for f in known]
        self.bias = np.ravel(means)
        self.x_bias = np.zeros((len(self.bias), self.size))
        for number, f in enumerate(known):
            rows = slice(3 * number, 3 * number + 3)
            for columns, part in self._bias_columns.get(f, []):
                self.x_bias[rows, columns] += part / KINEMATIC_SD_M_S2


def _errors_of_form(effect: Effect, record: Record, x: Array) -> list[Array]:
    """Model-form errors (n, 6) of contributions (n, 6, k): of laws that may have another form than the equation."""
    if effect.search.exact or effect.mixing is not None:
        return []
    out: list[Array] = []
    for i, coefficient in enumerate(effect.coefficients):
        if coefficient.name in effect.main_names:
            out += bent_forms(x[:, :, i], record)
    return out


def _mean(x: Array) -> Array:
    if np.isfinite(x).any():
        return np.asarray(np.nanmean(x, axis=0))
    return np.full(3, np.nan)
