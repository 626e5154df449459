"""The page of a folder: one self-contained HTML file, no script, no outside request."""

from __future__ import annotations

import html
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from replay.fleet.trends import Trend, trends

_STYLE = """
:root{color-scheme:light dark;--ink:#1b1f24;--paper:#fff;--dim:#59636e;--line:#d1d9e0;--mark:#0969da;--bad:#b42318}
@media(prefers-color-scheme:dark){
:root{--ink:#e6edf3;--paper:#0d1117;--dim:#9198a1;--line:#3d444d;--mark:#58a6ff;--bad:#ff8a7a}}
body{font:16px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);max-width:60rem;margin:1rem auto;
padding:0 1rem}
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}.wide{overflow-x:auto}
table{border-collapse:collapse;width:100%}
th,td{text-align:left;padding:.3rem .6rem;border-bottom:1px solid var(--line);vertical-align:top}
.dim{color:var(--dim)}.bad{color:var(--bad)}
svg{width:100%;max-width:38rem;height:auto;display:block}svg text{fill:var(--dim);font:14px system-ui,sans-serif}
svg .a{stroke:var(--line)}
svg .p{stroke:var(--mark);fill:var(--mark)}@media print{body{max-width:none}}"""
_W, _H, _LEFT, _BOTTOM, _TOP = 400, 190, 84, 30, 12
"""Of a chart [px]: as wide as a phone, so that its text is readable there."""


def write_page(folder: Path, title: str, answers: Sequence[Mapping[str, Any]]) -> Path:
    """``report.html`` with what the logs have in common, what differs, and every log in a row."""
    body = [f"<h1>{html.escape(title)}</h1>", _counts(answers)]
    diagnosed = [a for a in answers if "verdict" in a]
    if diagnosed:
        body += _effects(trends(answers))
    rows = _diagnosed_rows if diagnosed else _run_rows
    body += ["<h2>Every log</h2>", "<div class=wide><table>", *rows(answers), "</table></div>"]
    text = (
        f"<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content='width=device-width'>"
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style><body>{''.join(body)}</body></html>\n"
    )
    target = folder / "report.html"
    target.write_text(text, encoding="utf-8")
    return target


def _counts(answers: Sequence[Mapping[str, Any]]) -> str:
    good = [a for a in answers if "error" not in a]
    seconds = sum(float(a.get("duration_s", 0.0)) for a in good)
    text = f"{len(good)} of {len(answers)} logs could be used, {seconds / 60.0:.0f} minutes in all."
    verdicts = Counter(str(a["verdict"]).replace("_", " ") for a in good if "verdict" in a)
    if verdicts:
        text += " Verdicts: " + ", ".join(f"{name} {count}" for name, count in verdicts.most_common()) + "."
    return f"<p>{html.escape(text)}</p>"


def _effects(found: Sequence[Trend]) -> list[str]:
    if not found:
        return ["<p>No log shows an effect that the model lacks.</p>"]
    out = ["<h2>What the logs have in common</h2>"]
    for t in found:
        out.append(f"<h3>{html.escape(t.effect)}: {html.escape(t.parameter)}</h3>")
        out.append(f"<p>{html.escape(t.in_words())}</p>{_chart(t) if len(t.points) > 1 else ''}")
    return out


def _chart(t: Trend) -> str:
    """Size over date with its 95 % interval."""
    half = [p.half if math.isfinite(p.half) else 0.0 for p in t.points]
    low = min(p.value - h for p, h in zip(t.points, half, strict=True))
    high = max(p.value + h for p, h in zip(t.points, half, strict=True))
    low, high = min(low, 0.0), max(high, 0.0)
    span = (high - low) or 1.0
    first, last = min(p.day for p in t.points), max(p.day for p in t.points)
    days = (last - first) or 1.0

    def x(day: float) -> float:
        return _LEFT + 12 + (day - first) / days * (_W - _LEFT - 30)

    def y(value: float) -> float:
        return _TOP + (high - value) / span * (_H - _TOP - _BOTTOM)

    unit = "" if t.unit == "1" else f" {t.unit}"
    out = [f"<svg viewBox='0 0 {_W} {_H}' role=img aria-label='{html.escape(t.effect)} over date'>"]
    for value in (low, 0.0, high):
        out.append(f"<line class=a x1={_LEFT} x2={_W} y1={y(value):.1f} y2={y(value):.1f} />")
        out.append(f"<text x={_LEFT - 6} y={y(value) + 5:.1f} text-anchor=end>{value:.3g}{html.escape(unit)}</text>")
    ends = ((first, "start"), (last, "end")) if last - first >= 1.0 else ((first, "start"),)
    for day, anchor in ends:
        date = datetime.fromtimestamp(day * 86_400.0, UTC).strftime("%Y-%m-%d")
        out.append(f"<text x={x(day):.1f} y={_H - 6} text-anchor={anchor}>{date}</text>")
    for p, h in zip(t.points, half, strict=True):
        out.append(
            f"<g class=p><title>{html.escape(Path(p.log).name)}: {p.value:.4g} ± {h:.2g}{html.escape(unit)}</title>"
        )
        out.append(
            f"<line x1={x(p.day):.1f} x2={x(p.day):.1f} y1={y(p.value - h):.1f} y2={y(p.value + h):.1f} />"
            f"<circle cx={x(p.day):.1f} cy={y(p.value):.1f} r=4 /></g>"
        )
    return "".join([*out, "</svg>"])


def _cells(*cells: object, kind: str = "td") -> str:
    return "<tr>" + "".join(f"<{kind}>{c}</{kind}>" for c in cells) + "</tr>"


def _failed(a: Mapping[str, Any]) -> str:
    name, error = html.escape(Path(a["log"]).name), html.escape(a["error"])
    return f"<tr><td>{name}</td><td colspan=4 class=bad>{error}</td></tr>"


def _diagnosed_rows(answers: Sequence[Mapping[str, Any]]) -> list[str]:
    out = [_cells("log", "verdict", "effects", "judged", "date", kind="th")]
    for a in answers:
        if "error" in a:
            out.append(_failed(a))
            continue
        effects = ", ".join(html.escape(e["name"]) for e in a["effects"]) or "<span class=dim>none</span>"
        verdict = html.escape(str(a["verdict"]).replace("_", " "))
        name = html.escape(Path(a["log"]).name)
        out.append(_cells(name, verdict, effects, f"{a['duration_s']:.0f} s", a["date"][:10]))
    return out


def _run_rows(answers: Sequence[Mapping[str, Any]]) -> list[str]:
    out = [_cells("log", "date", "decided", "compensated", "held back longest by", kind="th")]
    for a in answers:
        if "error" in a:
            out.append(_failed(a))
            continue
        refusals = sorted(a["refusals_s"].items(), key=lambda item: -item[1])[:2]
        why = ", ".join(f"{html.escape(name.replace('_', ' '))} {s:.0f} s" for name, s in refusals)
        share = f"{a['compensated_s']:.0f} s ({a['share_compensated']:.0%})"
        out.append(_cells(html.escape(Path(a["log"]).name), a["date"][:10], f"{a['duration_s']:.0f} s", share, why))
    return out
