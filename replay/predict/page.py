"""The answer of ``replay predict`` as one HTML page: errors by axis and regime, measured and predicted over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.frames import AXES
from models.pages.svg import Band
from models.vehicle import Vehicle
from replay.diagnosis.answer import UNITS
from replay.diagnosis.pictures import series
from replay.diagnosis.words import AXIS_WORDS
from replay.predict.day import LEARNING_S
from replay.predict.predict import AxisError, Predicted, Prediction
from replay.report import render


def page(answer: Prediction, vehicle: Vehicle, faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The whole page. ``faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    errors = answer.axes()
    words, units = dict(zip(AXES, AXIS_WORDS, strict=True)), dict(zip(AXES, UNITS, strict=True))
    worse = [words[a] for a, e in errors.items() if e.interval[0] > e.without]
    how = (
        "Nothing was fitted on these flights."
        if answer.frozen
        else f"Wind, load and accelerometer offset were learned from the first {LEARNING_S:.0f} s of each "
        "flight, and the rest is judged."
    )
    return render(
        "prediction.html",
        answer=answer,
        vehicle=vehicle,
        head=f"The adopted effects make this worse: {', '.join(worse)}" if worse else _gain(errors),
        verdict=f"{vehicle.name}: the model on other flights",
        sentences=[how, *(f"{f['channel']}: {f['what']}." for f in faults)],
        bad=bool(worse or faults),
        words=words,
        units=units,
        pictures=[(f.record.name, _over_time(f)) for f in answer.flights],
    )


def _gain(errors: Mapping[str, AxisError]) -> str:
    ratio = np.exp(np.mean([np.log(max(e.with_effects, 1e-12) / max(e.without, 1e-12)) for e in errors.values()]))
    return f"The adopted effects leave {ratio:.0%} of the error (geometric mean over the axes)"


def _over_time(f: Predicted) -> str:
    """What acts beside the model without effects, as measured, and what the effects say of it."""
    t, learnt = f.record.time_s, f.record.valid & ~f.rows
    bands = [Band(float(t[learnt][0]), float(t[learnt][-1]), "d", "wind and load learned here")] if learnt.any() else []
    return series(f.record, {"measured": f.without, "predicted": f.without - f.with_effects}, bands)
