"""``replay predict --report``: the error of a model, and of its motion ahead, as one HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.pages.svg import Line, figure
from replay.predict.ahead import counted
from replay.predict.horizon import QUANTITIES, HorizonError, errors_ahead, worst_windows
from replay.predict.predict import Prediction
from replay.report import render

_CURVES = (
    ("naive", "nothing changes", "before"),
    ("declared", "declared model", "fit"),
    ("model", "with effects", "after"),
)


def page(answer: Prediction, model: str) -> str:
    """The whole page."""
    ahead = errors_ahead(answer.ahead)
    return render(
        "predict.html",
        head="How well the model holds",
        verdict="The error of the model on flights that it was not made from",
        sentences=[],
        seconds=sum(f.seconds for f in answer.flights),
        model=model,
        how=answer.how,
        axes=_axes(answer),
        plots=_plots(ahead),
        counted=counted(answer.ahead),
        ahead=_rows(ahead),
        worst=[
            (row["log"], f"{row['at_s']:.1f} s", f"{row['velocity']:.3g} m/s")
            for row in worst_windows(answer.ahead)
        ],
        notes=answer.notes,
    )


def _axes(answer: Prediction) -> list[tuple[str, str, str, str]]:
    rows = []
    for axis, error in answer.axes().items():
        low, high = error["interval"]
        unit = error["unit"]
        rows.append(
            (
                axis,
                f"{error['rms_without']:.3g} {unit}",
                f"{error['rms_with']:.3g} {unit}",
                f"{low:.3g} to {high:.3g}",
            )
        )
    return rows


def _plots(ahead: Mapping[str, Sequence[HorizonError]]) -> str:
    """Error over the time ahead, a plot for each quantity."""
    out = ""
    for quantity, errors in ahead.items():
        times = np.array([0.0, *(e.s for e in errors)])
        lines = []
        for key, label, kind in _CURVES:
            means = np.array([0.0, *(e.means[key] for e in errors)])
            lines.append(Line(times, means, kind, label))
        title = f"{quantity.capitalize()} [{QUANTITIES[quantity]}]"
        out += figure(title, lines, "time ahead [s]", QUANTITIES[quantity])
    return out


def _rows(ahead: Mapping[str, Sequence[HorizonError]]) -> list[tuple[str, ...]]:
    rows = []
    for quantity, errors in ahead.items():
        for error in errors:
            low, high = error.interval
            means = [f"{error.means[key]:.3g}" for key, _, _ in _CURVES]
            name = f"{quantity} [{QUANTITIES[quantity]}]"
            rows.append((name, f"{error.s:.2f} s", *means, f"{low:.3g} to {high:.3g}"))
    return rows
