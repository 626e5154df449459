"""``replay predict`` as a function: the error of a model on flights that it was not made from, by axis and regime."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import LogError
from models.frames import AXES, Array
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.diagnosis.amended_model import known_day, learnt_from
from replay.diagnosis.answer import UNITS
from replay.diagnosis.diagnose import read_records
from replay.diagnosis.interval import rms_interval
from replay.numbers import rounded
from replay.predict.day import LEARNING_S, Day, learn_day, learning_time
from replay.residual.record import Record, check_model
from replay.search.regimes import regimes

Mask = NDArray[np.bool_]
LEAST_S = 4.0
"""A regime, or what follows the learning of wind and load, has to last so long [s]."""


@dataclass(frozen=True)
class Predicted:
    """One flight. Residuals (n, 6) in N and N m on the judged samples ``rows`` (n,)."""

    record: Record
    without: Array
    """Of the model without its adopted effects."""
    with_effects: Array
    """Of the model, and of wind and load where they were learned."""
    rows: Mask
    day: Day | None
    learnt_from: bool
    """Whether the model was made from this log."""

    @property
    def seconds(self) -> float:
        """Time that is judged."""
        return float(self.rows.sum() * self.record.step_s)


@dataclass(frozen=True)
class AxisError:
    """RMS of one axis without the adopted effects, and with them with its 95 % interval."""

    without: float
    with_effects: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class Prediction:
    """The error of a model on some flights."""

    flights: tuple[Predicted, ...]
    frozen: bool
    notes: tuple[str, ...]

    @property
    def records(self) -> list[Record]:
        """The flights."""
        return [f.record for f in self.flights]

    def axes(self) -> dict[str, AxisError]:
        """Error by axis over all flights."""
        return _errors([(f, f.rows) for f in self.flights])

    def regimes(self) -> dict[str, tuple[float, dict[str, AxisError]]]:
        """Regimes that last, with their seconds and errors by axis."""
        parts: dict[str, list[tuple[Predicted, Mask]]] = {}
        for f in self.flights:
            for name, mask in regimes(f.record).items():
                parts.setdefault(name, []).append((f, mask & f.rows))
        seconds = {name: sum(float(m.sum()) * f.record.step_s for f, m in part) for name, part in parts.items()}
        return {name: (seconds[name], _errors(part)) for name, part in parts.items() if seconds[name] >= LEAST_S}

    def as_json(self, model: str | None) -> dict[str, Any]:
        """The JSON that docs/formats.md describes."""
        content: dict[str, Any] = rounded(
            {
                "logs": list(dict.fromkeys(str(r.path) for r in self.records)),
                "model": model,
                "frozen": self.frozen,
                "duration_s": sum(f.seconds for f in self.flights),
                "axes": _json(self.axes()),
                "regimes": [
                    {"regime": name, "seconds": seconds, "axes": _json(errors)}
                    for name, (seconds, errors) in self.regimes().items()
                ],
                "flights": [
                    {
                        "log": f.record.name,
                        "seconds": f.seconds,
                        "learnt_from": f.learnt_from,
                        "axes": _json(_errors([(f, f.rows)])),
                        "day": {} if f.day is None else f.day.as_json(),
                    }
                    for f in self.flights
                ],
                "notes": self.notes,
            }
        )
        return content

    def as_text(self) -> str:
        """A few lines for a person."""
        seconds = sum(f.seconds for f in self.flights)
        how = "nothing is fitted" if self.frozen else f"wind and load are learned from the first {LEARNING_S:.0f} s"
        lines = [f"error without -> with the adopted effects  ({seconds:.0f} s judged; {how})", *_lines(self.axes())]
        for name, (lasted, errors) in self.regimes().items():
            lines += [f"  {name} ({lasted:.0f} s)", *(f"  {line}" for line in _lines(errors))]
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])


def predict(
    paths: Sequence[Path],
    vehicle: Vehicle,
    model: FanSurrogate,
    *,
    frozen: bool = False,
    target_system: int | None = None,
    progress: Callable[[Sequence[Path]], Iterable[Path]] = lambda paths: paths,
) -> Prediction:
    """Residuals of flights with and without the effects that a model adopted; nothing of the vehicle is fitted.

    Without ``frozen`` the first ``LEARNING_S`` of each flight say what belongs to its day, and the rest is judged.
    """
    check_model(vehicle, model)
    logs = list(dict.fromkeys(paths))
    notes = [] if len(logs) == len(paths) else ["a log that was given twice is judged once"]
    records, said = read_records(progress(logs), vehicle, model, target_system)
    bare, _ = read_records(logs, vehicle, model.with_effects(()), target_system)
    without = {r.name: r for r in bare}
    flights = []
    for r in records:
        if r.name in without:
            flights.append(predicted(r, without[r.name], model, frozen=frozen))
        if r.name not in without or flights[-1].seconds < LEAST_S:
            notes.append(f"left out: {r.name}: too short to judge after the first {LEARNING_S:.0f} s; try --frozen")
    flights = [f for f in flights if f.seconds >= LEAST_S]
    if not flights:
        raise LogError(f"{logs[0]}: too short to judge a model: {LEARNING_S + LEAST_S:.0f} s of flight are needed")
    if not model.effects:
        notes.append("the model has no adopted effects: with and without them is the same")
    notes += [f"{f.record.name}: the model was made from this log" for f in flights if f.learnt_from]
    return Prediction(tuple(flights), frozen, (*notes, *said))


def predicted(record: Record, bare: Record, model: FanSurrogate, *, frozen: bool) -> Predicted:
    """One flight by its record with the model's effects, and the one without them."""
    rows = record.valid & bare.valid
    residual = np.nan_to_num(record.residual)
    day = None
    if not frozen:
        day = learn_day(record, residual, model.effects, known_day(model))
        residual, rows = residual - day.wrench, rows & ~learning_time(record)
    return Predicted(record, np.nan_to_num(bare.residual), residual, rows, day, learnt_from(model, record.path))


def _errors(parts: Sequence[tuple[Predicted, Mask]]) -> dict[str, AxisError]:
    """By axis over the samples of all parts that judge it."""
    out = {}
    for axis in range(6):
        judged = [(f, rows) for f, rows in parts if axis in f.record.axes and rows.any()]
        if not judged:
            continue
        without, with_effects = (
            np.concatenate([r[rows, axis] for r, rows in part])
            for part in ([(f.without, m) for f, m in judged], [(f.with_effects, m) for f, m in judged])
        )
        rms, low, high = rms_interval(with_effects, judged[0][0].record.step_s)
        out[AXES[axis]] = AxisError(float(np.sqrt((without**2).mean())), rms, (low, high))
    return out


def _json(errors: Mapping[str, AxisError]) -> dict[str, Any]:
    return {
        axis: {
            "rms_without": e.without,
            "rms_with": e.with_effects,
            "interval": e.interval,
            "unit": UNITS[AXES.index(axis)],
        }
        for axis, e in errors.items()
    }


def _lines(errors: Mapping[str, AxisError]) -> list[str]:
    return [
        f"  {axis:3s} {e.without:8.3g} -> {e.with_effects:8.3g} {UNITS[AXES.index(axis)]} "
        f"[{e.interval[0]:.3g}, {e.interval[1]:.3g}]"
        for axis, e in errors.items()
    ]
