"""The library: every effect in every shape and free curves of single channels, as columns of every flight's axes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, groupby, product, zip_longest
from typing import NamedTuple

import numpy as np

from models.common.frames import AXES, Array
from models.effects import Effect
from replay.residual.record import Record
from replay.search.beginnings import NONE_S, log_chance, times_of
from replay.search.channel import Columns, ResidualChannel, Whitened, hundredths
from replay.search.curves import ATTITUDE, Curve, curves
from replay.search.noise_spectra import valid_before
from replay.search.terms import (
    STEP_S,
    Key,
    Term,
    bent_forms,
    log_shapes,
    prior_of,
    regressors_of,
    unmixed_regressors,
)
from replay.search.thresholds import (
    AMPLITUDE,
    CLOCK_SD_S,
    FORM_PRIOR,
    KINEMATIC_SD_M_S2,
    KNOWN,
    LIFT_TRIM,
    OFF_CENTRE,
    TRIM,
    USUAL_DRAG,
)

LIFT = AXES.index("Fz")


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

    ``beside``: of every flight, wrenches (n, 6) that it may have besides, each times N(0, 1), and that are not named.
    """

    def __init__(
        self,
        records: Sequence[Record],
        effects: Sequence[Effect],
        beside: Sequence[Sequence[Array]] = (),
    ) -> None:
        self.records = list(records)
        self._beside = beside or [()] * len(self.records)
        self.every = [max(round(STEP_S / r.step_s), 1) for r in records]
        self.terms: list[Term] = []
        self.lacking: dict[str, str] = {}
        self._trims: list[tuple[int, Array]] = []
        self.size = 0
        self.taken_in = 0
        """Terms that were ever taken in."""
        self.channels = [self._channel(f, a) for f, r in enumerate(records) for a in r.axes]
        self.flights = [list(axes) for _, axes in groupby(self.channels, key=lambda c: c.flight)]
        """The channels of every flight that has some: they share its time, and are worked on together."""
        self._at = {(c.flight, c.axis): c for c in self.channels}
        self.numbers_of: dict[Key, list[int]] = {}
        """Numbers of the terms with a key: one effect in all its shapes."""
        self._alike: dict[Key | None, tuple[Term, list[Alike]]] = {}
        self._unmixed: dict[tuple[str, int], Columns] = {}
        """Of an effect whose shape only mixes its regressors, and a flight: the columns that are mixed."""
        self._curves: dict[tuple[int, int], Array] = {}
        self._bias_columns: dict[int, list[tuple[Columns, Array]]] = {}
        self.remainders: list[Effect] = []
        """Effects that are weighed after all others."""
        for effect in effects:
            usable = self._usable(effect)
            if not usable:
                self.lacking[effect.name] = self._reason(effect, self.records[0]) or ""
            elif effect.search.remainder:
                self.remainders.append(effect)
            else:
                self._add_effect(effect, usable)
        known: set[tuple[str, str]] = set()
        for t in self.terms:
            known.update(product(t.named.channels, t.named.axes))
        for curve in curves(self.records):
            explained = (curve.name, AXES[curve.axis]) in known
            self._add_curve(curve, curve.name in ATTITUDE or explained)
        self.trim = self._add_trim()
        self._bias_mean = [_mean(r.kinematic_bias[r.valid]) for r in records]
        self.bias = np.empty(0)
        self.x_bias = np.empty((0, 0))
        """Offsets of all accelerometers by velocity and attitude (m,), and columns (m, K), over their error."""
        self._reach()

    def term_of(self, effect: Effect, shape: tuple[float, ...]) -> Term:
        """One more term: an effect of the vehicle in this shape, which is as likely as any other."""
        self._add(effect, None, self._usable(effect), shape, 0.0)
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
        for i in numbers:
            by_width.setdefault(len(self.terms[i].columns), []).append(i)
        groups = []
        for same in by_width.values():
            columns = np.stack([self.terms[i].columns for i in same])
            centre = np.stack([self.terms[i].centre for i in same])
            groups.append(Alike(same, columns, centre))
        self._alike[key] = last, groups
        return groups

    def again(self, term: Term, instance: int, but: Collection[float]) -> list[Term]:
        """The terms of an effect once more, for a further one of it: all shapes but some first ones."""
        key = replace(term, instance=instance).key
        if key not in self.numbers_of:
            for other in self.with_key(term.key):
                if other.shape[0] not in but:
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
        for i, (parameter, value) in enumerate(zip(effect.shapes, term.shape, strict=True)):
            if not parameter.continuous or value in parameter.kinds:
                continue
            grid = sorted({t.shape[i] for t in self.with_key(term.key)} - set(parameter.kinds))
            at = grid.index(value)
            for near in grid[max(at - 1, 0) : at] + grid[at + 1 : at + 2]:
                between = float(value + share * (near - value))
                # A length at which a curve is linearised may not pass through none.
                through_none = effect.search.at_shape and value * near < 0.0
                if through_none or np.abs(np.subtract(grid, between)).min() < 1e-9:
                    continue
                shape = (*term.shape[:i], between, *term.shape[i + 1 :])
                self._add(effect, term.flight, list(term.places), shape, term.log_shape)
                out.append(self.terms[-1])
        if out:
            self._reach()
        return out

    def _usable(self, effect: Effect) -> list[int]:
        """Flights that can show an effect."""
        return [f for f, record in enumerate(self.records) if self._reason(effect, record) is None]

    def _reason(self, effect: Effect, record: Record) -> str | None:
        if effect.search.needs_moments and 3 not in record.axes:
            return "this log cannot judge moments"
        forces = {AXES.index(a) for a in effect.axes} & {0, 1, 2}
        if forces and not forces & set(record.axes):
            return "this log cannot judge the force that it makes"
        return effect.lacking(record.context)

    def _add_effect(self, effect: Effect, usable: Sequence[int]) -> None:
        groups: list[tuple[int | None, Sequence[int]]]
        if effect.all_of_day:
            groups = [(f, [f]) for f in usable]
        else:
            groups = [(None, usable)]
        for flight, flights in groups:
            shapes = list(dict.fromkeys(effect.shape_grid(self.records[flights[0]].context)))
            priors = dict(zip(shapes, log_shapes(effect, shapes), strict=True))
            if effect.search.may_begin and (effect.all_of_day or len(self.records) == 1):
                effect = effect.for_a_time
                priors = self._begun(effect, flights[0], priors)
            for shape, log_shape in priors.items():
                self._add(effect, flight, flights, shape, log_shape)

    def _begun(
        self, effect: Effect, flight: int, priors: Mapping[tuple[float, ...], float]
    ) -> dict[tuple[float, ...], float]:
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
        shape: tuple[float, ...],
        log_shape: float,
    ) -> None:
        """One shape of an effect: numbers for coefficients and model-form errors, and columns in every channel."""
        context = self.records[flights[0]].context
        spread, centre = prior_of(effect, context, shape)
        places, priors = self._numbered(effect, flights, spread, centre)
        bent = [self._write(effect, f, shape, spread, places[f]) for f in flights]
        for parts in zip_longest(*bent):
            column = np.array([self.size])
            for f, part in zip(flights, parts, strict=True):
                if part is not None:
                    self._put(f, self._searched_axes(effect, f), column, part[..., None])
            priors.append(Prior(column=self.size, scale=FORM_PRIOR))
            self.size += 1
        self._take_in(
            Term(
                name=effect.name,
                effect=effect,
                shape=shape,
                columns=np.array([p.column for p in priors]),
                scale=np.array([p.scale for p in priors]),
                centre=np.array([p.centre for p in priors]),
                low=np.array([p.low for p in priors]),
                high=np.array([p.high for p in priors]),
                main=np.array([p.main for p in priors]),
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
        for i, c in enumerate(effect.coefficients):
            for j, f in enumerate(flights):
                if j == 0 or (effect.of_day(c) and not effect.all_of_day):
                    own = self.records[f].context
                    priors.append(
                        Prior(
                            column=self.size,
                            scale=spread[i],
                            centre=centre[i] / spread[i],
                            low=c.least(own) / spread[i],
                            high=c.most(own) / spread[i],
                            main=float(c.name in effect.main_names),
                        )
                    )
                    self.size += 1
                places[f][i] = self.size - 1
        return places, priors

    def _write(
        self, effect: Effect, f: int, shape: tuple[float, ...], spread: Array, place: Columns
    ) -> list[Array]:
        """Columns of an effect in the channels of one flight; its model-form errors there, (n, 6) each."""
        record = self.records[f]
        if effect.mixing is not None:
            self._mix(effect, f, effect.mixing(shape) * spread, place)
            return []
        x = regressors_of(effect, record, shape) * spread
        bent: list[Array] = []
        for i in _with_errors_of_form(effect):
            bent += [b[:: self.every[f]] for b in bent_forms(x[:, :, i], record)]
        self._put(f, self._searched_axes(effect, f), place, x[:: self.every[f]])
        if effect.kinematic_bias is not None:
            part = effect.kinematic_bias(record.context, shape) * spread
            self._bias_columns.setdefault(f, []).append((place, part))
        return bent

    def _mix(self, effect: Effect, f: int, mixing: Array, place: Columns) -> None:
        """Columns of an effect whose shape only mixes its regressors: these are taken in once."""
        axes = self._searched_axes(effect, f)
        if (effect.name, f) not in self._unmixed:
            x = unmixed_regressors(effect, self.records[f], ())
            self._unmixed[effect.name, f] = np.arange(self.size, self.size + x.shape[2])
            self.size += x.shape[2]
            self._put(f, axes, self._unmixed[effect.name, f], x[:: self.every[f]])
        for a in axes:
            self._at[f, a].mix(place, self._unmixed[effect.name, f], mixing)

    def _put(self, f: int, axes: Iterable[int], columns: Columns, x: Array) -> None:
        """Columns (n, 6, k) in the channels of one flight where they are not zero."""
        for a in axes:
            live = np.flatnonzero(np.abs(x[:, a]).max(axis=0) > 0.0)
            if live.size:
                self._at[f, a].add(columns[live], x[:, a][:, live])

    def _searched_axes(self, effect: Effect, f: int) -> list[int]:
        wanted = effect.search.searched or AXES
        return [a for a in self.records[f].axes if AXES[a] in wanted]

    def _channel(self, f: int, a: int) -> ResidualChannel:
        record = self.records[f]
        every = self.every[f]
        residual = np.nan_to_num(record.residual[::every, a])
        return ResidualChannel(
            f, a, residual, valid_before(record.valid[::every]), hundredths(record.context)[a]
        )

    def _add_trim(self) -> Columns:
        """What every flight has without any effect, as columns of no term."""
        first = self.size
        for f, record in enumerate(self.records):
            share = np.where(np.arange(6) == LIFT, LIFT_TRIM, TRIM)
            constant = np.diag(hundredths(record.context) * share)
            trims = [np.broadcast_to(constant[a], (len(record.valid), 6)) for a in record.axes]
            trims.append(_late_rotors(record))
            # An accelerometer of its own, not the velocity's derivative.
            if np.isfinite(record.kinematic_bias).any():
                trims += [_late_velocity(record), *_off_centre(record)]
            trims += self._beside[f]
            for x in trims:
                self._put(f, record.axes, np.array([self.size]), x[:: self.every[f], :, None])
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

    def wrenches(self, term: Term, flight: int) -> tuple[Array, Array]:
        """Wrenches (n, 6, k) per coefficient at the record's rate, and (n, 6, m) of its model-form errors."""
        effect = term.named
        record = self.records[flight]
        x = regressors_of(effect, record, term.shape)
        spread = term.scale[term.place(flight)]
        bent: list[Array] = []
        for i in _with_errors_of_form(effect):
            bent += bent_forms(x[:, :, i] * spread[i], record)
        forms = int(term.form.sum())
        out = np.zeros((len(x), 6, forms))
        for j, part in enumerate(bent[:forms]):
            out[:, :, j] = part
        return x, out

    def _add_curve(self, curve: Curve, known: bool) -> None:
        widths = {p.shape[1] for p in curve.parts if p is not None}
        columns = np.arange(self.size, self.size + max(widths))
        self.size += len(columns)
        places: dict[int, Columns] = {}
        for f, (record, part) in enumerate(zip(self.records, curve.parts, strict=True)):
            if part is None or curve.axis not in record.axes:
                continue
            places[f] = columns
            force = AMPLITUDE * hundredths(record.context)[curve.axis] * part
            self._curves[int(columns[0]), f] = force
            self._at[f, curve.axis].add(columns, force[:: self.every[f]])
        one = np.ones(len(columns))
        log_odds = float(np.log(curve.odds * (KNOWN if known else 1.0)))
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
                log_odds=log_odds,
                main=one,
                places=places,
                flight=None,
                axis=AXES[curve.axis],
            )
        )

    def _reach(self) -> None:
        """Let every channel know of all columns."""
        for channel in self.channels:
            channel.reach(self.size)
        known = [f for f, mean in enumerate(self._bias_mean) if np.isfinite(mean).all()]
        self.bias = np.ravel([self._bias_mean[f] / KINEMATIC_SD_M_S2 for f in known])
        self.x_bias = np.zeros((len(self.bias), self.size))
        for rows, f in enumerate(known):
            for columns, part in self._bias_columns.get(f, []):
                self.x_bias[3 * rows : 3 * rows + 3, columns] += part / KINEMATIC_SD_M_S2


class Design:
    """A set of terms on the channels: the columns of the terms, the trims behind them."""

    def __init__(self, library: Library, terms: Sequence[Term]) -> None:
        self.library = library
        self.terms = tuple(terms)
        columns = [t.columns for t in terms]
        centres = [t.centre for t in terms]
        widths = [len(of_term) for of_term in (*columns, library.trim)]
        self.edges = list(accumulate(widths[:-1], initial=0))
        self.columns = np.concatenate([*columns, library.trim])
        self.centre = np.concatenate([*centres, np.zeros(len(library.trim))])
        self.of_term = np.arange(len(self.terms))[:, None] == np.repeat(
            np.arange(len(widths)), widths
        )
        """(terms, k) which columns are whose."""
        self.products: dict[Whitened, Array] = {}
        """Inner products of residual and columns (1 + k, 1 + k), as far as they were needed."""

    @cached_property
    def _acting(self) -> list[list[tuple[Columns, Array]]]:
        """Of every axis of every flight the columns that act on it, by their numbers (m,), and their rows (m, n)."""
        out = []
        for axes in self.library.flights:
            out.append([self._on(channel) for channel in axes])
        return out

    def _on(self, channel: ResidualChannel) -> tuple[Columns, Array]:
        rows = channel.where[self.columns]
        on = np.flatnonzero(rows >= 0)
        return on, channel.rows[rows[on]]

    def times(self, b: Array) -> list[Array]:
        """What rows of coefficients (m, k) do on every flight, (axes, m, n)."""
        out = []
        for axes in self._acting:
            done = np.empty((len(axes), len(b), axes[0][1].shape[1]))
            for (on, x), place in zip(axes, done, strict=True):
                np.matmul(b[:, on], x, out=place)
            out.append(done)
        return out


def _with_errors_of_form(effect: Effect) -> list[int]:
    """Coefficients whose contribution may have another form than its equation says."""
    if effect.search.exact or effect.mixing is not None:
        return []
    return [i for i, c in enumerate(effect.coefficients) if c.name in effect.main_names]


def _late_rotors(record: Record) -> Array:
    """Lift (n, 6) by rotor speeds that are late by a standard deviation."""
    out = np.zeros((len(record.valid), 6))
    change = np.gradient(record.context.rotor_force[:, LIFT], record.step_s)
    # None beside a gap: that is no change of lift.
    out[:, LIFT] = CLOCK_SD_S * np.nan_to_num(change)
    return out


def _late_velocity(record: Record) -> Array:
    """What the usual drag misses (n, 6) where the velocity is late by a standard deviation."""
    out = np.zeros((len(record.valid), 6))
    mass_flow = record.context.mass_flow.sum(axis=-1)[:, None]
    drag = USUAL_DRAG * mass_flow * record.context.velocity[:, :2]
    out[:, :2] = CLOCK_SD_S * np.nan_to_num(np.gradient(drag, record.step_s, axis=0))
    return out


def _off_centre(record: Record) -> Iterator[Array]:
    """What an accelerometer off the centre of gravity feels of turning (n, 6), for a standard deviation along x, y, z.

    Acceleration of a point of a rigid body: Goldstein, Classical Mechanics, ch. 4.
    """
    ctx = record.context
    rates = ctx.state.rates
    turn = np.gradient(rates, record.step_s, axis=0)
    for at in OFF_CENTRE * ctx.lever * np.eye(3):
        out = np.zeros((len(record.valid), 6))
        felt = np.cross(turn, at) + np.cross(rates, np.cross(rates, at))
        out[:, :3] = ctx.vehicle.mass_kg * np.nan_to_num(felt)
        yield out


def _mean(x: Array) -> Array:
    if np.isfinite(x).any():
        return np.asarray(np.nanmean(x, axis=0))
    return np.full(3, np.nan)
