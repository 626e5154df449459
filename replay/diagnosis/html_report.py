"""The answer of ``replay diagnose`` as one HTML page for a pilot: what was found, how sure, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from models.effects import InFlight, get
from models.frames import AXES
from models.pages.document import document, folded, items, table, verdict
from models.vehicle import Vehicle
from replay.diagnosis.answer import UNITS, Diagnosis, Named
from replay.diagnosis.finding import capital, finding, size_words
from replay.diagnosis.interval import rms_interval
from replay.diagnosis.next_step import certainty, next_step
from replay.diagnosis.pictures import (
    EffectWrench,
    against,
    block_picture,
    effect_picture,
    effect_wrench,
    series,
    without,
)
from replay.diagnosis.words import (
    AXIS_WORDS,
    channel_words,
    kept_words,
    listed,
    plain,
    rough,
    unit_words,
)

_SAME, _UNCHANGED = 0.005, 0.02
"""A change below half a percent of an axis is none; one below two percent is not mentioned."""


def page(answer: Diagnosis, vehicle: Vehicle, model_faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The whole page. ``model_faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    seconds = sum(r.seconds for r in answer.records)
    flights = ", ".join(r.name for r in answer.records)
    step = next_step(answer, model_faults)
    found = finding(answer, model_faults)
    return document(
        f"{vehicle.name}: {found}",
        [
            f"<h1>{escape(found)}</h1>",
            verdict(step.verdict, [f"Next: {step.action}", *step.reasons], bad=step.bad),
            f'<p class="dim">{escape(vehicle.name)}. {escape(flights)}: {seconds:.0f} s of flight judged. Errors '
            "“after” are of held-out time, which the fit did not use.</p>",
            *(_effect(n, answer, vehicle) for n in answer.named),
            _axes(answer),
            _remains(answer),
            _not_shown(answer),
            "<h2>Error over time</h2>",
            *(f"<h3>{escape(t.record.name)}</h3>{series(t)}{block_picture(t)}" for t in answer.traces),
            folded("By place", _places(answer)),
            folded("Other effects, and why they were not named", _rejected(answer)),
            folded("Delays, time left out, notes and noise", _basis(answer)),
        ],
    )


def _axes(answer: Diagnosis) -> str:
    """Error of the model per axis over all flights, before and after."""
    rows = []
    for i in range(6):
        before, after = _pooled(answer, i, after=False), _pooled(answer, i, after=True)
        if before is None or after is None:
            continue
        change = after[0] / before[0] - 1.0 if before[0] > 0.0 else 0.0
        cells = [
            f'{v:.3f}<br><span class="dim small">[{low:.3f}, {high:.3f}]</span>' for v, low, high in (before, after)
        ]
        changed = "same" if abs(change) < _SAME else f"{change:+.0%}"
        rows.append([f'{AXIS_WORDS[i]}<br><span class="dim small">{AXES[i]} [{UNITS[i]}]</span>', *cells, changed])
    return (
        "<h2>Error of the model</h2><p>RMS of measured minus modelled force and moment, with its 95 % interval.</p>"
        + table(("axis", "before", "after", "change"), rows, numbers=(1, 2, 3))
    )


def _pooled(answer: Diagnosis, axis: int, *, after: bool) -> tuple[float, float, float] | None:
    """RMS of one axis over the flights that judge it, with its interval."""
    parts, block = [], 1
    for t in answer.traces:
        if axis in t.record.axes:
            parts.append((t.after if after else t.before)[t.record.valid, axis])
            tau_s = float(t.noise.tau_s[t.record.axes.index(axis)])
            block = max(block, int(3.0 * tau_s / t.record.step_s))
    if not parts:
        return None
    return rms_interval(np.concatenate(parts), block)


def _effect(n: Named, answer: Diagnosis, vehicle: Vehicle) -> str:
    """Size as the heading, how sure, the picture, what it does to the error; formula and numbers folded away."""
    f = n.found
    a = effect_wrench(n, answer.traces)
    text = [f"<p>Effect: <b>{escape(plain(f.effect.name))}</b>. {escape(certainty(n))}</p>"]
    if f.aliases:
        others = listed([plain(name) for name in f.aliases])
        flights = [f"{plain(e.name)}: {e.excite}" for e in (f.effect, *map(get, f.aliases))]
        text.append(f"<p><b>On this flight it looks the same as {escape(others)}.</b> What would show each:</p>")
        text.append(items(flights))
    text += [f"<p>{escape(line)}</p>" for line in _error_words(n, a, vehicle)] if a else []
    text.append(f"<p>{escape(capital(kept_words(f.effect)))}.</p>")
    if f.effect.in_flight.use is not InFlight.WRENCH:
        text.append(f"<p>{escape(capital(f.effect.in_flight.use.value))}.</p>")
    picture = effect_picture(n, a) if a else ""
    out = [
        f"<h2>{escape(capital(size_words(n, answer)))}</h2>",
        f'<div class="plots"><div>{"".join(text)}</div>{picture}</div>',
    ]
    rows = [
        [escape(plain(e.name)), f"{e.value:.4g}", _interval(e.ci95), escape(unit_words(e.unit))] for e in f.estimates
    ]
    formula = (
        f"<p>{escape(f.effect.equation)}<br>Sign: {escape(f.effect.sign)}.<br>Valid: {escape(f.effect.valid)}."
        f"<br>Source: {escape(f.effect.source)}.</p>"
    )
    numbers = table(("parameter", "value", "95 % interval", "unit"), rows, numbers=(1, 2))
    share = (
        f"<p>Without it, the energy of the error would be higher by {n.explains:.0%} of what it was before. The other "
        "effects stay; each axis counts in hundredths of the weight.</p>"
    )
    return "".join([*out, folded("Numbers and formula", numbers + share + formula)])


def _interval(ci95: tuple[float, float]) -> str:
    return f"{ci95[0]:.4g} to {ci95[1]:.4g}" if ci95[1] > ci95[0] else "fixed"


def _error_words(n: Named, a: EffectWrench, vehicle: Vehicle) -> list[str]:
    """What the effect does to the error: newtons and acceleration, newton metres and angular acceleration."""
    out = []
    for axis, bare, with_it in without(n, a):
        if abs(bare - with_it) < _UNCHANGED * max(bare, with_it):
            continue
        scale, unit = (vehicle.mass_kg, "m/s²") if axis < 3 else (vehicle.inertia_kgm2[axis - 3], "rad/s²")
        out.append(
            f"Error of the {AXIS_WORDS[axis]}: {rough(bare)} {UNITS[axis]} ({rough(bare / scale)} {unit}) without it, "
            f"{rough(with_it)} {UNITS[axis]} ({rough(with_it / scale)} {unit}) with it."
        )
    return out


def _remains(answer: Diagnosis) -> str:
    """What no effect explains: the channels that it follows, or the times at which it acts."""
    rows = [
        [
            escape(channel_words(c.name)), escape(c.axis), f"{c.score:.0%}",
            (f"{c.lag_s:.1f} s later" if c.lag_s else "") + (f"{c.peak_hz:.2f} Hz" if c.peak_hz else ""),
        ]
        for c in answer.channels
    ]  # fmt: skip
    plots = ""
    for t in answer.traces:
        first = next((c for c in answer.channels if c.name in t.record.channels), None)
        if first is not None:
            plots += against(t, first.name, AXES.index(first.axis))
    lines = [
        f"{t.record.name}: {o.rms:.2g} {UNITS[AXES.index(o.axis)]} in {o.axis}, "
        + (", ".join(f"{s:.0f} to {e:.0f} s" for s, e in o.intervals_s) or "all the time")
        for t in answer.traces
        for o in t.outside
    ]
    if not rows and not lines:
        return ""
    no_channel = f"<p>This follows no logged quantity:</p>{items(lines)}" if lines else ""
    return (
        "<h2>What remains</h2>"
        + table(("follows", "axis", "share of the axis", ""), rows, numbers=(2,))
        + (f'<div class="plots">{plots}</div>' if plots else "")
        + no_channel
    )


def _not_shown(answer: Diagnosis) -> str:
    """What these flights could not have shown, and the flight that would."""
    rows = [[escape(plain(r.name)), escape(get(r.name).excite)] for r in answer.rejected if not r.excited]
    return folded("What this flight could not have shown, and how to find out", table(("effect", "fly this"), rows))


def _places(answer: Diagnosis) -> str:
    rows = [
        [
            f"{escape(t.record.name)}, {r.name}", f"{r.seconds:.0f} s", f"{axis} [{UNITS[AXES.index(axis)]}]",
            f"{r.before[axis]:.3f}", f"{r.after[axis]:.3f}",
        ]
        for t in answer.traces
        for r in t.regimes
        for axis in r.before
    ]  # fmt: skip
    return table(("where", "time", "axis", "before", "after"), rows, numbers=(1, 3, 4))


def _rejected(answer: Diagnosis) -> str:
    rows = [[escape(plain(r.name)), "no" if r.excited else "not excited", escape(r.reason)] for r in answer.rejected]
    return table(("effect", "found", "why"), rows)


def _basis(answer: Diagnosis) -> str:
    lines = [
        f"{r.name}: {d.signal} {abs(d.seconds) * 1e3:.0f} ms {'late' if d.seconds > 0 else 'early'} "
        f"(correlation {d.correlation:.2f}, {'corrected' if d.corrected else 'not corrected'})"
        for r in answer.records
        for d in r.delays
    ]
    lines += [f"{r.name}: {e.seconds:.1f} s left out, {e.reason}" for r in answer.records for e in r.excluded]
    lines += list(answer.notes)
    lines += [
        f"{t.record.name}: noise in {AXES[a]} {t.noise.total[k]:.3g} {UNITS[a]}, correlated {t.noise.tau_s[k]:.1f} s"
        for t in answer.traces
        for k, a in enumerate(t.record.axes)
    ]
    return items(lines)
