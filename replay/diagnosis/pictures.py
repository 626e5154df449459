"""Pictures of a diagnosis: an effect over the quantity that drives it, and the error of the model over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.common.frames import AXES, Array
from models.common.pages.svg import Line, figure, keys
from models.effects import InFlight
from models.effects.pictures import over_time
from replay.diagnosis.answer import UNITS
from replay.diagnosis.weights import scale
from replay.diagnosis.words import AXIS_WORDS, channel_words
from replay.search.channel import hundredths
from replay.search.curves import CarryingChannel
from replay.search.held_out import FlightFit
from replay.search.remainder import INDEPENDENT_S
from replay.search.results import Found

BINS = 14
FEWEST_BINS = 3
"""Of a picture over a quantity."""
LEAST = 2.0
"""Independent samples of a bin, where there are enough."""
CURVE_POINTS = 40
PIXELS = 190
"""Columns of a time series; each shows its lowest and its highest value."""


def effect_picture(found: Found, traces: Sequence[FlightFit]) -> str:
    """What is left when this effect alone is taken out of the model, over its quantity, and the effect as fitted.

    On the flight that shows it best, along the axis on which it is strongest in hundredths of the weight; nothing where
    it corrects a measurement only.
    """
    t = traces[found.flight]
    effect = found.effect
    record = t.record
    wrench = np.nan_to_num(effect.wrench(record.context, found.of_flight[found.flight]))
    searched = effect.search.searched or AXES
    for a, axis in enumerate(AXES):
        if a not in record.axes or axis not in searched:
            wrench[:, a] = 0.0
    rms = np.sqrt((wrench[record.valid] ** 2).mean(axis=0))
    if not rms.any():
        return ""
    strongest = int(np.argmax(rms / hundredths(record.context)))
    axis = AXES[strongest]
    drawn = (effect.shown.drawn or over_time)(record.context, axis)
    good = record.valid & np.isfinite(drawn.values)
    if good.sum() < 5 * BINS or np.ptp(drawn.values[good]) < 1e-9:
        drawn = over_time(record.context, axis)
        good = record.valid
    x = drawn.values[good]
    own = (wrench * drawn.direction).sum(axis=1)[good]
    left = (t.after * drawn.direction).sum(axis=1)[good]
    middle, mean, error = binned(x, own + left, BINS, INDEPENDENT_S / record.step_s)
    at, curve, _ = binned(x, own, CURVE_POINTS, 1.0)
    if effect.in_flight.use is InFlight.MEASUREMENT:
        fitted = "correction, as fitted"
    else:
        fitted = "the effect, as fitted"
    factor, unit = scale(UNITS[strongest], record.context.vehicle)
    measured = Line(
        middle,
        factor * mean,
        "before",
        "measured without it",
        points=True,
        error=factor * error,
    )
    lines = [measured, Line(at, factor * curve, "fit", fitted)]
    label = drawn.force_label.replace(f"[{UNITS[strongest]}]", f"[{unit}]")
    return figure(record.name, lines, drawn.label, label)


def binned(x: Array, y: Array, most: int, independent: float) -> tuple[Array, Array, Array]:
    """Middle, mean of y, and two standard errors, of at most ``most`` bins of x.

    Their edges are half way between equally wide and equally full: a hover does not take all the points, nor one dash
    across a range all the width. ``independent``: samples that are as good as one; a short flight has fewer bins.
    """
    bins = int(np.clip(len(x) / (LEAST * independent), FEWEST_BINS, most))
    share = np.linspace(0.0, 1.0, bins + 1)
    edges = np.unique(0.5 * np.quantile(x, share) + 0.5 * (x.min() + share * np.ptp(x)))
    index = np.searchsorted(edges[1:-1], x, side="right")
    middle = []
    mean = []
    error = []
    for i in range(len(edges) - 1):
        own = index == i
        samples = own.sum()
        if samples > 1:
            middle.append(x[own].mean())
            mean.append(y[own].mean())
            error.append(2.0 * y[own].std() / np.sqrt(max(samples / independent, 1.0)))
    return np.array(middle), np.array(mean), np.array(error)


def against(t: FlightFit, carrier: CarryingChannel) -> str:
    """The residual before and after against a channel that carries what remains; nothing where it does not vary."""
    x = t.record.channels[carrier.name]
    axis = AXES.index(carrier.axis)
    good = t.record.valid & np.isfinite(x)
    if good.sum() < 5 * BINS or np.ptp(x[good]) < 1e-9:
        return ""
    lines = []
    factor, unit = scale(UNITS[axis], t.record.context.vehicle)
    independent = INDEPENDENT_S / t.record.step_s
    for residual, kind in ((t.before, "before"), (t.after, "after")):
        y = factor * residual[good, axis]
        middle, mean, error = binned(x[good], y, BINS, independent)
        lines.append(Line(middle, mean, kind, kind, points=True, error=error))
    title = f"{AXIS_WORDS[axis].capitalize()}: {t.record.name}"
    return figure(title, lines, channel_words(carrier.name), f"error [{unit}]")


def series(t: FlightFit) -> str:
    """The residual before and after over time on every judged axis."""
    record = t.record
    out: list[str] = []
    lines: list[Line] = []
    for axis in record.axes:
        factor, unit = scale(UNITS[axis], record.context.vehicle)
        lines = []
        for kind, residual in (("before", t.before), ("after", t.after)):
            error = np.where(record.valid, factor * residual[:, axis], np.nan)
            lines.append(Line(*envelope(record.time_s, error), kind, kind))
        title = f"{AXES[axis]}, {AXIS_WORDS[axis]}"
        out.append(figure(title, lines, "time since boot [s]", f"[{unit}]", keyed=False))
    return f'<p class="keys">{keys(lines)}</p><div class="plots">{"".join(out)}</div>'


def envelope(x: Array, y: Array) -> tuple[Array, Array]:
    """A long series for a narrow chart: the lowest and the highest value of every column, in the order of time."""
    if len(x) <= 2 * PIXELS:
        return x, y
    keep: list[int] = []
    for part in np.array_split(np.arange(len(x)), PIXELS):
        known = part[np.isfinite(y[part])]
        if known.size:
            ends = {known[y[known].argmin()], known[y[known].argmax()]}
        else:
            ends = {part[0]}
        keep += sorted(map(int, ends))
    return x[keep], y[keep]
