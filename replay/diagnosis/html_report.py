"""The answer of ``replay diagnose`` as one HTML page for a pilot: what was found, how sure, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.effects import get
from models.frames import AXES
from models.vehicle import Vehicle
from replay.diagnosis.answer import UNITS, Diagnosis
from replay.diagnosis.interval import rms_interval
from replay.diagnosis.next_step import capital, certainty, finding, next_step, size_words
from replay.diagnosis.pictures import EffectWrench, against, effect_picture, effect_wrench, phases, series, without
from replay.diagnosis.words import AXIS_WORDS, channel_words, kept_words, listed, plain, rough, unit_words
from replay.report import render

_UNCHANGED = 0.02
"""A change of an axis below this share is not mentioned."""


def page(answer: Diagnosis, vehicle: Vehicle, model_faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The whole page. ``model_faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    step = next_step(answer, model_faults)
    wrenches = [effect_wrench(n, answer.traces) for n in answer.named]
    first = next((c for c in answer.channels if all(c.name in r.channels for r in answer.records)), None)
    return render(
        "diagnosis.html",
        answer=answer,
        vehicle=vehicle,
        head=finding(answer, model_faults),
        verdict=step.verdict,
        sentences=[f"Next: {step.action}", *step.reasons],
        bad=step.bad,
        effects=[
            (n, size_words(n, answer), _error_words(n.found.axes, a, vehicle), effect_picture(n, a) if a else "")
            for n, a in zip(answer.named, wrenches, strict=True)
        ],
        axes=[
            (AXIS_WORDS[i], AXES[i], UNITS[i], _pooled(answer, i, after=False), _pooled(answer, i, after=True))
            for i in range(6)
            if any(i in r.axes for r in answer.records)
        ],
        carriers=[(channel_words(c.name), c.axis, f"{c.score:.0%}") for c in answer.channels],
        remainder="" if first is None else "".join(against(t, first) for t in answer.traces),
        outside=[
            f"{t.record.name}: {o.rms:.2g} {UNITS[AXES.index(o.axis)]} in {o.axis}, "
            + (", ".join(f"{s:.0f} to {e:.0f} s" for s, e in o.intervals_s) or "all the time")
            for t in answer.traces
            for o in t.outside
        ],
        idle=[(plain(r.name), get(r.name).excite) for r in answer.rejected if not r.excited],
        pictures=[
            (t.record.name, series(t.record, {"before": t.before, "after": t.after}, phases(t.record)))
            for t in answer.traces
        ],
        places=[
            (f"{t.record.name}, {r.name}", f"{r.seconds:.0f} s", axis, f"{r.before[axis]:.3f}", f"{r.after[axis]:.3f}")
            for t in answer.traces
            for r in t.regimes
            for axis in r.before
        ],
        rejected=[(plain(r.name), "no" if r.excited else "not excited", r.reason) for r in answer.rejected],
        basis=_basis(answer),
        capital=capital,
        certainty=certainty,
        get=get,
        kept_words=kept_words,
        listed=listed,
        plain=plain,
        unit_words=unit_words,
    )


def _pooled(answer: Diagnosis, axis: int, *, after: bool) -> tuple[float, float, float]:
    """RMS of one axis over the flights that judge it, with its interval."""
    judged = [t for t in answer.traces if axis in t.record.axes]
    parts = [(t.after if after else t.before)[t.record.valid, axis] for t in judged]
    return rms_interval(np.concatenate(parts), judged[0].record.step_s)


def _error_words(axes: Sequence[str], a: EffectWrench | None, vehicle: Vehicle) -> list[str]:
    """What the effect does to the error: newtons and acceleration, newton metres and angular acceleration."""
    out = []
    for axis, bare, with_it in [] if a is None else without(axes, a):
        if abs(bare - with_it) < _UNCHANGED * max(bare, with_it):
            continue
        scale, unit = (vehicle.mass_kg, "m/s²") if axis < 3 else (vehicle.inertia_kgm2[axis - 3], "rad/s²")
        out.append(
            f"Error of the {AXIS_WORDS[axis]}: {rough(bare)} {UNITS[axis]} ({rough(bare / scale)} {unit}) without it, "
            f"{rough(with_it)} {UNITS[axis]} ({rough(with_it / scale)} {unit}) with it."
        )
    return out


def _basis(answer: Diagnosis) -> list[str]:
    lines = [
        f"{r.name}: {d.signal} {abs(d.seconds) * 1e3:.0f} ms {'late' if d.seconds > 0 else 'early'} "
        f"(correlation {d.correlation:.2f}, {'corrected' if d.corrected else 'not corrected'})"
        for r in answer.records
        for d in r.delays
    ]
    lines += [f"{r.name}: {e.seconds:.1f} s left out, {e.reason}" for r in answer.records for e in r.excluded]
    return [*lines, *answer.notes]
