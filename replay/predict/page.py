"""The answer of ``replay predict`` as one HTML page: errors by axis and regime, measured and predicted over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from models.frames import AXES
from models.pages.document import document, items, table, verdict
from models.pages.svg import Band, Line, figure, keys
from models.vehicle import Vehicle
from replay.diagnosis.answer import UNITS
from replay.diagnosis.pictures import envelope
from replay.diagnosis.words import AXIS_WORDS
from replay.predict.day import LEARNING_S
from replay.predict.predict import AxisError, Predicted, Prediction


def page(answer: Prediction, vehicle: Vehicle, faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The whole page. ``faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    errors = answer.axes()
    worse = [AXIS_WORDS[AXES.index(a)] for a, e in errors.items() if e.interval[0] > e.without]
    head = f"The adopted effects make this worse: {', '.join(worse)}" if worse else _gain(errors)
    how = (
        "Nothing was fitted on these flights."
        if answer.frozen
        else f"Wind, load and accelerometer offset were learned from the first {LEARNING_S:.0f} s of each "
        "flight, and the rest is judged."
    )
    wrong = [f"{f['channel']}: {f['what']}." for f in faults]
    seconds = sum(f.seconds for f in answer.flights)
    return document(
        f"{vehicle.name}: {head}",
        [
            f"<h1>{escape(head)}</h1>",
            verdict(f"{vehicle.name}: the model on other flights", [how, *wrong], bad=bool(worse or faults)),
            f'<p class="dim">{escape(", ".join(f.record.name for f in answer.flights))}: {seconds:.0f} s judged.</p>',
            "<h2>Error of the model</h2>",
            "<p>RMS of measured minus modelled force and moment, with its 95 % interval.</p>",
            table(_HEAD, [_row("", axis, e) for axis, e in errors.items()], numbers=(2, 3)),
            "<h2>By regime</h2>",
            table(
                _HEAD,
                [
                    _row(f"{name} ({lasted:.0f} s)", axis, e)
                    for name, (lasted, by_axis) in answer.regimes().items()
                    for axis, e in by_axis.items()
                ],
                numbers=(2, 3),
            ),
            "<h2>Measured and predicted over time</h2>",
            *(_over_time(f) for f in answer.flights),
            *(["<h2>Notes</h2>", items(answer.notes)] if answer.notes else []),
        ],
    )


_HEAD = ("where", "axis", "without the effects", "with them")


def _gain(errors: Mapping[str, AxisError]) -> str:
    ratio = np.exp(np.mean([np.log(max(e.with_effects, 1e-12) / max(e.without, 1e-12)) for e in errors.values()]))
    return f"The adopted effects leave {ratio:.0%} of the error (geometric mean over the axes)"


def _row(where: str, axis: str, e: AxisError) -> list[str]:
    a = AXES.index(axis)
    low, high = e.interval
    label = f'{AXIS_WORDS[a]}<br><span class="dim small">{axis} [{UNITS[a]}]</span>'
    interval = f'<br><span class="dim small">[{low:.3g}, {high:.3g}]</span>'
    return [escape(where), label, f"{e.without:.3g}", f"{e.with_effects:.3g}{interval}"]


def _over_time(f: Predicted) -> str:
    """What acts beside the model without effects, as measured, and what the effects say of it."""
    t, valid = f.record.time_s, f.record.valid
    learnt = valid & ~f.rows
    bands = [Band(float(t[learnt][0]), float(t[learnt][-1]), "d", "wind and load learned here")] if learnt.any() else []
    lines: list[Line] = []
    out = []
    for axis in f.record.axes:
        predicted = f.without[:, axis] - f.with_effects[:, axis]
        lines = [
            Line(*envelope(t, np.where(valid, y, np.nan)), kind, label)
            for y, kind, label in ((f.without[:, axis], "before", "measured"), (predicted, "after", "predicted"))
        ]
        title = f"{AXES[axis]}, {AXIS_WORDS[axis]}, beside the model without effects"
        out.append(figure(title, lines, "time since boot [s]", f"[{UNITS[axis]}]", bands, keyed=False))
    head = f'<h3>{escape(f.record.name)}</h3><p class="keys">{keys(lines, bands)}</p>'
    return f'{head}<div class="plots">{"".join(out)}</div>'
