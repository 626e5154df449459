"""Pictures of a diagnosis: an effect over the quantity that drives it, and the error of the model over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.effects import Effect, InFlight
from models.effects.pictures import over_time
from models.frames import AXES, Array
from models.pages.svg import Band, Line, Mark, figure, keys
from replay.diagnosis.answer import UNITS, Named
from replay.diagnosis.words import AXIS_WORDS, channel_words
from replay.search.regimes import regimes
from replay.search.results import Trace

Mask = NDArray[np.bool_]
BINS = 14
FEWER_BINS = (BINS, 10, 7, 5, 4, 3)
"""Of a picture over a quantity."""
LEAST = 2.0
"""Independent samples of a bin."""
CURVE_POINTS = 40
PIXELS = 190
"""Columns of a time series; each shows its lowest and its highest value."""
BLOCK_S, FEWEST_BLOCKS = 10.0, 4
_PHASES = (("in the corner", "c"), ("near the ground", "a"), ("near a wall", "b"), ("faster than 1 m/s", "d"))
_SHORTEST_S = 1.0
"""Shorter phases are not drawn."""


@dataclass(frozen=True)
class EffectWrench:
    """What one effect does on one flight: its wrench (n, 6) as found, on the axes by which it was searched."""

    trace: Trace
    wrench: Array
    axis: int
    """The axis on which it is strongest, in hundredths of the weight."""


def effect_wrench(named: Named, traces: tuple[Trace, ...]) -> EffectWrench | None:
    """The effect on the flight that shows it best; None where it corrects a measurement only or has no numbers."""
    t = traces[named.record]
    effect = named.found.effect
    parameters = named.of_flight.get(named.record, named.found.parameters)
    if set(parameters) != {c.name for c in effect.coefficients} | {s.name for s in effect.shapes}:
        return None
    wrench = np.nan_to_num(effect.wrench(t.record.context, parameters))
    judged = [a for a in t.record.axes if not effect.searched or AXES[a] in effect.searched]
    wrench[:, [a for a in range(6) if a not in judged]] = 0.0
    size = np.sqrt((wrench[t.record.valid] ** 2).mean(axis=0)) / np.array([1.0] * 3 + [t.record.context.lever] * 3)
    usual = [a for a in judged if AXES[a] in (named.found.axes or effect.axes)] or judged
    if not usual or not size.any():
        return None
    return EffectWrench(t, wrench, max(usual, key=lambda a: float(size[a])))


def effect_picture(named: Named, a: EffectWrench) -> str:
    """What is left when this effect alone is taken out of the model, over its quantity, and the effect as fitted."""
    effect, record = named.found.effect, a.trace.record
    axis = AXES[a.axis]
    drawn = (effect.shown.drawn or over_time)(record.context, axis)
    good = record.valid & np.isfinite(drawn.values)
    if good.sum() < 5 * BINS or np.ptp(drawn.values[good]) < 1e-9:
        drawn = over_time(record.context, axis)
        good = record.valid & np.isfinite(drawn.values)
    x = drawn.values[good]
    own = ((a.wrench * drawn.direction).sum(axis=1))[good]
    left = ((a.trace.after * drawn.direction).sum(axis=1))[good]
    k = record.axes.index(a.axis)
    independent = max(float(a.trace.noise.tau_s[k]) / record.step_s, 1.0)
    middle, mean, error = well_binned(x, own + left, independent)
    at, curve, _ = binned(x, own, CURVE_POINTS, 1.0)
    lines = [
        Line(middle, mean, "before", "measured without it", points=True, error=error),
        Line(at, curve, "fit", plain_fit(effect), thick=True),
    ]
    start = named.found.parameters.get(drawn.mark) if drawn.mark else None
    marks = [Mark(start, f"{start:.0f} s")] if start else []
    return figure(record.name, lines, drawn.label, drawn.force_label, marks=marks)


def plain_fit(effect: Effect) -> str:
    """Label of the fitted curve."""
    return "correction, as fitted" if effect.in_flight.use is InFlight.MEASUREMENT else "the effect, as fitted"


def without(named: Named, a: EffectWrench) -> list[tuple[int, float, float]]:
    """(axis, RMS error without this effect, with it) of the axes that it acts on, beside all other effects."""
    rows = a.trace.record.valid
    after = a.trace.after[rows]
    out = []
    for axis in a.trace.record.axes:
        if AXES[axis] in named.found.axes:
            with_it = float(np.sqrt((after[:, axis] ** 2).mean()))
            out.append((axis, float(np.sqrt(((after + a.wrench[rows])[:, axis] ** 2).mean())), with_it))
    return out


def binned(x: Array, y: Array, bins: int, independent: float, least: float = LEAST) -> tuple[Array, Array, Array]:
    """Middle, mean of y, and two standard errors, of bins of x.

    Their edges are half way between equally wide and equally full: a hover does not take all the points, nor one dash
    across a range all the width. ``independent``: samples that are as good as one; bins below
    ``least`` of those are empty.
    """
    share = np.linspace(0.0, 1.0, bins + 1)
    edges = np.unique(0.5 * np.quantile(x, share) + 0.5 * (x.min() + share * np.ptp(x)))
    index = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    rows = [np.flatnonzero(index == i) for i in range(max(len(edges) - 1, 1))]
    full = [own for own in rows if len(own) >= max(least * independent, 2.0)]
    mean, spread = (np.array([of(y[own]) for own in full]) for of in (np.mean, np.std))
    error = 2.0 * spread / np.sqrt([max(len(own) / independent, 1.0) for own in full])
    return np.array([x[own].mean() for own in full]), mean, error


def well_binned(x: Array, y: Array, independent: float) -> tuple[Array, Array, Array]:
    """``binned`` with as many bins as the samples can fill: those of a short flight stay correlated over seconds.

    Where three bins cannot be filled, bins are shown that hold less, with an interval as wide as their scatter.
    """
    for least in (LEAST, 0.5, 0.1):
        found = max((binned(x, y, bins, independent, least) for bins in FEWER_BINS), key=lambda found: len(found[0]))
        if len(found[0]) >= FEWER_BINS[-1]:
            break
    return found


def against(t: Trace, channel: str, axis: int) -> str:
    """The residual before and after against a channel that carries what remains; nothing where it does not vary."""
    x = t.record.channels[channel]
    good = t.record.valid & np.isfinite(x)
    if good.sum() < 5 * BINS or np.ptp(x[good]) < 1e-9:
        return ""
    k = t.record.axes.index(axis) if axis in t.record.axes else 0
    independent = max(float(t.noise.tau_s[k]) / t.record.step_s, 1.0)
    lines = []
    for residual, kind in ((t.before, "before"), (t.after, "after")):
        middle, mean, error = well_binned(x[good], residual[good, axis], independent)
        lines.append(Line(middle, mean, kind, kind, points=True, error=error))
    title = f"{AXIS_WORDS[axis].capitalize()}: {t.record.name}"
    return figure(title, lines, channel_words(channel), f"error [{UNITS[axis]}]")


def phases(t: Trace) -> list[Band]:
    """Where the vehicle flew, as shaded intervals of time."""
    found = regimes(t.record)
    parts = dict(zip((name for name, _ in _PHASES), (found[k] for k in ("corner", "low", "wall", "fast")), strict=True))
    time_s, out = t.record.time_s, []
    for name, kind in _PHASES:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], parts[name].astype(int), [0]])))
        for i, j in zip(edges[::2], edges[1::2], strict=True):
            if time_s[j - 1] - time_s[i] >= _SHORTEST_S:
                out.append(Band(float(time_s[i]), float(time_s[j - 1]), kind, name))
    return out


def series(t: Trace) -> str:
    """The error of every judged axis over time, before and after, with the phases of the flight."""
    bands = phases(t)
    out: list[str] = []
    lines: list[Line] = []
    for axis in t.record.axes:
        lines = [
            Line(*envelope(t.record.time_s, np.where(t.record.valid, r[:, axis], np.nan)), kind, kind)
            for r, kind in ((t.before, "before"), (t.after, "after"))
        ]
        title = f"{AXES[axis]}, {AXIS_WORDS[axis]}"
        out.append(figure(title, lines, "time since boot [s]", f"error [{UNITS[axis]}]", bands, keyed=False))
    return f'<p class="keys">{keys(lines, bands)}</p><div class="plots">{"".join(out)}</div>'


def envelope(x: Array, y: Array) -> tuple[Array, Array]:
    """A long series for a narrow chart: the lowest and the highest value of every column, in the order of time."""
    if len(x) <= 2 * PIXELS:
        return x, y
    keep: list[int] = []
    for part in np.array_split(np.arange(len(x)), PIXELS):
        known = part[np.isfinite(y[part])]
        keep += (
            [int(part[0])] if not known.size else sorted({int(known[y[known].argmin()]), int(known[y[known].argmax()])})
        )
    return x[keep], y[keep]


def blocks(t: Trace) -> tuple[Array, Array, Array]:
    """Middle [s], and error before and after in units of the noise (all axes, RMS), of every block of held-out time."""
    axes, valid = list(t.record.axes), t.record.valid
    time_s = t.record.time_s[valid]
    number = ((time_s - time_s[0]) / BLOCK_S).astype(int)
    kept = [k for k in np.unique(number) if (number == k).sum() * t.record.step_s > 0.5 * BLOCK_S]
    before, after = (
        np.array([np.sqrt(np.mean((r[valid][:, axes][number == k] / t.noise.total) ** 2)) for k in kept])
        for r in (t.before, t.after)
    )
    return np.array([time_s[number == k].mean() for k in kept]), before, after


def block_picture(t: Trace) -> str:
    """Every block of time by itself: an effect that is true helps wherever it acts, not on the average only."""
    middle, before, after = blocks(t)
    if len(middle) < FEWEST_BLOCKS or np.array_equal(before, after):
        return ""
    better = int((after < before).sum())
    lines = [Line(middle, y, kind, kind, points=True) for y, kind in ((before, "before"), (after, "after"))]
    sentence = f"Lower in <b>{better} of {len(middle)}</b> blocks of {BLOCK_S:.0f} s of held-out time."
    return f"<p>{sentence}</p>" + figure(
        f"Block by block: {t.record.name}", lines, "time since boot [s]", "error / noise"
    )
