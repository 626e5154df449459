"""The answer of ``replay diagnose`` as one HTML page for a pilot: what was found, how sure, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import AXES
from models.effects import get
from models.vehicle import Vehicle
from replay.diagnosis.answer import Diagnosis, rms_interval
from replay.diagnosis.next_step import certainty, next_step, size_words
from replay.diagnosis.pictures import against, effect_picture, series
from replay.diagnosis.words import (
    AXIS_WORDS,
    channel_words,
    class_text,
    explains_text,
    kept_words,
    listed,
    parameter_words,
    plain,
    size_text,
    unit_words,
)
from replay.report import render


def page(
    answer: Diagnosis, vehicle: Vehicle, model_faults: Sequence[Mapping[str, str]] = ()
) -> str:
    """The whole page. ``model_faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    step = next_step(answer, model_faults)
    first = next(
        (c for c in answer.channels if all(c.name in r.channels for r in answer.records)), None
    )
    return render(
        "diagnosis.html",
        answer=answer,
        vehicle=vehicle,
        head=step.verdict,
        verdict=f"Next: {step.action}",
        sentences=step.reasons,
        bad=step.bad,
        effects=[
            (f, size_words(f, answer), effect_picture(f, answer.traces)) for f in answer.found
        ],
        axes=[
            (
                AXIS_WORDS[i],
                AXES[i],
                unit_words(answer.unit(i)[1]),
                _pooled(answer, i, after=False),
                _pooled(answer, i, after=True),
            )
            for i in range(6)
            if any(i in r.axes for r in answer.records)
        ],
        carriers=[(channel_words(c.name), c.axis, f"{c.score:.0%}") for c in answer.channels],
        remainder="" if first is None else "".join(against(t, first) for t in answer.traces),
        outside=[
            f"{t.record.name}: {answer.outside_words(o)}" for t in answer.traces for o in t.outside
        ],
        pictures=[(t.record.name, series(t)) for t in answer.traces],
        certainty=certainty,
        class_text=class_text,
        explains_text=explains_text,
        size_text=size_text,
        get=get,
        kept_words=kept_words,
        listed=listed,
        parameter_words=parameter_words,
        plain=plain,
        unit_words=unit_words,
    )


def _pooled(answer: Diagnosis, axis: int, *, after: bool) -> tuple[float, float, float]:
    """RMS of one axis over the flights that judge it, with its interval."""
    judged = [t for t in answer.traces if axis in t.record.axes]
    factor, _ = answer.unit(axis)
    parts = []
    for t in judged:
        parts.append((t.after if after else t.before)[t.record.valid, axis] * factor)
    return rms_interval(np.concatenate(parts), judged[0].record.step_s)
