"""What a diagnosis says: as numbers, as JSON (docs/formats.md) and as a few lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from models.effects import AdoptedEffect, BelongsTo, InFlight
from models.frames import AXES, GRAVITY, Array
from replay.diagnosis.amended_model import to_adopt
from replay.diagnosis.words import estimate_text, kept_words
from replay.flightlog import LogFault
from replay.numbers import rounded
from replay.residual.record import Record
from replay.search.curves import CarryingChannel
from replay.search.outside import Outside
from replay.search.results import Found, Searched, corrected_together
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

    @property
    def records(self) -> list[Record]:
        """The flights."""
        return [t.record for t in self.traces]

    def rms(self, *, after: bool) -> Array:
        """RMS per axis on held-out time of all flights, (6,); NaN where no flight could judge the axis."""
        energy, count = np.zeros(6), np.zeros(6)
        for t in self.traces:
            r = (t.after if after else t.before)[t.record.valid]
            judged = np.isin(np.arange(6), t.record.axes)
            energy += np.where(judged, (r**2).sum(axis=0), 0.0)
            count += np.where(judged, len(r), 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(energy / count))

    @property
    def adopted(self) -> tuple[AdoptedEffect, ...]:
        """The named effects with the sizes that another flight may be predicted by.

        A map of surfaces and the laws that it corrects stay as found: only their sum is known well.
        """
        one_wind = len(self.records) == 1 and any(f.effect.belongs_to is BelongsTo.WEATHER for f in self.found)
        joint = corrected_together(f.effect for f in self.found)
        return tuple(
            self._as_found(f)
            if f.effect.name in joint
            else to_adopt(f.effect, f.estimates, self.records[f.flight].context, f.without, one_wind=one_wind)
            for f in self.found
        )

    def _as_found(self, found: Found) -> AdoptedEffect:
        coverage = found.effect.in_flight.coverage
        seen = {} if coverage is None else coverage([r.context for r in self.records])
        return AdoptedEffect(found.effect.name, found.parameters | dict(seen))

    @property
    def aliases(self) -> list[list[str]]:
        """Effects that look the same on these flights, each list led by the one that is named."""
        return [[f.effect.name, *f.aliases] for f in self.found if f.aliases]

    def as_json(self, model: str | None) -> dict[str, Any]:
        """The JSON that docs/formats.md describes."""
        before, after = self.rms(after=False), self.rms(after=True)
        judged = [i for i in range(6) if np.isfinite(before[i])]
        content: dict[str, Any] = rounded(
            {
                "logs": list(dict.fromkeys(str(r.path) for r in self.records)),
                "source": {r.name: sources_json(r.sources) for r in self.records},
                "samples": int(sum(r.valid.sum() for r in self.records)),
                "duration_s": sum(r.seconds for r in self.records),
                "verdict": self.verdict,
                "axes": {
                    AXES[i]: {"rms_before": before[i], "rms_after": after[i], "unit": UNITS[i]}
                    | _of_weight([before[i], after[i]], UNITS[i], self)
                    for i in judged
                },
                "effects": [_effect(f, self) for f in self.found],
                "aliases": self.aliases,
                "unexplained": {
                    "rms": {AXES[i]: after[i] for i in judged},
                    "channels": [{"name": c.name, "score": c.score, "axes": [c.axis]} for c in self.channels],
                },
                "outside": [{"log": t.record.name, **_outside(o)} for t in self.traces for o in t.outside],
                "regimes": [{"log": t.record.name, **r} for t in self.traces for r in t.regimes],
                "log_faults": [f.as_json() for f in self.faults],
                "model": model,
                "could_have_seen": [
                    {"what": v.what, "axes": v.axes, "least": v.least, "unit": v.unit, "parameter": v.coefficient}
                    for v in self.visible
                ],
                "rejected": [asdict(r) for r in self.rejected],
                "delays": [{"log": r.name, **asdict(d)} for r in self.records for d in r.delays],
                "excluded": [{"log": r.name, **asdict(e)} for r in self.records for e in r.excluded],
                "notes": self.notes,
            }
        )
        return content

    def as_text(self) -> str:
        """A few lines for a person."""
        before, after = self.rms(after=False), self.rms(after=True)
        seconds = sum(r.seconds for r in self.records)
        lines = [f"{self.verdict.replace('_', ' ')}  ({seconds:.0f} s of flight judged)"]
        lines += [f"  fault of the log: {f.channel} {f.what}" for f in self.faults]
        lines += [
            f"  {name:3s} {b:8.3f} -> {a:8.3f} {unit}{_share_text([b, a], unit, self)}"
            for name, b, a, unit in zip(AXES, before, after, UNITS, strict=True)
            if np.isfinite(b)
        ]
        lines += [text for f in self.found for text in _effect_text(f, self)]
        lines += [f"  unexplained in {c.axis}: {c.name}" for c in self.channels]
        lines += [f"  {outside_text(o)}" for t in self.traces for o in t.outside]
        lines += self._judged()
        notes = [*self.notes, *self._read_from()]
        return "\n".join([*lines, *(f"  note: {note}" for note in notes)])

    def _judged(self) -> list[str]:
        """Which axes were judged, and from which size on what was not found would have been."""
        axes = [name for name, rms in zip(AXES, self.rms(after=False), strict=True) if np.isfinite(rms)]
        unjudged = [name for name in AXES if name not in axes]
        lines = [f"  judged: {', '.join(axes) or 'nothing'}; not judged: {', '.join(unjudged) or 'nothing'}"]
        seen = [f"{v.what} ({v.coefficient} {v.least:.2g} {v.unit})" for v in self.visible]
        if seen:
            lines.append(f"  would have been named from this size on: {', '.join(seen)}")
        return lines

    def _read_from(self) -> list[str]:
        """A note for every quantity that a flight held several times."""
        notes = [f"{r.name}: {note}" for r in self.records for note in source_notes(r.sources)]
        return list(dict.fromkeys(notes))


def rms_interval(residual: Array, step_s: float) -> tuple[float, float, float]:
    """RMS of (n,) with its 95 % interval from a bootstrap over blocks of ``BLOCK_S``.

    Künsch 1989, Annals of Statistics 17, 1217.
    """
    square = residual**2
    parts = np.array_split(square, max(len(square) // max(round(BLOCK_S / step_s), 1), 2))
    sums, counts = np.array([p.sum() for p in parts]), np.array([len(p) for p in parts])
    pick = np.random.default_rng(0).integers(0, len(parts), (_DRAWS, len(parts)))
    draws = np.sqrt(sums[pick].sum(1) / np.maximum(counts[pick].sum(1), 1))
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(np.sqrt(square.mean())), float(low), float(high)


def _of_weight(values: Sequence[float], unit: str, answer: Diagnosis) -> dict[str, list[float]]:
    """The same sizes in shares of the weight, where the mass is assumed: these do not depend on it."""
    weights = {"N": GRAVITY, "kg": 1.0}
    vehicle = answer.records[0].context.vehicle if answer.records else None
    if vehicle is None or "mass_kg" not in vehicle.assumed or unit not in weights:
        return {}
    return {"of_weight": [v / (vehicle.mass_kg * weights[unit]) for v in values]}


def _share_text(values: Sequence[float], unit: str, answer: Diagnosis) -> str:
    shares = _of_weight(values, unit, answer).get("of_weight", [])
    return f" ({' -> '.join(f'{s:.2%}' for s in shares)} of the weight)" if shares else ""


def _outside(o: Outside) -> dict[str, Any]:
    out = {"axes": [o.axis], "rms": o.rms, "unit": UNITS[AXES.index(o.axis)], "intervals_s": o.intervals_s}
    return out | ({"regime": o.regime} if o.regime else {})


def _effect(f: Found, answer: Diagnosis) -> dict[str, Any]:
    out = {
        "name": f.effect.name,
        "axes": f.axes,
        "parameters": {e.name: e.as_json() | _of_weight([e.value], e.unit, answer) for e in f.estimates},
        "explains": f.explains,
        "q_value": 1.0 - f.probability,
        "probability": f.probability,
        "channels": f.effect.channels,
        "status": f.status,
        "belongs_to": f.effect.belongs_to.value,
        "kept": f.effect.kept,
        "equation": f.effect.equation,
        "sign": f.effect.sign,
    }
    if f.without:
        out["without"] = f.without
    if len(answer.traces) > 1:
        out["flights"] = {answer.traces[i].record.name: parameters for i, parameters in f.of_flight.items()}
    return out


def _effect_text(f: Found, answer: Diagnosis) -> list[str]:
    if f.effect.mixing is not None and f.effect.shown.in_words is not None:  # too many numbers to read
        numbers = f.effect.shown.in_words(answer.records[f.flight].context, f.parameters)
    else:
        numbers = (
            ", ".join(estimate_text(e) + _share_text([e.value], e.unit, answer) for e in f.estimates if e.determined)
            or "size not determined"
        )
    sure = f"{f.status}, probability {f.probability:.2f}"
    flown = "" if f.effect.in_flight.use is InFlight.WRENCH else f"; {f.effect.in_flight.use.value}"
    lines = [
        f"  {f.effect.name} ({sure}): {numbers}; explains {f.explains:.0%}",
        f"    {kept_words(f.effect)}{flown}",
    ]
    if f.without:
        lines.append(f"    not on {', '.join(f.without)}: there it makes the error larger")
    if f.aliases:
        lines.append(f"    or {', '.join(f.aliases)}; to separate them: {f.effect.excite}")
    return lines


def outside_text(o: Outside) -> str:
    """What acts and follows no logged quantity: how large, and when."""
    when = ", ".join(f"{a:.0f}-{b:.0f} s" for a, b in o.intervals_s[:4]) or "all the time"
    unit = UNITS[AXES.index(o.axis)]
    if o.regime:
        return f"not explained: {o.axis} {o.rms:.3g} {unit} on average {WHERE[o.regime]}, {when}"
    return f"not explained, in no logged quantity: {o.axis} {o.rms:.3g} {unit}, {when}"
