"""What may make up a residual: every effect in every shape, and free curves of single channels, as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.effects import Context, Effect
from models.frames import AXES, Array
from replay.residual.record import Record
from replay.search.channel import Channel, Columns
from replay.search.curves import AMPLITUDE, Curve, curves
from replay.search.disturbance import runs

Key = tuple[str, int | None, str | None]
"""Name, flight (of an effect of the day) and axis (of a free curve): what may be in a set only once."""
KNOWN = 0.02
"""Odds of an unknown force that goes with a channel, where the catalogue has an effect that does."""
TRIM = 0.5
"""Standard deviation of the trim moment that every vehicle has, in hundredths of the weight times the lever."""
FORM_PRIOR = 0.25
"""Prior standard deviation of an effect's error of form, as a share of its typical size."""
FORM_LEAST = 0.1
"""Share by which an effect's size has to vary for its form to matter."""
STEP_S = 0.2
"""Spacing of the samples that are searched: the residual holds nothing above 2 Hz."""
TOLD_S = 0.05
"""How well velocity and attitude tell of the accelerometer's offset [m/s^2]."""


@dataclass(frozen=True, eq=False)
class Term:
    """One effect in one shape (or one free curve): Gaussian prior on its coefficients, cut off at bounds.

    Columns are in units of the prior's standard deviation: a coefficient has prior N(``centre``, 1) there.
    """

    name: str
    effect: Effect | None
    shape: tuple[float, ...]
    columns: Columns
    scale: Array
    centre: Array
    low: Array
    high: Array
    log_shape: float
    """Log prior of this shape among the effect's."""
    main: Array
    """(k,) 1 for coefficients that make the effect what it is, else 0."""
    share: float
    """Smallest share of an axis' energy that it has to take off."""
    places: dict[int, Columns]
    """Of every flight that it acts on: columns of its coefficients there, in their order."""
    flight: int | None = None
    axis: str | None = None
    """Of a free curve."""

    @property
    def key(self) -> Key:
        """What may be there only once."""
        return (self.name, self.flight, self.axis)

    def coefficients(self, b: Array) -> Array:
        """Of scaled coefficients."""
        return b * self.scale


def _regressors(effect: Effect, record: Record, shape: tuple[float, ...]) -> Array:
    with np.errstate(invalid="ignore", over="ignore"):
        x = effect.regressors(record.context, shape)
    return np.nan_to_num(x, posinf=0.0, neginf=0.0)


def _bent(x: Array, record: Record) -> list[Array]:
    """What a wrong form adds to a contribution (n, 6): a gain that goes with its size, orthogonal to itself."""
    valid = record.valid
    weight = record.context.weight
    size = np.sqrt((x[:, :3] ** 2).sum(axis=1) + (x[:, 3:] ** 2).sum(axis=1) / record.context.lever**2)
    top = float(np.quantile(size[valid], 0.99)) if valid.any() else 0.0
    if top < 1e-9 * weight:
        return []
    u = np.minimum(size / top, 1.0)
    energy = np.where(valid, size**2, 0.0)
    out = []
    basis = [np.ones_like(u)]
    for power in (1, 2):
        phi = u**power
        for known in basis:
            phi = phi - known * float((energy * phi * known).sum() / (energy * known**2).sum())
        if float((energy * phi**2).sum()) < (FORM_LEAST**2) * float(energy.sum()):
            break
        basis.append(phi)
        spread = float(np.sqrt((energy * phi**2).sum() / energy.sum()))
        out.append(x * (FORM_PRIOR * phi / spread)[:, None])
    return out


def _mean(x: Array) -> Array:
    return np.asarray(np.nanmean(x, axis=0)) if np.isfinite(x).any() else np.full(3, np.nan)


def _log_shapes(effect: Effect, shapes: Sequence[tuple[float, ...]]) -> list[float]:
    """Log prior of every shape of the grid: half of it to kinds, the rest as the shapes' own priors say."""
    kind = np.array([any(v in p.kinds for v, p in zip(s, effect.shapes, strict=True)) for s in shapes])
    weight = np.array(
        [
            np.exp(-0.5 * sum((v / p.typical) ** 2 for v, p in zip(s, effect.shapes, strict=True) if p.typical))
            for s in shapes
        ]
    )
    for part in (kind, ~kind):
        if part.any():
            weight[part] *= (0.5 if kind.any() and not kind.all() else 1.0) / weight[part].sum()
    return [float(v) for v in np.log(weight)]


class Library:
    """All terms of some flights, and the channels that they act on."""

    def __init__(self, records: Sequence[Record], effects: Sequence[Effect]) -> None:
        self.records = list(records)
        self.every = [max(round(STEP_S / r.step_s), 1) for r in records]
        self.terms: list[Term] = []
        self.lacking: dict[str, str] = {}
        self._trims: list[tuple[int, int]] = []
        self.size = 0
        self.channels = [self._channel(f, a) for f, r in enumerate(records) for a in r.axes]
        self._at = {(c.flight, c.axis): c for c in self.channels}
        self._curves: dict[tuple[int, int], Array] = {}
        self._told: dict[int, list[tuple[Columns, Array]]] = {}
        for effect in effects:
            self._add_effect(effect)
        known = {
            (channel, axis) for t in self.terms if t.effect is not None for channel in t.effect.channels
            for axis in t.effect.axes
        }  # fmt: skip
        for curve in curves(self.records):
            self._add_curve(curve, (curve.name, AXES[curve.axis]) in known)
        self.trim = self._add_trim()
        self._told_mean = [_mean(r.kinematic_bias[r.valid]) for r in records]
        self._told_rows: list[tuple[Array, Array]] = []
        self._reach()

    def finer(self, term: Term, share: float) -> list[Term]:
        """Terms between a term's shape and its neighbours on the grid, ``share`` of the way; all terms taken in."""
        effect = term.effect
        if effect is None:
            return []
        out: list[Term] = []
        flights = range(len(self.records)) if term.flight is None else [term.flight]
        usable = [f for f in flights if self._reason(effect, self.records[f]) is None]
        for i, (parameter, value) in enumerate(zip(effect.shapes, term.shape, strict=True)):
            if not parameter.continuous or value in parameter.kinds:
                continue
            grid = sorted({t.shape[i] for t in self.terms if t.key == term.key} - set(parameter.kinds))
            at = grid.index(value)
            for near in grid[max(at - 1, 0) : at] + grid[at + 1 : at + 2]:
                between = float(value + share * (near - value))
                # A length at which a curve is linearised may not pass through none.
                if any(abs(between - g) < 1e-9 for g in grid) or (effect.at_shape and value * near < 0.0):
                    continue
                shape = (*term.shape[:i], between, *term.shape[i + 1 :])
                self._add(effect, term.flight, usable, shape, term.log_shape)
                out.append(self.terms[-1])
        if out:
            self._reach()
        return out

    def _reason(self, effect: Effect, record: Record) -> str | None:
        if effect.needs_moments and 3 not in record.axes:
            return "this log cannot judge moments"
        forces = {AXES.index(a) for a in effect.axes} & {0, 1, 2}
        if forces and not forces & set(record.axes):
            return "this log cannot judge the force that it makes"
        return effect.lacking(record.context)

    def _add_effect(self, effect: Effect) -> None:
        reasons = [self._reason(effect, r) for r in self.records]
        usable = [f for f, reason in enumerate(reasons) if reason is None]
        if not usable:
            self.lacking[effect.name] = next(r for r in reasons if r is not None)
            return
        groups = [(f, [f]) for f in usable] if effect.of_day else [(None, usable)]
        for flight, flights in groups:
            shapes = list(dict.fromkeys(s for f in flights[:1] for s in effect.shape_grid(self.records[f].context)))
            for shape, log_shape in zip(shapes, _log_shapes(effect, shapes), strict=True):
                self._add(effect, flight, flights, shape, log_shape)

    def _add(
        self, effect: Effect, flight: int | None, flights: Sequence[int], shape: tuple[float, ...], log_shape: float
    ) -> None:
        context = self.records[flights[0]].context
        spread = np.array([c.spread(context) for c in effect.coefficients])
        centre = np.array([c.centre for c in effect.coefficients])
        if effect.at_shape:
            spread[0], centre[0] = 0.15 * abs(shape[0]), shape[0]
        columns: list[int] = []
        scale: list[float] = []
        mean: list[float] = []
        low: list[float] = []
        high: list[float] = []
        main: list[float] = []
        place: dict[int, Columns] = {f: np.empty(len(spread), np.int64) for f in flights}
        for i, c in enumerate(effect.coefficients):
            for j, f in enumerate(flights):
                if j == 0 or (c.of_day and not effect.of_day):
                    columns.append(self.size)
                    scale.append(spread[i])
                    mean.append(centre[i] / spread[i])
                    low.append(c.low / spread[i])
                    high.append(c.high / spread[i])
                    main.append(float(not effect.main or c.name in effect.main))
                    self.size += 1
                place[f][i] = self.size - 1
        bends = [i for i, c in enumerate(effect.coefficients) if not effect.main or c.name in effect.main]
        form: list[list[tuple[int, Array]]] = []
        for f in flights:
            record = self.records[f]
            x = _regressors(effect, record, shape) * spread
            form.append([(i, bent[:: self.every[f]]) for i in bends for bent in _bent(x[:, :, i], record)])
            x = x[:: self.every[f]]
            for a in record.axes:
                if effect.searched and AXES[a] not in effect.searched:
                    continue
                live = np.flatnonzero(np.abs(x[:, a]).max(axis=0) > 0.0)
                if live.size:
                    self._at[f, a].add(place[f][live], x[:, a][:, live])
            if effect.told is not None:
                self._told.setdefault(f, []).append((place[f], effect.told(record.context, shape) * spread))
        for j in range(max(len(parts) for parts in form)):
            for f, parts in zip(flights, form, strict=True):
                if j < len(parts):
                    bent = parts[j][1]
                    for a in self.records[f].axes:
                        if (not effect.searched or AXES[a] in effect.searched) and np.abs(bent[:, a]).max() > 0.0:
                            self._at[f, a].add(np.array([self.size]), bent[:, a : a + 1])
            columns.append(self.size)
            scale.append(FORM_PRIOR)
            mean.append(0.0)
            low.append(-np.inf)
            high.append(np.inf)
            main.append(0.0)
            self.size += 1
        self.terms.append(
            Term(effect.name, effect, shape, np.array(columns), np.array(scale), np.array(mean), np.array(low),
                 np.array(high), log_shape, np.array(main), effect.least_share, place, flight)
        )  # fmt: skip

    def _channel(self, f: int, a: int) -> Channel:
        record, every = self.records[f], self.every[f]
        limit = 0.01 * record.context.weight * (1.0 if a < 3 else record.context.lever)
        return Channel(f, a, np.nan_to_num(record.residual[::every, a]), runs(record.valid[::every]), limit)

    def _add_trim(self) -> Columns:
        """Constant moments of every flight that a vehicle has without any effect: columns of no term."""
        first = self.size
        for f, record in enumerate(self.records):
            for a in (a for a in record.axes if a >= 3):
                constant = np.full((len(record.valid[:: self.every[f]]), 1), TRIM / AMPLITUDE * self._amplitude(f, a))
                self._at[f, a].add(np.array([self.size]), constant)
                self._trims.append((f, a))
                self.size += 1
        return np.arange(first, self.size)

    def trim_wrench(self, flight: int, b: Array) -> Array:
        """Trim moments (6,) of a flight by the scaled coefficients of all trims."""
        out = np.zeros(6)
        for (f, a), value in zip(self._trims, b, strict=True):
            if f == flight:
                out[a] = value * TRIM / AMPLITUDE * self._amplitude(f, a)
        return out

    def _amplitude(self, flight: int, axis: int) -> float:
        context = self.context(flight)
        return AMPLITUDE * 0.01 * context.weight * (1.0 if axis < 3 else context.lever)

    def told(self) -> list[tuple[Array, Array]]:
        """What velocity and attitude tell of every accelerometer (3,), and columns (3, K), in units of their error."""
        return self._told_rows

    def groups(self) -> dict[int, tuple[list[int], NDArray[np.int64]]]:
        """Terms by how many columns they have: their numbers (m,) and columns (m, width)."""
        out: dict[int, list[int]] = {}
        for i, term in enumerate(self.terms):
            out.setdefault(len(term.columns), []).append(i)
        return {width: (index, np.stack([self.terms[i].columns for i in index])) for width, index in out.items()}

    def context(self, flight: int) -> Context:
        """Of a flight."""
        return self.records[flight].context

    def curve(self, term: Term, flight: int) -> Array:
        """Columns (n, k) of a free curve at the record's rate."""
        return self._curves[int(term.columns[0]), flight]

    def wrenches(self, term: Term, flight: int) -> tuple[Array, Array]:
        """Wrenches (n, 6, k) per coefficient of an effect at the record's rate, and (n, 6, m) of its errors of form."""
        effect, record = term.effect, self.records[flight]
        assert effect is not None
        x = _regressors(effect, record, term.shape)
        spread = term.scale[np.searchsorted(term.columns, term.places[flight])]
        bends = [i for i, c in enumerate(effect.coefficients) if not effect.main or c.name in effect.main]
        bent = [part for i in bends for part in _bent(x[:, :, i] * spread[i], record)]
        forms = len(term.columns) - len({int(c) for p in term.places.values() for c in p})
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
            self._curves[int(columns[0]), f] = self._amplitude(f, curve.axis) * part
            self._at[f, curve.axis].add(columns, self._curves[int(columns[0]), f][:: self.every[f]])
        one = np.ones(len(columns))
        odds = float(np.log(curve.odds * (KNOWN if known else 1.0)))
        self.terms.append(
            Term(curve.name, None, (), columns, one, 0.0 * one, -np.inf * one, np.inf * one, odds, one, curve.share,
                 places, None, AXES[curve.axis])
        )  # fmt: skip

    def _reach(self) -> None:
        """Let every channel know of all columns."""
        for channel in self.channels:
            channel.reach(self.size)
        self._told_rows = []
        for f, mean in enumerate(self._told_mean):
            if np.isfinite(mean).all():
                x = np.zeros((3, self.size))
                for columns, part in self._told.get(f, []):
                    x[:, columns] += part
                self._told_rows.append((mean / TOLD_S, x / TOLD_S))
