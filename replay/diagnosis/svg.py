"""Small plots as SVG text: lines, points and bars. No library, so a report needs none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from models.frames import Array

WIDTH, HEIGHT = 760, 170
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 12, 20, 32
BEFORE, AFTER = "#c0504d", "#2a6fb0"


@dataclass(frozen=True)
class Line:
    """One curve: x, y (n,), NaN breaks it; ``points`` draws dots instead, with a 95 % bar of half-length ``error``."""

    x: Array
    y: Array
    colour: str
    label: str = ""
    points: bool = False
    error: Array | None = None


def plot(lines: Sequence[Line], title: str, x_label: str, y_label: str) -> str:
    """One panel as an SVG element."""
    x = np.concatenate([line.x for line in lines])
    low = np.concatenate([line.y if line.error is None else line.y - line.error for line in lines])
    high = np.concatenate([line.y if line.error is None else line.y + line.error for line in lines])
    xs, ys = _Scale(x, _LEFT, WIDTH - _RIGHT), _Scale(np.concatenate([low, high, [0.0]]), HEIGHT - _BOTTOM, _TOP)
    parts = [_frame(xs, ys, title, x_label, y_label)]
    for line in lines:
        parts.append(_dots(line, xs, ys) if line.points else _polyline(line, xs, ys))
    labels = [line for line in lines if line.label]
    for i, line in enumerate(labels):
        at = WIDTH - _RIGHT - 110 * (len(labels) - i)
        parts.append(f'<text x="{at}" y="14" fill="{line.colour}">{escape(line.label)}</text>')
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">{"".join(parts)}</svg>'


class _Scale:
    def __init__(self, values: Array, start: float, end: float) -> None:
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
        if high - low < 1e-12:
            low, high = low - 0.5, high + 0.5
        self.low, self.high, self.start, self.end = low, high, start, end

    def __call__(self, value: Array) -> Array:
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self) -> Array:
        raw = (self.high - self.low) / 5.0
        size = 10.0 ** np.floor(np.log10(raw))
        step = size * min((s for s in (1.0, 2.0, 5.0, 10.0) if s * size >= raw), default=10.0)
        first = np.ceil(self.low / step - 1e-9)
        # Adding zero turns a minus zero into a plain one.
        return np.asarray(np.arange(first, np.floor(self.high / step + 1e-9) + 1) * step + 0.0)


def _frame(xs: _Scale, ys: _Scale, title: str, x_label: str, y_label: str) -> str:
    out = [f'<text x="{_LEFT}" y="14" font-weight="bold">{escape(title)}</text>']
    for v in ys.ticks():
        y = float(ys(np.array(v)))
        out.append(f'<line x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd"/>')
        out.append(f'<text x="{_LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{v:.4g}</text>')
    for v in xs.ticks():
        out.append(f'<text x="{float(xs(np.array(v))):.1f}" y="{HEIGHT - 16}" text-anchor="middle">{v:.4g}</text>')
    out.append(f'<text x="{(_LEFT + WIDTH) / 2}" y="{HEIGHT - 3}" text-anchor="middle">{escape(x_label)}</text>')
    out.append(f'<text x="12" y="{HEIGHT / 2}" transform="rotate(-90 12 {HEIGHT / 2})" text-anchor="middle">{escape(y_label)}</text>')  # fmt: skip # noqa: E501
    return "".join(out)


def _polyline(line: Line, xs: _Scale, ys: _Scale) -> str:
    px, py = xs(line.x), ys(line.y)
    good = np.isfinite(px) & np.isfinite(py)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    runs = [
        " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px[i:j], py[i:j], strict=True))
        for i, j in zip(edges[::2], edges[1::2], strict=True)
    ]
    return "".join(f'<polyline points="{run}" fill="none" stroke="{line.colour}"/>' for run in runs)


def _dots(line: Line, xs: _Scale, ys: _Scale) -> str:
    out = []
    error = np.zeros(len(line.x)) if line.error is None else line.error
    for x, y, e in zip(line.x, line.y, error, strict=True):
        if not np.isfinite(x + y + e):
            continue
        a, b, c = (float(v) for v in (xs(x), ys(y - e), ys(y + e)))
        out.append(f'<line x1="{a:.1f}" x2="{a:.1f}" y1="{b:.1f}" y2="{c:.1f}" stroke="{line.colour}"/>')
        out.append(f'<circle cx="{a:.1f}" cy="{float(ys(y)):.1f}" r="3" fill="{line.colour}"/>')
    return "".join(out)
