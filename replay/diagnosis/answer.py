"""A diagnosis as JSON (docs/formats.md) and as a few lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from models.frames import AXES
from replay.search.free_curves import Channel
from replay.search.results import Estimate

if TYPE_CHECKING:
    from replay.diagnosis.diagnose import Diagnosis, Named

UNITS = ("N", "N", "N", "N m", "N m", "N m")


def answer_json(answer: Diagnosis, model: str | None) -> dict[str, Any]:
    """Contract, sections 6 and 7; ``status``, ``rejected``, ``delays``, ``excluded`` and ``notes`` are additions."""
    before, after = answer.rms(after=False), answer.rms(after=True)
    judged = [i for i in range(6) if np.isfinite(before[i])]
    return {
        "logs": list(dict.fromkeys(str(r.log.path) for r in answer.records)),
        "samples": int(sum(r.valid.sum() for r in answer.records)),
        "duration_s": round(sum(r.seconds for r in answer.records), 3),
        "verdict": answer.verdict,
        "axes": {
            AXES[i]: {"rms_before": number(before[i]), "rms_after": number(after[i]), "unit": UNITS[i]} for i in judged
        },
        "effects": [_effect(n, answer) for n in answer.named],
        "aliases": answer.aliases,
        "unexplained": {
            "rms": {AXES[i]: number(after[i]) for i in judged},
            "channels": [_channel(c) for c in answer.channels],
        },
        "outside": [
            {
                "log": t.record.name, "axes": [o.axis], "rms": number(o.rms), "unit": UNITS[AXES.index(o.axis)],
                "intervals_s": [[number(a), number(b)] for a, b in o.intervals_s],
            }
            for t in answer.traces
            for o in t.outside
        ],
        "regimes": [
            {
                "log": t.record.name, "regime": r.name, "seconds": number(r.seconds),
                "axes": {a: {"rms_before": number(r.before[a]), "rms_after": number(r.after[a])} for a in r.before},
            }
            for t in answer.traces
            for r in t.regimes
        ],
        "log_faults": [{"channel": f.channel, "what": f.what} for f in answer.faults],
        "model": model,
        "rejected": [
            {"name": r.name, "reason": r.reason, "excited": r.excited, "p": r.p} for r in answer.rejected
        ],
        "noise": {
            AXES[a]: {"rms": number(t.noise.total[k]), "correlation_s": number(t.noise.tau_s[k])}
            for t in answer.traces[:1]
            for k, a in enumerate(t.record.axes)
        },
        "delays": [
            {
                "log": r.name, "signal": d.signal, "seconds": number(d.seconds),
                "correlation": number(d.correlation), "corrected": d.corrected,
            }
            for r in answer.records
            for d in r.delays
        ],
        "excluded": [
            {"log": r.name, "reason": e.reason, "seconds": number(e.seconds)}
            for r in answer.records
            for e in r.excluded
        ],
        "notes": list(answer.notes),
    }  # fmt: skip


def answer_text(answer: Diagnosis) -> str:
    """A few lines for a person."""
    before, after = answer.rms(after=False), answer.rms(after=True)
    seconds = sum(r.seconds for r in answer.records)
    lines = [f"{answer.verdict.replace('_', ' ')}  ({seconds:.0f} s of flight judged)"]
    lines += [f"  the log is not to be believed: {f.channel} {f.what}" for f in answer.faults]
    for name, b, a, unit in zip(AXES, before, after, UNITS, strict=True):
        if np.isfinite(b):
            lines.append(f"  {name:3s} {b:8.3f} -> {a:8.3f} {unit}")
    for n in answer.named:
        f = n.found
        numbers = ", ".join(_estimate_text(e) for e in f.estimates)
        sure = f"{n.status}, probability {f.probability:.2f}"
        lines.append(f"  {f.effect.name} ({sure}): {numbers}; explains {n.explains:.0%}")
        if f.aliases:
            lines.append(f"    or {', '.join(f.aliases)}: to tell, {f.effect.excite}")
    for c in answer.channels:
        lines.append(f"  unexplained in {c.axis}: {c.name}" + (f" at {c.peak_hz:.2f} Hz" if c.peak_hz else ""))
    for t in answer.traces:
        for o in t.outside:
            when = ", ".join(f"{a:.0f}-{b:.0f} s" for a, b in o.intervals_s[:4]) or "all along"
            unit = UNITS[AXES.index(o.axis)]
            lines.append(f"  something acts that the log does not record: {o.axis} {o.rms:.3g} {unit}, {when}")
    return "\n".join([*lines, *(f"  note: {note}" for note in answer.notes)])


def number(x: float) -> float:
    """Six digits are more than a log can tell."""
    return float(f"{float(x):.6g}") if np.isfinite(x) else 0.0


def _effect(n: Named, answer: Diagnosis) -> dict[str, Any]:
    f = n.found
    out = {
        "name": f.effect.name,
        "axes": list(f.axes),
        "parameters": {e.name: _estimate(e) for e in f.estimates},
        "explains": number(n.explains),
        "q_value": number(1.0 - f.probability),
        "probability": number(f.probability),
        "channels": list(f.effect.channels),
        "status": n.status,
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


def _estimate_text(e: Estimate) -> str:
    interval = f" [{e.ci95[0]:.3g}, {e.ci95[1]:.3g}]" if e.ci95[1] > e.ci95[0] else ""
    return f"{e.name} = {e.value:.3g}{interval} {e.unit}" + (" (at its bound)" if e.at_bound else "")
