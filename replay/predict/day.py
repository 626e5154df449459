"""What belongs to the day of a flight, learnt from its start.

Forces of the weather, the load and the accelerometer; by how much the effects of the model are larger than when they
were found; and what every vehicle has, where the model says nothing of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.common.frames import Array
from models.effects import AdoptedEffect, BelongsTo, Context, Effect, adopted_wrench, catalogue, get
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.channel import hundredths

LEARNING_S = 20.0
"""Judged time at the start of a flight from which its day is learnt [s]."""
CORRELATED_S = 0.3
"""Time over which the low-pass makes a residual stay correlated [s]: samples within it count as one."""
MODEL_SPREAD = 0.25
"""How much an effect of the model differs from day to day, as a share of it: as much as its law may be wrong."""
GAIN = "larger_by"
"""Name of that share among the numbers of an effect."""
ROUNDS = 3
"""Noise and coefficients are fitted in turn so often."""
QUIETEST = 0.2
"""Smallest noise, in hundredths of the weight (times the lever, for moments)."""


@dataclass(frozen=True, kw_only=True)
class Day:
    """What belongs to the day: coefficients (k,), each by its effect's name and its own, and wrenches (n, 6, k)."""

    names: tuple[tuple[str, str], ...]
    values: Array
    columns: Array
    said: Mapping[str, Mapping[str, float]]
    """Effects to their numbers, as people say them."""
    shapes: Mapping[str, tuple[float, ...]]
    """Of every effect of the day."""
    model: Mapping[str, Sequence[AdoptedEffect]]
    """Effects of the model, which have a ``GAIN``."""

    @property
    def wrench(self) -> Array:
        """(n, 6), body FRD about the CG."""
        return np.asarray(self.columns @ self.values)

    def effects(self) -> tuple[AdoptedEffect, ...]:
        """The same as effects that a model may have besides its own."""
        out = []
        for name, shape in self.shapes.items():
            effect = get(name)
            coefficients = [c.name for c in effect.coefficients]
            parameters = dict.fromkeys(coefficients, 0.0)
            for (owner, coefficient), value in zip(self.names, self.values.tolist(), strict=True):
                if owner == name and coefficient != GAIN:
                    parameters[coefficient] = value
            for s, value in zip(effect.shapes, shape, strict=True):
                parameters[s.name] = value
            out.append(AdoptedEffect(name, parameters))
        for (owner, coefficient), value in zip(self.names, self.values.tolist(), strict=True):
            if coefficient == GAIN:
                out += [_scaled(adopted, value) for adopted in self.model[owner]]
        return tuple(out)

    def as_json(self) -> dict[str, dict[str, float]]:
        """Effects to their numbers."""
        out = {}
        for name, said in self.said.items():
            out[name] = {key: float(f"{value:.4g}") for key, value in said.items()}
        return out


def learning_time(record: Record) -> Mask:
    """(n,) the first ``LEARNING_S`` of the judged time."""
    return record.valid & (np.cumsum(record.valid) * record.step_s <= LEARNING_S)


def learn_day(
    record: Record,
    residual: Array,
    adopted: Sequence[AdoptedEffect],
    of_day: Mapping[str, Mapping[str, float]],
) -> Day:
    """The day of a flight by what a model leaves (n, 6) of its start; ``adopted``: the effects that it has.

    Maximum a posteriori of a linear model. Every coefficient has the Gaussian prior of its effect, about zero. An
    effect of the model grows by a share, N(0, ``MODEL_SPREAD``^2). Noise has the mean square of what is left, counted
    once in ``CORRELATED_S``. What is left has a mean, too: else a constant moment that nothing of the day explains, as
    of a shifted centre of gravity, would be taken for wind. What every vehicle has is learnt where no effect of the
    model says it.

    ``of_day``: shapes of the effects of the day that the model knows besides, by the name of the effect.
    """
    known = {e.name: e.parameters for e in adopted} | dict(of_day)
    names: list[tuple[str, str]] = []
    columns: list[Array] = []
    spread: list[float] = []
    shapes: dict[str, tuple[float, ...]] = {}
    common = [effect.name for effect in catalogue() if effect.every_flight]
    for effect in map(get, dict.fromkeys((*common, *_unsaid(adopted), *of_day))):
        if effect.lacking(record.context) is not None:
            continue
        shape = tuple(known.get(effect.name, {}).get(s.name, 0.0) for s in effect.shapes)
        shapes[effect.name] = shape
        wrench = np.nan_to_num(effect.regressors(record.context, shape))
        for i in _of_day(effect):
            names.append((effect.name, effect.coefficients[i].name))
            columns.append(wrench[..., i])
            spread.append(effect.coefficients[i].spread(record.context))
    model: dict[str, list[AdoptedEffect]] = {}
    for one in adopted:
        model.setdefault(one.name, []).append(one)
    for name, effects in model.items():
        names.append((name, GAIN))
        columns.append(np.nan_to_num(adopted_wrench(effects, record.context)))
        spread.append(MODEL_SPREAD)
    x = np.stack(columns, axis=-1)
    rows = learning_time(record)
    prior = 1.0 / np.array(spread) ** 2
    y = residual[rows]
    values = np.zeros(len(spread))
    least = QUIETEST * hundredths(record.context)
    for _ in range(ROUNDS):
        precision = np.diag(prior)
        towards = np.zeros(len(spread))
        noise = np.maximum(np.sqrt(((y - x[rows] @ values) ** 2).mean(axis=0)), least)
        for axis in record.axes:
            weight = record.step_s / CORRELATED_S / noise[axis] ** 2
            precision += weight * x[rows, axis].T @ x[rows, axis]
            towards += weight * x[rows, axis].T @ y[:, axis]
        values = np.asarray(np.linalg.solve(precision, towards), dtype=float)
    return Day(
        names=tuple(names),
        values=values,
        columns=x,
        said=_said(record.context, names, values.tolist(), known),
        shapes=shapes,
        model=model,
    )


def _scaled(adopted: AdoptedEffect, share: float) -> AdoptedEffect:
    """A share of an effect: its wrench is linear in its coefficients, not in its shapes."""
    shapes = {s.name for s in get(adopted.name).shapes}
    parameters = {}
    for name, value in adopted.parameters.items():
        parameters[name] = value if name in shapes else share * value
    return replace(adopted, parameters=parameters)


def _said(
    context: Context,
    names: Sequence[tuple[str, str]],
    values: Sequence[float],
    known: Mapping[str, Mapping[str, float]],
) -> dict[str, dict[str, float]]:
    """Coefficients of the day as people say them, beside what the model has of the vehicle, or else what is usual."""
    of_effect: dict[str, dict[str, float]] = {}
    out: dict[str, dict[str, float]] = {}
    for (name, coefficient), value in zip(names, values, strict=True):
        if coefficient == GAIN:
            out[name] = {GAIN: value}
        else:
            of_effect.setdefault(name, {})[coefficient] = value
    for name, found in of_effect.items():
        effect = get(name)
        # What the context's model has of it, an effect adds by itself.
        declared = {e.name for e in getattr(context.model, "effects", ())} & {
            name,
            *effect.contains,
        }
        own = known.get(name, {})
        beside = {}
        for c in effect.coefficients:
            beside[c.name] = 0.0 if declared else own.get(c.name, c.mean(context))
        beside |= {s.name: own.get(s.name, 0.0) for s in effect.shapes}
        quantities = {q.instead_of: q.name for q in effect.shown.quantities}
        said = effect.said(context, beside | found)
        numbers = {key: said[key] for key in (quantities.get(c, c) for c in found)}
        out[name] = numbers | out.get(name, {})
    return out


def _unsaid(adopted: Sequence[AdoptedEffect]) -> list[str]:
    """Effects that every vehicle has, and of which the model says nothing."""
    said: set[str] = set()
    for one in adopted:
        said.update((one.name, *get(one.name).contains))
    return [e.name for e in catalogue() if e.every_vehicle and e.name not in said]


def _of_day(effect: Effect) -> list[int]:
    """Coefficients that a flight says anew.

    Those that it has of its own, a sensor's about what the model has of them, and the main ones of every vehicle.
    """
    sensor = effect.belongs_to is BelongsTo.INSTRUMENT
    out = []
    for i, c in enumerate(effect.coefficients):
        main = effect.every_vehicle and c.name in effect.main
        if sensor or main or effect.of_day(c):
            out.append(i)
    return out
