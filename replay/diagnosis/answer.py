"""A diagnosis as JSON (docs/formats.md) and as a few lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from models.frames import AXES, GRAVITY
from replay.diagnosis.words import kept_words
from replay.search.free_curves import Channel
from replay.search.outside import Outside
from replay.search.results import Estimate, Trace

if TYPE_CHECKING:
    from replay.diagnosis.diagnose import Diagnosis, Named
    from replay.residual.record import Record

WHERE = {"low": "near the ground", "wall": "near the wall", "corner": "in the corner"}
UNITS = ("N", "N", "N", "N m", "N m", "N m")


def answer_json(answer: Diagnosis, model: str | None) -> dict[str, Any]:
    """The JSON that docs/formats.md describes."""
    before, after = answer.rms(after=False), answer.rms(after=True)
    judged = [i for i in range(6) if np.isfinite(before[i])]
    return {
        "logs": list(dict.fromkeys(str(r.path) for r in answer.records)),
        "samples": int(sum(r.valid.sum() for r in answer.records)),
        "duration_s": round(sum(r.seconds for r in answer.records), 3),
        "verdict": answer.verdict,
        "axes": {
            AXES[i]: _rms(before[i], after[i])
            | {"unit": UNITS[i]}
            | _of_weight([before[i], after[i]], UNITS[i], answer)
            for i in judged
        },
        "effects": [_effect(n, answer) for n in answer.named],
        "aliases": answer.aliases,
        "unexplained": {
            "rms": {AXES[i]: number(after[i]) for i in judged},
            "channels": [_channel(c) for c in answer.channels],
        },
        "outside": list(chain.from_iterable(map(_outside, answer.traces))),
        "regimes": list(chain.from_iterable(map(_regimes, answer.traces))),
        "log_faults": [{"channel": f.channel, "what": f.what} for f in answer.faults],
        "model": model,
        "rejected": [{"name": r.name, "reason": r.reason, "excited": r.excited, "p": r.p} for r in answer.rejected],
        "noise": _noise(answer.traces[0]) if answer.traces else {},
        "delays": list(chain.from_iterable(map(_delays, answer.records))),
        "excluded": list(chain.from_iterable(map(_excluded, answer.records))),
        "notes": list(answer.notes),
    }


def _rms(before: float, after: float) -> dict[str, Any]:
    return {"rms_before": number(before), "rms_after": number(after)}


def _of_weight(values: Sequence[float], unit: str, answer: Diagnosis) -> dict[str, list[float]]:
    """The same sizes in shares of the weight, where the mass is assumed: these do not depend on it."""
    weights = {"N": GRAVITY, "kg": 1.0}
    vehicle = answer.records[0].context.vehicle if answer.records else None
    if vehicle is None or "mass_kg" not in vehicle.assumed or unit not in weights:
        return {}
    return {"of_weight": [number(v / (vehicle.mass_kg * weights[unit])) for v in values]}


def _excluded(r: Record) -> list[dict[str, Any]]:
    return [{"log": r.name, "reason": e.reason, "seconds": number(e.seconds)} for e in r.excluded]


def _outside(t: Trace) -> list[dict[str, Any]]:
    return [
        {
            "log": t.record.name,
            "axes": [o.axis],
            "rms": number(o.rms),
            "unit": UNITS[AXES.index(o.axis)],
            "intervals_s": [[number(a), number(b)] for a, b in o.intervals_s],
        }
        | ({"regime": o.regime} if o.regime else {})
        for o in t.outside
    ]


def _regimes(t: Trace) -> list[dict[str, Any]]:
    return [
        {
            "log": t.record.name,
            "regime": r.name,
            "seconds": number(r.seconds),
            "axes": {a: _rms(r.before[a], r.after[a]) for a in r.before},
        }
        for r in t.regimes
    ]


def _noise(t: Trace) -> dict[str, Any]:
    return {
        AXES[a]: {"rms": number(t.noise.total[k]), "correlation_s": number(t.noise.tau_s[k])}
        for k, a in enumerate(t.record.axes)
    }


def _delays(r: Record) -> list[dict[str, Any]]:
    return [
        {
            "log": r.name,
            "signal": d.signal,
            "seconds": number(d.seconds),
            "correlation": number(d.correlation),
            "corrected": d.corrected,
        }
        for d in r.delays
    ]


def answer_text(answer: Diagnosis) -> str:
    """A few lines for a person."""
    before, after = answer.rms(after=False), answer.rms(after=True)
    seconds = sum(r.seconds for r in answer.records)
    lines = [f"{answer.verdict.replace('_', ' ')}  ({seconds:.0f} s of flight judged)"]
    lines += [f"  the log is not to be believed: {f.channel} {f.what}" for f in answer.faults]
    lines += [
        f"  {name:3s} {b:8.3f} -> {a:8.3f} {unit}{_share_text([b, a], unit, answer)}"
        for name, b, a, unit in zip(AXES, before, after, UNITS, strict=True)
        if np.isfinite(b)
    ]
    lines += [text for n in answer.named for text in _effect_text(n, answer)]
    lines += [
        f"  unexplained in {c.axis}: {c.name}" + (f" at {c.peak_hz:.2f} Hz" if c.peak_hz else "")
        for c in answer.channels
    ]
    lines += [_outside_text(o) for t in answer.traces for o in t.outside]
    return "\n".join([*lines, *(f"  note: {note}" for note in answer.notes)])


def _effect_text(n: Named, answer: Diagnosis) -> list[str]:
    f = n.found
    if f.effect.mixing is not None and f.effect.in_words is not None:  # too many numbers to read
        numbers = f.effect.in_words(answer.records[n.record].context, f.parameters)
    else:
        numbers = (
            ", ".join(_estimate_text(e) + _share_text([e.value], e.unit, answer) for e in f.estimates if e.determined)
            or "size not determined"
        )
    sure = f"{n.status}, probability {f.probability:.2f}"
    lines = [
        f"  {f.effect.name} ({sure}): {numbers}; explains {n.explains:.0%}",
        f"    {kept_words(f.effect)}",
    ]
    if f.aliases:
        lines.append(f"    or {', '.join(f.aliases)}; to separate them: {f.effect.excite}")
    return lines


def _outside_text(o: Outside) -> str:
    when = ", ".join(f"{a:.0f}-{b:.0f} s" for a, b in o.intervals_s[:4]) or "all along"
    unit = UNITS[AXES.index(o.axis)]
    if o.regime:
        return f"  not explained: {o.axis} {o.rms:.3g} {unit} on average {WHERE[o.regime]}, {when}"
    return f"  something acts that the log does not record: {o.axis} {o.rms:.3g} {unit}, {when}"


def number(x: float) -> float:
    """Rounded to six digits, more than a log can give; 0 where there is none."""
    return float(f"{float(x):.6g}") if np.isfinite(x) else 0.0


def _effect(n: Named, answer: Diagnosis) -> dict[str, Any]:
    f = n.found
    out = {
        "name": f.effect.name,
        "axes": list(f.axes),
        "parameters": {e.name: _estimate(e) | _of_weight([e.value], e.unit, answer) for e in f.estimates},
        "explains": number(n.explains),
        "q_value": number(1.0 - f.probability),
        "probability": number(f.probability),
        "channels": list(f.effect.channels),
        "status": n.status,
        "belongs_to": f.effect.belongs_to.value,
        "kept": f.effect.kept,
        "equation": f.effect.equation,
        "sign": f.effect.sign,
    }
    if len(answer.traces) > 1:
        names = [t.record.name for t in answer.traces]
        out["flights"] = {
            names[i]: {key: number(v) for key, v in parameters.items()} for i, parameters in n.of_flight.items()
        }
    return out


def _estimate(e: Estimate) -> dict[str, Any]:
    out = {"value": number(e.value), "ci95": [number(v) for v in e.ci95], "unit": e.unit}
    return out | ({"at_bound": True} if e.at_bound else {})


def _channel(c: Channel) -> dict[str, Any]:
    out: dict[str, Any] = {"name": c.name, "score": number(c.score), "axes": [c.axis]}
    if c.lag_s is not None:
        out["lag_s"] = number(c.lag_s)
    if c.peak_hz is not None:
        out["peak_hz"] = number(c.peak_hz)
    return out


def _share_text(values: Sequence[float], unit: str, answer: Diagnosis) -> str:
    shares = _of_weight(values, unit, answer).get("of_weight", [])
    return f" ({' -> '.join(f'{s:.2%}' for s in shares)} of the weight)" if shares else ""


def _estimate_text(e: Estimate) -> str:
    interval = f" [{e.ci95[0]:.3g}, {e.ci95[1]:.3g}]" if e.ci95[1] > e.ci95[0] else ""
    unit = "" if e.unit == "1" else f" {e.unit}"
    return f"{e.name} = {e.value:.3g}{interval}{unit}" + (" (at its bound)" if e.at_bound else "")
