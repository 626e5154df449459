"""The answer of ``replay diagnose`` as one HTML page for a pilot: what was found, how sure, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.effects import get
from models.frames import AXES
from models.vehicle import Vehicle
from replay.diagnosis.answer import UNITS, Diagnosis, outside_text
from replay.diagnosis.interval import rms_interval
from replay.diagnosis.next_step import certainty, next_step, size_words
from replay.diagnosis.pictures import against, effect_picture, series
from replay.diagnosis.words import AXIS_WORDS, channel_words, kept_words, listed, plain, unit_words
from replay.report import render


def page(answer: Diagnosis, vehicle: Vehicle, model_faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The whole page. ``model_faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    step = next_step(answer, model_faults)
    first = next((c for c in answer.channels if all(c.name in r.channels for r in answer.records)), None)
    return render(
        "diagnosis.html",
        answer=answer,
        vehicle=vehicle,
        head=step.verdict,
        verdict=f"Next: {step.action}",
        sentences=step.reasons,
        bad=step.bad,
        effects=[(f, size_words(f, answer), effect_picture(f, answer.traces)) for f in answer.found],
        axes=[
            (AXIS_WORDS[i], AXES[i], UNITS[i], _pooled(answer, i, after=False), _pooled(answer, i, after=True))
            for i in range(6)
            if any(i in r.axes for r in answer.records)
        ],
        carriers=[(channel_words(c.name), c.axis, f"{c.score:.0%}") for c in answer.channels],
        remainder="" if first is None else "".join(against(t, first) for t in answer.traces),
        outside=[f"{t.record.name}: {outside_text(o)}" for t in answer.traces for o in t.outside],
        idle=[(plain(r.name), get(r.name).excite) for r in answer.rejected if not r.excited],
        pictures=[(t.record.name, series(t)) for t in answer.traces],
        places=[
            (f"{t.record.name}, {r['regime']}", f"{r['seconds']:.0f} s", axis, *(f"{x:.3f}" for x in rms.values()))
            for t in answer.traces
            for r in t.regimes
            for axis, rms in r["axes"].items()
        ],
        rejected=[(plain(r.name), "no" if r.excited else "not excited", r.reason) for r in answer.rejected],
        basis=_basis(answer),
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


def _basis(answer: Diagnosis) -> list[str]:
    lines = [
        f"{r.name}: {d.signal} {abs(d.seconds) * 1e3:.0f} ms {'late' if d.seconds > 0 else 'early'} "
        f"(correlation {d.correlation:.2f}, {'corrected' if d.corrected else 'not corrected'})"
        for r in answer.records
        for d in r.delays
    ]
    lines += [f"{r.name}: {e.seconds:.1f} s left out, {e.reason}" for r in answer.records for e in r.excluded]
    return [*lines, *answer.notes]
