"""``replay predict`` as a function: the error of a model on flights that it was not made from, by axis and regime."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.common.errors import LogError
from models.common.frames import AXES, Array
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.diagnosis.amended_model import known_day, learnt_from
from replay.diagnosis.answer import UNITS, rms_interval
from replay.diagnosis.diagnose import read_records
from replay.flightlog import FlightLog
from replay.logs.formats import load
from replay.numbers import rounded
from replay.predict.ahead import ahead_as_json, ahead_as_text
from replay.predict.day import LEARNING_S, Day, learn_day, learning_time
from replay.predict.horizon import Foretold, foretell
from replay.predict.rollout import FlightModel
from replay.predict.windows import windows
from replay.residual.grid import Mask
from replay.residual.record import Record, fly_again
from replay.search.regimes import regimes

LEAST_S = 4.0
"""A regime, or what follows the learning of wind and load, has to last so long [s]."""
MOMENTS = (3, 4, 5)
"""Axes without which attitude and rates cannot be foretold."""
Errors = dict[str, dict[str, Any]]
"""By axis: RMS without the adopted effects and with them, its 95 % ``interval``, and the unit."""


@dataclass(frozen=True, kw_only=True)
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
class Prediction:
    """The error of a model on some flights."""

    flights: tuple[Predicted, ...]
    frozen: bool
    notes: tuple[str, ...]
    ahead: tuple[Foretold, ...] = ()
    """Motion ahead of measured states, where it was asked for."""

    def __repr__(self) -> str:
        seconds = sum(flight.seconds for flight in self.flights)
        return f"Prediction({len(self.flights)} flights, {seconds:.0f} s judged)"

    @property
    def records(self) -> list[Record]:
        """The flights."""
        return [f.record for f in self.flights]

    def axes(self) -> Errors:
        """Over all flights."""
        return _errors([(f, f.rows) for f in self.flights])

    def regimes(self) -> dict[str, tuple[float, Errors]]:
        """Regimes that last, with their seconds and errors by axis."""
        parts: dict[str, list[tuple[Predicted, Mask]]] = {}
        for f in self.flights:
            for name, mask in regimes(f.record).items():
                parts.setdefault(name, []).append((f, mask & f.rows))
        seconds = {
            name: sum(float(m.sum()) * f.record.step_s for f, m in part)
            for name, part in parts.items()
        }
        return {
            name: (seconds[name], _errors(part))
            for name, part in parts.items()
            if seconds[name] >= LEAST_S
        }

    def as_json(self, model: str | None) -> dict[str, Any]:
        """The JSON that docs/formats.md describes."""
        content: dict[str, Any] = rounded(
            {
                "logs": list(dict.fromkeys(str(r.path) for r in self.records)),
                "model": model,
                "frozen": self.frozen,
                "duration_s": sum(f.seconds for f in self.flights),
                "axes": self.axes(),
                "regimes": [
                    {"regime": name, "seconds": seconds, "axes": errors}
                    for name, (seconds, errors) in self.regimes().items()
                ],
                "flights": [
                    {
                        "log": f.record.name,
                        "seconds": f.seconds,
                        "learnt_from": f.learnt_from,
                        "axes": _errors([(f, f.rows)]),
                        "day": {} if f.day is None else f.day.as_json(),
                    }
                    for f in self.flights
                ],
                "notes": self.notes,
            }
        )
        if self.ahead:
            content |= rounded(ahead_as_json(self.ahead))
        return content

    @property
    def how(self) -> str:
        """What is fitted on the judged flights, in words."""
        if self.frozen:
            return "nothing is fitted"
        start = f"the first {LEARNING_S:.0f} s"
        return f"wind, load, drag and the sizes of the effects are learned from {start}"

    def as_text(self) -> str:
        """A few lines for a person."""
        seconds = sum(f.seconds for f in self.flights)
        lines = [
            f"error without -> with the adopted effects  ({seconds:.0f} s judged; {self.how})",
            *_lines(self.axes()),
        ]
        for name, (lasted, errors) in self.regimes().items():
            lines += [f"  {name} ({lasted:.0f} s)", *(f"  {line}" for line in _lines(errors))]
        if self.ahead:
            lines += ahead_as_text(self.ahead)
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])


def predict(
    paths: Sequence[Path],
    vehicle: Vehicle,
    model: FanSurrogate,
    *,
    frozen: bool = False,
    horizon_s: float | None = None,
    target_system: int | None = None,
    progress: Callable[[Sequence[Path]], Iterable[Path]] = lambda paths: paths,
) -> Prediction:
    """Residuals of flights with and without the effects that a model adopted; nothing of the vehicle is fitted.

    Without ``frozen`` the first ``LEARNING_S`` of each flight say what belongs to its day, and the rest is judged.
    ``horizon_s``: the motion is foretold, too, from every measured state so far ahead.
    """
    logs = list(dict.fromkeys(paths))
    if len(logs) == len(paths):
        notes = []
    else:
        notes = ["a log that was given twice is judged once"]
    records, said = read_records(progress(logs), vehicle, model, target_system)
    bare, said_bare = read_records(logs, vehicle, model.with_effects(()), target_system)
    without = {r.name: r for r in bare}
    made = [
        predicted(r, without[r.name], model, frozen=frozen) for r in records if r.name in without
    ]
    flights = [f for f in made if f.seconds >= LEAST_S]
    notes += [
        f"left out: {f.record.name}: too short to judge after the first {LEARNING_S:.0f} s; try "
        "--frozen"
        for f in made
        if f.seconds < LEAST_S
    ]
    if not flights:
        raise LogError(
            f"{logs[0]}: too short to judge a model: {LEARNING_S + LEAST_S:.0f} s of flight are "
            "needed"
        )
    if not model.effects:
        notes.append("the model has no adopted effects: with and without them is the same")
    notes += [
        f"{f.record.name}: the model was made from this log" for f in flights if f.learnt_from
    ]
    ahead: list[Foretold] = []
    if horizon_s is not None:
        ahead, unforetold = _ahead(flights, vehicle, model, horizon_s, target_system)
        notes += unforetold
    every_note = (*notes, *dict.fromkeys((*said, *said_bare)))
    return Prediction(tuple(flights), frozen, every_note, tuple(ahead))


def _ahead(
    flights: Sequence[Predicted],
    vehicle: Vehicle,
    model: FanSurrogate,
    horizon_s: float,
    target_system: int | None,
) -> tuple[list[Foretold], list[str]]:
    """Motion ahead on every flight, and why it is not told on some. Raises LogError where it is told on none."""
    declared = FlightModel(vehicle, model.with_effects(()))
    out = []
    problems = []
    for path in dict.fromkeys(f.record.path for f in flights):
        parts: list[FlightLog] = []
        for boot in load(path, target_system):
            parts += boot.stretches()
        for flight in flights:
            if flight.record.path == path:
                amended = FlightModel(vehicle, model, flight.day.effects() if flight.day else ())
                try:
                    flown = fly_again(_part_of(parts, flight), vehicle, model, model.effects)
                    cut = windows(flown, horizon_s, _begins_s(flight))
                except LogError as error:
                    problems.append(error)
                    continue
                turning = set(MOMENTS) <= set(flown.doubts.axes)
                name = flight.record.name
                out.append(foretell(name, flown, cut, declared, amended, turning=turning))
    if not out:
        raise problems[0]
    notes = [str(error) for error in problems]
    for f in out:
        if not f.turning:
            notes.append(
                f"{f.log}: moments cannot be judged: the measured attitude is used ahead, and only "
                "place and velocity are foretold"
            )
    return out, notes


def _part_of(parts: Sequence[FlightLog], flight: Predicted) -> FlightLog:
    """The stretch of a log that a flight was made of."""
    begins = float(flight.record.time_s[0])
    return next(p for p in reversed(parts) if p.start_s <= begins + flight.record.step_s)


def _begins_s(flight: Predicted) -> float:
    """From when on windows are cut: after what the day was learnt from."""
    if flight.day is None:
        return float(flight.record.time_s[0])
    return float(flight.record.time_s[learning_time(flight.record)][-1])


def predicted(record: Record, bare: Record, model: FanSurrogate, *, frozen: bool) -> Predicted:
    """One flight by its record with the model's effects, and the one without them."""
    rows = record.valid & bare.valid
    residual = np.nan_to_num(record.residual)
    day = None
    if not frozen:
        day = learn_day(record, residual, model.effects, known_day(model))
        residual = residual - day.wrench
        rows = rows & ~learning_time(record)
    return Predicted(
        record=record,
        without=np.nan_to_num(bare.residual),
        with_effects=residual,
        rows=rows,
        day=day,
        learnt_from=learnt_from(model, record.path),
    )


def _errors(parts: Sequence[tuple[Predicted, Mask]]) -> Errors:
    """Over the samples of all parts that judge an axis."""
    out = {}
    for axis, name in enumerate(AXES):
        judged = [(f, rows) for f, rows in parts if axis in f.record.axes and rows.any()]
        if judged:
            without = np.concatenate([f.without[rows, axis] for f, rows in judged])
            with_effects = np.concatenate([f.with_effects[rows, axis] for f, rows in judged])
            rms, *interval = rms_interval(with_effects, judged[0][0].record.step_s)
            out[name] = {
                "rms_without": float(np.sqrt((without**2).mean())),
                "rms_with": rms,
                "interval": interval,
                "unit": UNITS[axis],
            }
    return out


def _lines(errors: Errors) -> list[str]:
    return [
        f"  {axis:3s} {e['rms_without']:8.3g} -> {e['rms_with']:8.3g} {e['unit']} "
        f"[{e['interval'][0]:.3g}, {e['interval'][1]:.3g}]"
        for axis, e in errors.items()
    ]
