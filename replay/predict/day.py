"""What belongs to the day of a flight: forces of the weather, the load and the accelerometer, learnt from its start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.effects import AdoptedEffect, BelongsTo, Effect, get
from models.frames import Array
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.channel import hundredths

LEARNING_S = 20.0
"""Judged time at the start of a flight from which its day is learnt [s]."""
ALWAYS = ("imu_bias", "payload", "vertical_inflow", "wind")
"""Effects that every flight has something of: what a sensor reads too much, the load, and the wind."""
CORRELATED_S = 0.3
"""Time over which the low-pass makes a residual stay correlated [s]: samples within it count as one."""
ROUNDS = 3
"""Noise and coefficients are fitted in turn so often."""
QUIETEST = 0.2
"""Smallest noise, in hundredths of the weight (times the lever, for moments)."""


@dataclass(frozen=True)
class Day:
    """What belongs to the day: coefficients (k,), each by its effect's name and its own, and wrenches (n, 6, k)."""

    names: tuple[tuple[str, str], ...]
    values: Array
    columns: Array

    @property
    def wrench(self) -> Array:
        """(n, 6), body FRD about the CG."""
        return np.asarray(self.columns @ self.values)

    def as_json(self) -> dict[str, dict[str, float]]:
        """Effects to their coefficients."""
        out: dict[str, dict[str, float]] = {}
        for (effect, name), value in zip(self.names, self.values, strict=True):
            out.setdefault(effect, {})[name] = float(f"{value:.4g}")
        return out


def learning_time(record: Record) -> Mask:
    """(n,) the first ``LEARNING_S`` of the judged time."""
    return record.valid & (np.cumsum(record.valid) * record.step_s <= LEARNING_S)


def learn_day(
    record: Record, residual: Array, adopted: Sequence[AdoptedEffect], of_day: Mapping[str, Mapping[str, float]]
) -> Day:
    """The day of a flight by what a model leaves (n, 6) of its start.

    Maximum a posteriori of a linear model: every coefficient has the Gaussian prior of its effect, about zero, and
    noise has the mean square of what is left, counted once in ``CORRELATED_S``. What is left has a mean, too: else a
    constant moment that nothing of the day explains, as of a shifted centre of gravity, would be taken for wind.
    ``of_day``: shapes of the effects of the day that the model knows besides, by the name of the effect.
    """
    known = {e.name: e.parameters for e in adopted} | dict(of_day)
    names: list[tuple[str, str]] = []
    columns: list[Array] = []
    spread: list[float] = []
    for effect in map(get, dict.fromkeys((*ALWAYS, *of_day))):
        if effect.lacking(record.context) is not None:
            continue
        shape = tuple(known.get(effect.name, {}).get(s.name, 0.0) for s in effect.shapes)
        wrench = np.nan_to_num(effect.regressors(record.context, shape))
        for i in _of_day(effect):
            names.append((effect.name, effect.coefficients[i].name))
            columns.append(wrench[..., i])
            spread.append(effect.coefficients[i].spread(record.context))
    x = np.stack(columns, axis=-1)
    rows = learning_time(record)
    prior, y = 1.0 / np.array(spread) ** 2, residual[rows]
    values = np.zeros(len(spread))
    least = QUIETEST * hundredths(record.context)
    for _ in range(ROUNDS):
        precision, towards = np.diag(prior), np.zeros(len(spread))
        noise = np.maximum(np.sqrt(((y - x[rows] @ values) ** 2).mean(axis=0)), least)
        for axis in record.axes:
            weight = record.step_s / CORRELATED_S / noise[axis] ** 2
            precision += weight * x[rows, axis].T @ x[rows, axis]
            towards += weight * x[rows, axis].T @ y[:, axis]
        values = np.asarray(np.linalg.solve(precision, towards), dtype=float)
    return Day(tuple(names), values, x)


def _of_day(effect: Effect) -> list[int]:
    """Coefficients that a flight has of its own; a sensor's are learnt anew, about what the model has of them."""
    sensor = effect.belongs_to is BelongsTo.INSTRUMENT
    return [i for i, c in enumerate(effect.coefficients) if sensor or effect.of_day(c)]
