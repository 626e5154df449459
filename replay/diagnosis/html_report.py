"""The answer of ``replay diagnose`` as one HTML page for a pilot: what is missing, how sure, and what to do next."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.effects import InFlight, get
from models.errors import ConfigError
from models.frames import AXES, Array
from models.vehicle import Vehicle
from replay.diagnosis.diagnose import UNITS, Diagnosis, Named
from replay.diagnosis.svg import AFTER, BEFORE, Line, plot
from replay.search.results import Estimate, Trace

Mask = NDArray[np.bool_]
BINS = 12
MOST_POINTS = 900
NEAR_GROUND, NEAR_WALL = 4.0, 3.8
"""Reach of ground (h/r) and wall (d/r) in radii, as in the paper."""
FAST_M_S = 1.0

_STYLE = """body{font:15px/1.45 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:1em 0}td,th{border-bottom:1px solid #ddd;padding:.25em .7em;text-align:left}
td.n{text-align:right;font-variant-numeric:tabular-nums}svg{width:100%;font:11px sans-serif;margin:.3em 0}
.verdict{font-size:1.15em;padding:.6em .9em;border-left:6px solid #2a6fb0;background:#f2f6fa}.dim{color:#777}
.verdict b{font-size:1.2em}details{color:#555}"""

WORDS = ("forward", "to the right", "down", "roll", "pitch", "yaw")
"""What an axis means to a pilot, body FRD."""
BLOCK_S, FEWEST_BLOCKS = 10.0, 4

_VERDICT = {
    "nothing_missing": "Nothing is missing.",
    "explained": "What is missing has a name: {names}.",
    "partly_explained": "Part of what is missing has a name: {names}. Something else remains.",
    "unexplained": "Something is missing, and it has no name here.",
}
_ADVICE = {
    "nothing_missing": "The declared model explains this flight down to noise. There is nothing to change. What the "
    "flight could not have shown is listed below.",
    "explained": "Does it make sense for this vehicle and this flight? If so, save the amended model (--save-model) "
    "and fly it; if not, check the vehicle file first.",
    "partly_explained": "Adopt the named effect only if it makes sense to you, and look at the channels that carry the "
    "rest.",
    "unexplained": "Do not adopt anything. Look at the channels below: what on the vehicle, or around it, changes "
    "together with them?",
}


def write_report(directory: Path, answer: Diagnosis, vehicle: Vehicle) -> Path:
    """Write ``report.html`` into ``directory`` (created) and return its path."""
    path = directory / "report.html"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        path.write_text(page(answer, vehicle), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--report {directory}: cannot be written ({error.strerror})") from None
    return path


def page(answer: Diagnosis, vehicle: Vehicle) -> str:
    """The whole page."""
    seconds = sum(r.seconds for r in answer.records)
    flights = ", ".join(escape(r.name) for r in answer.records)
    names = ", ".join(escape(_plain(n.found.effect.name)) for n in answer.named)
    sections = [
        f"<h1>What the model lacks: {escape(vehicle.name)}</h1>",
        f'<p class="verdict"><b>{_VERDICT[answer.verdict].format(names=names)}</b><br>{_ADVICE[answer.verdict]}</p>',
        f'<p class="dim">{flights}: {seconds:.0f} s of flight judged. Everything below “after” was computed on time '
        "that the fit had not seen.</p>",
        _summary(answer),
        _axes(answer),
        *(_blocks(t) for t in answer.traces),
        *(_effect(n, answer) for n in answer.named),
        _channels(answer),
        _not_shown(answer),
        "<h2>By place, and over time</h2>",
        _table(answer),
        *(_series(t) for t in answer.traces),
        _rejected(answer),
        _basis(answer),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>replay diagnose</title>'
        f"<style>{_STYLE}</style></head><body>{''.join(sections)}</body></html>\n"
    )


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _number(e: Estimate) -> str:
    interval = f" ({e.ci95[0]:.3g} to {e.ci95[1]:.3g})" if e.ci95[1] > e.ci95[0] else ""
    return f"{escape(_plain(e.name))} {e.value:.3g}{'' if e.unit == '1' else ' ' + escape(e.unit)}{interval}"


def _summary(answer: Diagnosis) -> str:
    """One line an effect: how large, how sure, how much it matters."""
    if not answer.named:
        return ""
    rows = "".join(
        f"<tr><td><b>{escape(_plain(n.found.effect.name))}</b>"
        + (f"<br>or {escape(', '.join(map(_plain, n.found.aliases)))}" if n.found.aliases else "")
        + f"</td><td>{'<br>'.join(_number(e) for e in n.found.estimates)}</td>"
        f'<td>{n.status}</td><td class="n">{n.explains:.0%}</td></tr>'
        for n in answer.named
    )
    return (
        "<h2>In short</h2><table><tr><th>effect</th><th>size (95 % interval)</th><th>how sure</th>"
        f"<th>of the error, it removes</th></tr>{rows}</table>"
        "<p>A <b>candidate</b> was seen on one flight; a <b>confirmed</b> effect, frozen as found on one flight, also "
        "took error out of another.</p>"
    )


def _axes(answer: Diagnosis) -> str:
    """Error of the model per axis over all flights, before and after."""
    rows = ""
    for i in range(6):
        before, after = _pooled(answer, i, after=False), _pooled(answer, i, after=True)
        if before is None or after is None:
            continue
        change = after[0] / before[0] - 1.0 if before[0] > 0.0 else 0.0
        cells = "".join(
            f'<td class="n">{v:.3f} <span class="dim">[{low:.3f}, {high:.3f}]</span></td>'
            for v, low, high in (before, after)
        )
        rows += (
            f"<tr><td>{AXES[i]}</td><td>{WORDS[i]}</td>{cells}<td>{UNITS[i]}</td>"
            f'<td class="n">{"unchanged" if abs(change) < 0.005 else f"{change:+.0%}"}</td></tr>'
        )
    return (
        "<h2>Error of the model, before and after</h2><p>RMS of measured minus modelled force or moment; in brackets "
        "its 95 % interval.</p><table><tr><th>axis</th><th></th><th>before</th><th>after</th><th></th><th>change</th>"
        f"</tr>{rows}</table>"
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
    joined = np.concatenate(parts)
    return rms_interval(joined, np.ones(len(joined), bool), block)


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


def _blocks(t: Trace) -> str:
    """Every block of time by itself: an effect that is true helps wherever it acts, not on the average only."""
    middle, before, after = blocks(t)
    if len(middle) < FEWEST_BLOCKS or np.array_equal(before, after):
        return ""
    better = int((after < before).sum())
    lines = [Line(middle, y, c, n, points=True) for y, c, n in ((before, BEFORE, "before"), (after, AFTER, "after"))]
    title = f"Error block by block, {t.record.name}"
    return (
        f"<p>Lower in <b>{better} of {len(middle)}</b> blocks of {BLOCK_S:.0f} s that the fit had not seen "
        f"({escape(t.record.name)}).</p>" + plot(lines, title, "time since boot [s]", "error / noise")
    )


def _effect(n: Named, answer: Diagnosis) -> str:
    f = n.found
    rows = "".join(
        f'<tr><td>{escape(e.name)}</td><td class="n">{e.value:.4g}</td><td class="n">'
        + (f"{e.ci95[0]:.4g} to {e.ci95[1]:.4g}" if e.ci95[1] > e.ci95[0] else "held")
        + f"</td><td>{escape(e.unit)}</td></tr>"
        for e in f.estimates
    )
    sure = (
        "Confirmed: frozen as found on one flight, it also removes error from another."
        if n.status == "confirmed"
        else "Candidate: seen on one flight only. Fly again and diagnose both logs together to confirm it."
    )
    out = [
        f"<h2>{escape(_plain(f.effect.name))}</h2><p>{sure} It acts on {escape(', '.join(f.axes))} and removes "
        f"{n.explains:.0%} of the error's energy (each axis in hundredths of the weight). That it, or what may "
        f"stand for it, acts has a probability of {f.probability:.2f}.</p>",
        f"<table><tr><th>parameter</th><th>value</th><th>95 % interval</th><th>unit</th></tr>{rows}</table>",
    ]
    if f.aliases:
        out.append(
            f"<p><b>This flight cannot tell it from {escape(', '.join(map(_plain, f.aliases)))}.</b> To tell them "
            f"apart: {escape(f.effect.excite)}.</p>"
        )
    if f.effect.in_flight is not InFlight.WRENCH:
        out.append(f"<p>In flight: {f.effect.in_flight.value}.</p>")
    out.append(
        f"<details><summary>formula</summary>{escape(f.effect.equation)}<br>Sign: {escape(f.effect.sign)}. "
        f"Source: {escape(f.effect.source)}.</details>"
    )
    t = answer.traces[n.record]
    axis = AXES.index(f.axes[0]) if f.axes else t.record.axes[0]
    channel = next((c for c in f.effect.channels if c in t.record.channels), None)
    if channel is not None:
        out.append(_against(t, channel, axis))
    return "".join(out)


def _channels(answer: Diagnosis) -> str:
    if not answer.channels:
        return ""
    rows = "".join(
        f'<tr><td>{escape(c.name)}</td><td>{c.axis}</td><td class="n">{c.score:.0%}</td><td>'
        + (f"{c.lag_s:.1f} s behind" if c.lag_s else "")
        + (f"{c.peak_hz:.2f} Hz" if c.peak_hz else "")
        + "</td></tr>"
        for c in answer.channels
    )
    plots = ""
    for t in answer.traces:
        first = next((c for c in answer.channels if c.name in t.record.channels), None)
        if first is not None:
            plots += _against(t, first.name, AXES.index(first.axis))
    return (
        "<h2>What remains, and where</h2>"
        "<table><tr><th>channel</th><th>axis</th><th>share of that axis</th><th></th></tr>"
        f"{rows}</table>{plots}"
    )


def _against(t: Trace, channel: str, axis: int) -> str:
    """Residual before and after against a channel: means of equally full bins, bars of two standard errors."""
    x = t.record.channels[channel]
    good = t.record.valid & np.isfinite(x)
    if good.sum() < 5 * BINS or np.ptp(x[good]) < 1e-9:
        return ""
    edges = np.unique(np.quantile(x[good], np.linspace(0.0, 1.0, BINS + 1)))
    if len(edges) < 3:
        return ""
    index = np.clip(np.searchsorted(edges, x[good], side="right") - 1, 0, len(edges) - 2)
    k = t.record.axes.index(axis) if axis in t.record.axes else 0
    independent = max(float(t.noise.tau_s[k]) / t.record.step_s, 1.0)
    lines = []
    for residual, colour, label in ((t.before, BEFORE, "before"), (t.after, AFTER, "after")):
        y = residual[good, axis]
        full = [i for i in range(len(edges) - 1) if (index == i).any()]
        mean = np.array([y[index == i].mean() for i in full])
        error = np.array(
            [2.0 * y[index == i].std() / np.sqrt(max((index == i).sum() / independent, 1.0)) for i in full]
        )
        middle = np.array([x[good][index == i].mean() for i in full])
        lines.append(Line(middle, mean, colour, label, points=True, error=error))
    return plot(lines, f"{AXES[axis]} residual against {channel}", channel, UNITS[axis])


def _series(t: Trace) -> str:
    every = max(len(t.record.time_s) // MOST_POINTS, 1)
    valid = t.record.valid[::every]
    out = [f"<h3>{escape(t.record.name)}</h3>"]
    for axis in t.record.axes:
        lines = [
            Line(t.record.time_s[::every], np.where(valid, r[::every, axis], np.nan), colour, label)
            for r, colour, label in ((t.before, BEFORE, "before"), (t.after, AFTER, "after"))
        ]
        out.append(plot(lines, f"{AXES[axis]} residual", "time since boot [s]", UNITS[axis]))
    return "".join(out)


def regimes(t: Trace) -> dict[str, Mask]:
    """Where the vehicle flew, as masks (n,) over judged samples."""
    record, state = t.record, t.record.context.state
    radius = record.context.vehicle.rotor_radius_m
    with np.errstate(invalid="ignore"):
        ground = np.nanmin(np.where(np.isnan(state.h_m), np.inf, state.h_m), axis=1) < NEAR_GROUND * radius
        wall = np.nanmin(np.where(np.isnan(state.d_m), np.inf, state.d_m), axis=1) < NEAR_WALL * radius
        fast = np.linalg.norm(state.velocity_ned, axis=1) > FAST_M_S
    parts = {
        "everywhere": np.ones(len(ground), bool), "free air": ~ground & ~wall, "near the ground": ground & ~wall,
        "near a wall": wall & ~ground, "in the corner": ground & wall, f"faster than {FAST_M_S:g} m/s": fast,
    }  # fmt: skip
    return {name: mask & record.valid for name, mask in parts.items()}


def rms_interval(residual: Array, mask: Mask, block: int) -> tuple[float, float, float]:
    """RMS of (n,) on ``mask`` with its 95 % interval from a bootstrap over blocks of ``block`` samples."""
    square = residual[mask] ** 2
    parts = np.array_split(square, max(len(square) // max(block, 1), 2))
    sums, counts = np.array([p.sum() for p in parts]), np.array([len(p) for p in parts])
    pick = np.random.default_rng(0).integers(0, len(parts), (400, len(parts)))
    draws = np.sqrt(sums[pick].sum(1) / np.maximum(counts[pick].sum(1), 1))
    low, high = np.percentile(draws, [2.5, 97.5])
    return float(np.sqrt(square.mean())), float(low), float(high)


def _table(answer: Diagnosis) -> str:
    rows = []
    for t in answer.traces:
        for name, mask in regimes(t).items():
            if mask.sum() * t.record.step_s < 5.0:
                continue
            for k, axis in enumerate(t.record.axes):
                block = int(3.0 * float(t.noise.tau_s[k]) / t.record.step_s)
                cells = "".join(
                    '<td class="n">{:.3f} <span class="dim">[{:.3f}, {:.3f}]</span></td>'.format(
                        *rms_interval(r[:, axis], mask, block)
                    )
                    for r in (t.before, t.after)
                )
                rows.append(
                    f"<tr><td>{escape(t.record.name) if len(answer.traces) > 1 else ''}</td><td>{name}</td>"
                    f'<td class="n">{mask.sum() * t.record.step_s:.0f} s</td><td>{AXES[axis]}</td>{cells}'
                    f"<td>{UNITS[axis]}</td></tr>"
                )
    head = "<tr><th></th><th>where</th><th>time</th><th>axis</th><th>RMS before</th><th>RMS after</th><th></th></tr>"
    return f"<table>{head}{''.join(rows)}</table>"


def _not_shown(answer: Diagnosis) -> str:
    """What these flights could not have shown, and the flight that would."""
    rows = "".join(
        f"<tr><td>{escape(_plain(r.name))}</td><td>{escape(get(r.name).excite)}</td></tr>"
        for r in answer.rejected
        if not r.excited
    )
    if not rows:
        return ""
    return (
        "<h2>Not excited: what this flight could not have shown</h2><p>These may still be there. To find out:</p>"
        f"<table><tr><th>effect</th><th>fly this</th></tr>{rows}</table>"
    )


def _rejected(answer: Diagnosis) -> str:
    rows = "".join(
        f"<tr><td>{escape(_plain(r.name))}</td><td>{'no' if r.excited else 'not excited'}</td>"
        f"<td>{escape(r.reason)}</td></tr>"
        for r in answer.rejected
    )
    return (
        "<h2>Every other effect, and why it was not named</h2>"
        f"<table><tr><th>effect</th><th>found</th><th>why</th></tr>{rows}</table>"
    )


def _basis(answer: Diagnosis) -> str:
    items = [
        f"{escape(r.name)}: {escape(d.signal)} {abs(d.seconds) * 1e3:.0f} ms {'late' if d.seconds > 0 else 'early'} "
        f"(correlation {d.correlation:.2f}, {'corrected' if d.corrected else 'not corrected'})"
        for r in answer.records
        for d in r.delays
    ]
    items += [
        f"{escape(r.name)}: {e.seconds:.1f} s left out, {escape(e.reason)}" for r in answer.records for e in r.excluded
    ]
    items += [escape(note) for note in answer.notes]
    items += [
        f"{escape(t.record.name)}: noise of {AXES[a]} {t.noise.total[k]:.3g} {UNITS[a]}, "
        f"correlated over {t.noise.tau_s[k]:.1f} s"
        for t in answer.traces
        for k, a in enumerate(t.record.axes)
    ]
    return f"<h2>What this rests on</h2><ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>"
