"""Small plots as SVG: lines, points with bars, and shaded intervals. They are seen without any script.

A chart is 400 units wide: on a phone its text has the size that it is given, on a wide screen two stand side by side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from models.common.frames import Array
from models.common.runs import runs_of

WIDTH = 400
HEIGHT = 190
WIDE = 800
"""Width of the panels of a file."""
STYLE = Path(__file__).with_name("plot.css").read_text("utf-8")
"""Colours of light and dark, and how a plot is drawn."""
_LEFT = 56
_RIGHT = 10
_TOP = 22
_BOTTOM = 36
_NAMES = 20
"""Height of the row of names above a file's panels."""
_TICKS = 4
_CHARACTER = 6.6
"""Mean width of a character at 13 px [px]."""
_LONGEST = 6
"""Characters of a number beside the axis."""


@dataclass(frozen=True)
class Line:
    """One curve: x, y (n,), NaN breaks it; ``points`` draws dots, with a 95 % bar of half-length ``error``.

    ``kind`` is a colour of the page: ``before``, ``after``, ``fit``, ``a`` … ``d``.
    """

    x: Array
    y: Array
    kind: str
    label: str = ""
    points: bool = False
    error: Array | float = 0.0
    names: Sequence[str] = ()
    """Of the points: a browser shows them under the cursor."""


@dataclass(frozen=True)
class Band:
    """A shaded interval of x; several may carry one label."""

    start: float
    end: float
    kind: str
    label: str


def figure(
    title: str,
    lines: Sequence[Line],
    x_label: str,
    y_label: str,
    bands: Sequence[Band] = (),
    *,
    keyed: bool = True,
) -> str:
    """A plot with its title and, if ``keyed``, its colours above it, where they wrap as text does."""
    colours = keys(lines, bands) if keyed else ""
    caption = f"<figcaption><b>{escape(title)}</b>{colours}</figcaption>"
    box = f'viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}"'
    xs, ys = _scales(lines, WIDTH)
    box += f' data-x="{xs}" data-y="{ys}" data-x-label="{escape(x_label)}"'
    box += f' data-y-label="{escape(y_label)}"'
    return (
        f"<figure>{caption}<svg "
        f"{box}>{_panel(lines, x_label, y_label, bands, WIDTH)}</svg></figure>"
    )


def keys(lines: Sequence[Line], bands: Sequence[Band] = ()) -> str:
    """What the colours mean, once each."""
    kinds = {line.label: line.kind for line in lines}
    kinds |= {band.label: f"band {band.kind}" for band in bands}
    out = ""
    for label, kind in kinds.items():
        if label:
            out += f'<span class="key {kind}">{escape(label)}</span>'
    return out


def picture(
    title: str, panels: Mapping[str, Sequence[Line]], x_label: str, bands: Sequence[Band]
) -> str:
    """Panels by the label of their y, below each other, as an SVG file with the names of its curves and bands."""
    drawn = ""
    names = ""
    at = float(_LEFT)
    for k, (y_label, lines) in enumerate(panels.items()):
        panel = _panel(lines, x_label, y_label, bands, WIDE)
        drawn += f'<g transform="translate(0,{_NAMES + k * HEIGHT})">{panel}</g>'
    every = list(chain.from_iterable(panels.values()))
    for label, kind in {line.label: line.kind for line in every}.items():
        names += f'<text class="name {kind}" x="{at:.0f}" y="14">{escape(label)}</text>'
        at += _CHARACTER * (len(label) + 4)
    xs = _Scale(np.concatenate([line.x for line in every]), _LEFT, WIDE - _RIGHT)
    for band in bands:
        middle = xs(0.5 * (band.start + band.end))
        names += (
            f'<text x="{middle:.1f}" y="{_NAMES + _TOP - 5}" '
            f'text-anchor="middle">{escape(band.label)}</text>'
        )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} '
        f'{_NAMES + HEIGHT * len(panels)}" role="img">'
        f"<title>{escape(title)}</title><style>{STYLE}</style>"
        f'<rect width="100%" height="100%" fill="var(--paper)"/>{names}{drawn}</svg>\n'
    )


def _panel(
    lines: Sequence[Line], x_label: str, y_label: str, bands: Sequence[Band], width: int
) -> str:
    xs, ys = _scales(lines, width)
    out = "".join(_band(band, xs) for band in bands)
    out += _frame(xs, ys, x_label, y_label)
    for line in lines:
        draw = _dots if line.points else _polyline
        out += draw(line, xs, ys)
    return out


def _scales(lines: Sequence[Line], width: int) -> tuple[_Scale, _Scale]:
    """Of x and y."""
    xs = _Scale(np.concatenate([line.x for line in lines]), _LEFT, width - _RIGHT)
    ends = []
    for line in lines:
        for sign in (-1.0, 1.0):
            ends.append(line.y + sign * line.error)
    return xs, _Scale(np.concatenate([*ends, [0.0]]), HEIGHT - _BOTTOM, _TOP)


class _Scale:
    def __init__(self, values: Array, start: float, end: float) -> None:
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
        if high - low < 1e-12:
            low = low - 0.5
            high = high + 0.5
        self.low = low
        self.high = high
        self.start = start
        self.end = end

    def __str__(self) -> str:
        """For the script of the page: ends of the axis, and where they are."""
        return f"{self.low:.9g},{self.high:.9g},{self.start:g},{self.end:g}"

    def __call__(self, value: Any) -> Any:
        """Place of a number, or places of an array."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self) -> list[float]:
        raw = (self.high - self.low) / _TICKS
        size = 10.0 ** np.floor(np.log10(raw))
        step = size * min((s for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * size >= raw), default=10.0)
        first = np.ceil(self.low / step - 1e-9)
        # Adding zero turns a minus zero into a plain one.
        last = np.floor(self.high / step + 1e-9)
        return list(map(float, np.arange(first, last + 1) * step + 0.0))


def _frame(xs: _Scale, ys: _Scale, x_label: str, y_label: str) -> str:
    out = f'<text x="2" y="13">{escape(y_label)}</text>'
    for v in ys.ticks():
        out += f'<line class="grid" x1="{_LEFT}" x2="{xs.end}" y1="{ys(v):.1f}" y2="{ys(v):.1f}"/>'
        out += f'<text x="{_LEFT - 5}" y="{ys(v) + 4:.1f}" text-anchor="end">{_tick(v)}</text>'
    for v in xs.ticks():
        x = min(xs(v), xs.end + _RIGHT - 2 - 0.5 * _CHARACTER * len(_tick(v)))
        out += f'<text x="{x:.1f}" y="{HEIGHT - 20}" text-anchor="middle">{_tick(v)}</text>'
    middle = 0.5 * (_LEFT + xs.end + _RIGHT)
    out += f'<text x="{middle}" y="{HEIGHT - 4}" text-anchor="middle">{escape(x_label)}</text>'
    return out


def _tick(value: float) -> str:
    """A number that fits beside the axis."""
    text = f"{value:.4g}"
    if len(text) <= _LONGEST:
        return text
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")


def _band(band: Band, xs: _Scale) -> str:
    a, b = np.clip([xs(band.start), xs(band.end)], _LEFT, xs.end)
    if b <= a:
        return ""
    size = f'width="{b - a:.1f}" height="{HEIGHT - _TOP - _BOTTOM}"'
    return f'<rect class="band {band.kind}" x="{a:.1f}" y="{_TOP}" {size}/>'


def _polyline(line: Line, xs: _Scale, ys: _Scale) -> str:
    px = xs(line.x)
    py = ys(line.y)
    good = np.isfinite(px) & np.isfinite(py)
    out = ""
    for run in runs_of(good):
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(px[run], py[run], strict=True))
        label = escape(line.label)
        out += f'<polyline class="line {line.kind}" data-label="{label}" points="{points}"/>'
    return out


def _dots(line: Line, xs: _Scale, ys: _Scale) -> str:
    out = ""
    places = (xs(line.x), ys(line.y), ys(line.y - line.error), ys(line.y + line.error))
    names = line.names or [""] * len(line.x)
    for x, y, low, high, name in zip(*places, names, strict=True):
        if np.isfinite(x + y + low):
            if low != high:
                bar = f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{low:.1f}" y2="{high:.1f}"/>'
            else:
                bar = ""
            shown = f"<title>{escape(name)}</title>" if name else ""
            circle = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3"/>'
            out += f'<g class="dot {line.kind}">{shown}{bar}{circle}</g>'
    return out
