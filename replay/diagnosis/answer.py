"""What a diagnosis says: as numbers, as JSON (docs/formats.md) and as a few lines of text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from models.common.frames import AXES, Array
from models.effects import AdoptedEffect, InFlight
from models.effects.adopted_effect import FROM_S, UNTIL_S
from models.vehicle import Vehicle
from replay.diagnosis.amended_model import of_one_wind, to_adopt
from replay.diagnosis.motor_losses import loss_json, loss_text
from replay.diagnosis.weights import in_shares, least_in_shares, scale
from replay.diagnosis.words import (
    carrier_words,
    class_text,
    estimate_text,
    explains_text,
    kept_words,
    least_text,
    size_text,
    unit_words,
)
from replay.flightlog import LogFault
from replay.numbers import rounded
from replay.residual.record import Record
from replay.search.curves import CarryingChannel
from replay.search.estimates import IntervalEstimate
from replay.search.held_out import FlightFit
from replay.search.least_visible import Visible
from replay.search.pruning import corrected_together
from replay.search.remainder import Outside
from replay.search.results import Found, Searched
from replay.sources.choose import source_notes, sources_json

UNITS = ("N", "N", "N", "N m", "N m", "N m")
"""Of the axes."""
BLOCK_S = 3.0
"""Blocks of the bootstrap: longer than a residual hangs together [s]."""
_DRAWS = 400
"""Of the bootstrap: the ends of a 95 % interval are then sure to a fifth of its width."""
WHERE = {"low": "near the ground", "wall": "near the wall", "corner": "in the corner"}


@dataclass(frozen=True, kw_only=True)
class Diagnosis(Searched):
    """The answer to one question: what does the declared model lack on these flights?"""

    channels: tuple[CarryingChannel, ...]
    verdict: str
    notes: tuple[str, ...]
    faults: tuple[LogFault, ...] = ()

    def __repr__(self) -> str:
        names = ", ".join(found.effect.name for found in self.found) or "no effect"
        seconds = sum(record.seconds for record in self.records)
        verdict = self.verdict.replace("_", " ")
        return f"{type(self).__name__}({verdict}: {names}; {seconds:.0f} s judged)"

    @property
    def records(self) -> list[Record]:
        """The flights."""
        return [t.record for t in self.traces]

    @property
    def vehicle(self) -> Vehicle:
        """The one that flew."""
        return self.records[0].context.vehicle

    def unit(self, axis: int) -> tuple[float, str]:
        """Factor and unit in which sizes on an axis are said: without a known mass shares of the weight."""
        return scale(UNITS[axis], self.vehicle)

    def numbers_of(self, found: Found) -> tuple[IntervalEstimate, ...]:
        """The parameters of an effect as they are said; of what may begin, only times at which it does."""
        said = list(found.estimates)
        if found.effect.search.may_begin:
            said = [e for e in said if e.value or e.name not in (FROM_S, UNTIL_S)]
        return in_shares(said, self.vehicle)

    @property
    def motor_losses(self) -> tuple[LogFault, ...]:
        """Motors that fail in flight: effects that begin."""
        return tuple(fault for fault in self.faults if fault.loss is not None)

    @property
    def could_have_seen(self) -> tuple[Visible, ...]:
        """What was not found, and from which size on it would have been, as it is said."""
        return tuple(least_in_shares(one, self.vehicle) for one in self.visible)

    def rms(self, *, after: bool) -> Array:
        """RMS per axis on held-out time of all flights, (6,); NaN where no flight could judge the axis."""
        energy = np.zeros(6)
        count = np.zeros(6)
        for t in self.traces:
            r = (t.after if after else t.before)[t.record.valid]
            judged = np.isin(np.arange(6), t.record.axes)
            energy += np.where(judged, (r**2).sum(axis=0), 0.0)
            count += np.where(judged, len(r), 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(energy / count))

    @property
    def of_one_wind(self) -> float:
        """Share of a drag that was found which may be of the one wind of these flights."""
        wind = next((f for f in self.found if f.effect.name == "wind"), None)
        if wind is None or len(self.records) > 1:
            return 0.0
        record = self.records[0]
        own = np.hypot(*record.context.velocity[record.valid, :2].T)
        speed = float(np.sqrt(np.nanmean(own**2)))
        return of_one_wind(float(np.hypot(wind.numbers["north"], wind.numbers["east"])), speed)

    @property
    def adopted(self) -> tuple[AdoptedEffect, ...]:
        """The named effects with the sizes that another flight may be predicted by.

        A map of surfaces and the laws that it corrects stay as found: only their sum is known well. What ended in its
        flight is in no other.
        """
        joint = corrected_together(f.effect for f in self.found)
        out = []
        for found in self.found:
            if found.ended:
                continue
            if found.effect.name in joint:
                adopted = self._as_found(found)
            else:
                adopted = to_adopt(
                    found.effect,
                    found.fitted,
                    self.records[found.flight].context,
                    found.without,
                    doubt=self.of_one_wind,
                )
            out.append(adopted)
        return tuple(out)

    def _as_found(self, found: Found) -> AdoptedEffect:
        parameters = found.parameters
        coverage = found.effect.in_flight.coverage
        if coverage is not None:
            parameters |= coverage([r.context for r in self.records])
        adopted = AdoptedEffect(found.effect.name, parameters, found.without)
        # A map is of the model's own answer, which has no axes of the body.
        if found.effect.search.remainder:
            return replace(adopted, without=())
        return adopted

    @property
    def aliases(self) -> list[list[str]]:
        """Effects that look the same on these flights, each list led by the one that is named."""
        return [[f.effect.name, *f.aliases] for f in self.found if f.aliases]

    def as_json(self, model: str | None) -> dict[str, Any]:
        """The JSON that docs/formats.md describes."""
        axes = self._axes_json()
        outside = []
        regimes = []
        for t in self.traces:
            outside += _of_log(t.record, [_outside(o, self) for o in t.outside])
            regimes += _of_log(t.record, self.regimes(t))
        delays = []
        excluded = []
        for r in self.records:
            delays += _of_log(r, map(asdict, r.delays))
            excluded += _of_log(r, map(asdict, r.excluded))
        content: dict[str, Any] = rounded(
            {
                "logs": list(dict.fromkeys(str(r.path) for r in self.records)),
                "source": {r.name: sources_json(r.sources) for r in self.records},
                "identity": self._identity(),
                "samples": int(sum(r.valid.sum() for r in self.records)),
                "duration_s": sum(r.seconds for r in self.records),
                "verdict": self.verdict,
                "axes": axes,
                "effects": [
                    *(loss_json(fault) for fault in self.motor_losses),
                    *(_effect(f, self) for f in self.found),
                ],
                "aliases": self.aliases,
                "unexplained": {
                    "rms": {axis: error["rms_after"] for axis, error in axes.items()},
                    "channels": [_carrier(c) for c in self.channels],
                },
                "outside": outside,
                "regimes": regimes,
                "log_faults": [f.as_json() for f in self.faults],
                "model": model,
                "could_have_seen": [_visible(v) for v in self.could_have_seen],
                "left_out": self.left_out,
                "rejected": [asdict(r) for r in self.rejected],
                "delays": delays,
                "excluded": excluded,
                "notes": self.notes,
            }
        )
        return content

    def _axes_json(self) -> dict[str, dict[str, Any]]:
        """Error of every judged axis."""
        before = self._said_rms(after=False)
        after = self._said_rms(after=True)
        out = {}
        for i, axis in enumerate(AXES):
            if np.isfinite(before[i]):
                _, unit = self.unit(i)
                rms = {"rms_before": before[i], "rms_after": after[i], "unit": unit}
                out[axis] = rms | _of_weight([before[i], after[i]], unit)
        return out

    def _identity(self) -> dict[str, str]:
        """Which vehicle flew, by the first log that says it."""
        known = [r.identity for r in self.records if r.identity is not None]
        if known:
            return known[0].as_json()
        return {}

    def as_text(self) -> str:
        """A few lines for a person."""
        before = self._said_rms(after=False)
        after = self._said_rms(after=True)
        seconds = sum(r.seconds for r in self.records)
        lines = [f"{self.verdict.replace('_', ' ')}  ({seconds:.0f} s of flight judged)"]
        lines += [f"  fault of the log: {f.channel} {f.what}" for f in self.faults if not f.loss]
        for fault in self.motor_losses:
            lines += loss_text(fault)
        for i, axis in enumerate(AXES):
            if np.isfinite(before[i]):
                sizes = f"{size_text(before[i]):>8s} -> {size_text(after[i]):>8s}"
                lines.append(f"  {axis:3s} {sizes} {unit_words(self.unit(i)[1])}")
        for f in self.found:
            lines += _effect_text(f, self)
        lines += [f"  unexplained in {c.axis}: {carrier_words(c, c.name)}" for c in self.channels]
        for t in self.traces:
            lines += [f"  {self.outside_words(o)}" for o in t.outside]
        lines += self._judged()
        notes = [*self.notes, *self._read_from()]
        return "\n".join([*lines, *(f"  note: {note}" for note in notes)])

    def _said_rms(self, *, after: bool) -> Array:
        """RMS per axis (6,), as it is said."""
        factors = np.array([self.unit(axis)[0] for axis in range(6)])
        return np.asarray(self.rms(after=after) * factors)

    def regimes(self, trace: FlightFit) -> list[dict[str, Any]]:
        """Error of the parts of a flight, as it is said."""
        out = []
        for regime in trace.regimes:
            axes = {}
            for axis, rms in regime["axes"].items():
                factor, _ = self.unit(AXES.index(axis))
                axes[axis] = {name: value * factor for name, value in rms.items()}
            out.append(regime | {"axes": axes})
        return out

    def outside_words(self, o: Outside) -> str:
        """What acts and follows no logged quantity: how large, and when."""
        factor, unit = self.unit(AXES.index(o.axis))
        when = ", ".join(f"{a:.0f}-{b:.0f} s" for a, b in o.intervals_s[:4]) or "all the time"
        size = f"{o.axis} {o.rms * factor:.3g} {unit_words(unit)}"
        if o.regime:
            return f"not explained: {size} on average {WHERE[o.regime]}, {when}"
        if o.swing_hz is not None:
            size += f", swinging at {o.swing_hz:.2g} Hz"
        return f"not explained, in no logged quantity: {size}, {when}"

    def _judged(self) -> list[str]:
        """Which axes were judged, and from which size on what was not found would have been."""
        known = np.isfinite(self.rms(after=False))
        judged = ", ".join(np.array(AXES)[known]) or "nothing"
        unjudged = ", ".join(np.array(AXES)[~known]) or "nothing"
        lines = [f"  judged: {judged}; not judged: {unjudged}"]
        seen = [f"{v.what} ({least_text(v)})" for v in self.could_have_seen]
        if seen:
            lines.append(f"  would have been seen from this size on: {', '.join(seen)}")
        return lines

    def _read_from(self) -> list[str]:
        """A note for every quantity that a flight held several times."""
        notes: list[str] = []
        for r in self.records:
            notes += [f"{r.name}: {note}" for note in source_notes(r.sources)]
        return list(dict.fromkeys(notes))


def rms_interval(residual: Array, step_s: float) -> tuple[float, float, float]:
    """RMS of (n,) with its 95 % interval from a bootstrap over blocks of ``BLOCK_S``.

    Künsch 1989, Annals of Statistics 17, 1217.
    """
    square = residual**2
    parts = np.array_split(square, max(len(square) // max(round(BLOCK_S / step_s), 1), 2))
    sums = np.array([p.sum() for p in parts])
    counts = np.array([len(p) for p in parts])
    pick = np.random.default_rng(0).integers(0, len(parts), (_DRAWS, len(parts)))
    draws = np.sqrt(sums[pick].sum(1) / np.maximum(counts[pick].sum(1), 1))
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(np.sqrt(square.mean())), float(low), float(high)


def _of_log(record: Record, entries: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Entries with the log that they are of."""
    return [{"log": record.name, **entry} for entry in entries]


def _of_weight(values: Sequence[float], unit: str) -> dict[str, list[float]]:
    """A second key for shares of the weight, under which older answers gave them."""
    if unit == "weight":
        return {"of_weight": list(values)}
    return {}


def _parameter(e: IntervalEstimate) -> dict[str, Any]:
    if not e.determined:
        return e.as_json()
    return e.as_json() | _of_weight([e.value], e.unit)


def _carrier(c: CarryingChannel) -> dict[str, Any]:
    out: dict[str, Any] = {"name": c.name, "score": c.score, "axes": [c.axis]}
    if c.course is not None:
        out |= c.course.as_json()
    return out


def _outside(o: Outside, answer: Diagnosis) -> dict[str, Any]:
    factor, unit = answer.unit(AXES.index(o.axis))
    out = {"axes": [o.axis], "rms": o.rms * factor, "unit": unit, "intervals_s": o.intervals_s}
    if o.regime:
        out["regime"] = o.regime
    if o.swing_hz is not None:
        out["swing_hz"] = o.swing_hz
    return out


def _visible(v: Visible) -> dict[str, Any]:
    return {
        "what": v.what,
        "axes": v.axes,
        "least": v.least,
        "unit": v.unit,
        "parameter": v.coefficient,
    }


def _effect(f: Found, answer: Diagnosis) -> dict[str, Any]:
    out = {
        "name": f.effect.name,
        "axes": f.axes,
        "parameters": {e.name: _parameter(e) for e in answer.numbers_of(f)},
        "explains": f.explains,
        "q_value": 1.0 - f.probability,
        "probability": f.probability,
        "channels": f.effect.channels,
        "status": f.status,
        "belongs_to": f.effect.belongs_to.value,
        "kept": f.kept,
        "equation": f.effect.equation,
        "sign": f.effect.sign,
    }
    for key, time in (("since_s", FROM_S), ("until_s", UNTIL_S)):
        if f.parameters.get(time, 0.0) > 0.0:
            out[key] = f.parameters[time]
    if not f.told_from_zero:
        out["told_from_zero"] = False
    if f.without:
        out["without"] = f.without
    if f.members:
        out["members"] = [{"name": name, "probability": p} for name, p in f.members]
        out["decided_by"] = f.decided_by
    if len(answer.traces) > 1:
        out["flights"] = {
            answer.traces[i].record.name: _values(shown, answer)
            for i, shown in f.shown_of_flight.items()
        }
    return out


def _values(estimates: Sequence[IntervalEstimate], answer: Diagnosis) -> dict[str, float | None]:
    """Parameters without intervals."""
    out: dict[str, float | None] = {}
    for e in in_shares(estimates, answer.vehicle):
        out[e.name] = e.value if e.determined else None
    return out


def _effect_text(f: Found, answer: Diagnosis) -> list[str]:
    shown = f.effect.shown
    # Of a mixture there are too many numbers to read.
    if f.effect.mixing is not None and shown.in_words is not None:
        numbers = shown.in_words(answer.records[f.flight].context, f.numbers)
    else:
        numbers = ", ".join(map(estimate_text, answer.numbers_of(f)))
    names = [f.effect.name, *(name for name, _ in f.members if name != f.effect.name)]
    sure = f"{f.status}, probability {f.probability:.2f}"
    if f.effect.in_flight.use is InFlight.WRENCH:
        flown = ""
    else:
        flown = f"; {f.effect.in_flight.use.value}"
    lines = [
        f"  {' or '.join(names)} ({sure}): {numbers}; {explains_text(f.explains)}",
        f"    {kept_words(f.effect, ended=f.ended)}{flown}",
    ]
    if not f.told_from_zero:
        lines.append("    its size is not told from zero")
    if f.without:
        lines.append(f"    not on {', '.join(f.without)}: there it makes the error larger")
    if f.members:
        lines.append(f"    {class_text(f)}")
    elif f.aliases:
        lines.append(f"    or {', '.join(f.aliases)}; to separate them: {f.effect.excite}")
    return lines
