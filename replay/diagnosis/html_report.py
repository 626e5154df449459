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
    carrier_words,
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
        axes=_axis_rows(answer),
        carriers=[
            (carrier_words(c, channel_words(c.name)), c.axis, f"{c.score:.0%}")
            for c in answer.channels
        ],
        remainder=_remainder(answer),
        outside=_outside_lines(answer),
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


Measured = tuple[float, float, float]
"""An RMS and its interval."""


def _axis_rows(answer: Diagnosis) -> list[tuple[str, str, str, Measured, Measured]]:
    """Of every judged axis its words, name and unit, and what was left before and after."""
    rows = []
    judged = set[int]()
    for record in answer.records:
        judged.update(record.axes)
    for axis in sorted(judged):
        _, unit = answer.unit(axis)
        before = _pooled(answer, axis, after=False)
        after = _pooled(answer, axis, after=True)
        rows.append((AXIS_WORDS[axis], AXES[axis], unit_words(unit), before, after))
    return rows


def _remainder(answer: Diagnosis) -> str:
    """Pictures of the first channel that carries what is left, where every flight has it."""
    for channel in answer.channels:
        if all(channel.name in record.channels for record in answer.records):
            return "".join(against(trace, channel) for trace in answer.traces)
    return ""


def _outside_lines(answer: Diagnosis) -> list[str]:
    lines = []
    for trace in answer.traces:
        for outside in trace.outside:
            lines.append(f"{trace.record.name}: {answer.outside_words(outside)}")
    return lines


def _pooled(answer: Diagnosis, axis: int, *, after: bool) -> Measured:
    """RMS of one axis over the flights that judge it, with its interval."""
    judged = [t for t in answer.traces if axis in t.record.axes]
    factor, _ = answer.unit(axis)
    parts = []
    for t in judged:
        parts.append((t.after if after else t.before)[t.record.valid, axis] * factor)
    return rms_interval(np.concatenate(parts), judged[0].record.step_s)
