"""The page of a folder: what its logs have in common, what differs, what drifts, and every log in a row."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from companion.control.authority import Reason
from models.effects import get
from models.pages.document import document, table, verdict
from models.pages.svg import Line, figure
from replay.fleet.trends import Trend, trends
from replay.rerun.mend import lasted, to_mend

_DAY_S = 86_400.0
_COLOURS = ("after", "before", "a", "fit", "b", "c", "d")
"""Of the vehicles, as the style of the pages names them."""
_REASONS = {reason.name.lower(): reason for reason in Reason}
"""By their names in the JSON of a log, which may be of another version."""
_COMMON = 0.5
"""Share of the judged logs from which an effect is the vehicle's rather than a day's."""


def write_page(folder: Path, title: str, answers: Sequence[Mapping[str, Any]]) -> Path:
    """Write ``report.html`` into ``folder``."""
    target = folder / "report.html"
    target.write_text(page(folder, title, answers), encoding="utf-8")
    return target


def page(folder: Path, title: str, answers: Sequence[Mapping[str, Any]]) -> str:
    """The whole page; ``folder`` is where it will lie, for links to the pages of single logs."""
    diagnosed = any("verdict" in a for a in answers)
    found = trends(answers) if diagnosed else []
    head, step = _diagnosed(answers) if diagnosed else _replayed(answers)
    rows = [_failed(a) if "error" in a else (_row(a, folder) if diagnosed else _run_row(a)) for a in answers]
    names = ("log", "answer", "judged") if diagnosed else ("log", "compensated", "held back longest by")
    return document(
        title,
        [
            f"<h1>{escape(title)}</h1>",
            verdict(head, [f"Next: {step}"]),
            f'<p class="dim">{escape(_counts(answers))}</p>',
            *(_trend(t) for t in found),
            "<h2>Every log</h2>",
            table(names, rows),
        ],
    )


def _diagnosed(answers: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Verdict and next action from the effects that the logs show."""
    judged = [a for a in answers if "verdict" in a]
    if not any(a["effects"] for a in judged):
        return "No log shows an effect that the model lacks.", "there is nothing to change."
    common = common_effects(judged)
    if not common:
        return (
            "Some logs show an effect, most do not: it is of the day, not of the vehicle.",
            "look at those logs one by one; adopt nothing for the whole fleet.",
        )
    names = "; ".join(" or ".join(name.replace("_", " ") for name in group) for group in common)
    return (
        f"Most logs lack the same: {names}.",
        "diagnose a few of these logs together, by their names: that confirms it and gives one size for the vehicle.",
    )


def common_effects(judged: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Effects that half of the logs name, or cannot tell from one that they name; these stand together in a list."""
    seen: Counter[str] = Counter()
    named: Counter[str] = Counter()
    groups = [set(group) for a in judged for group in a.get("aliases", [])]
    for a in judged:
        names = {e["name"] for e in a["effects"]}
        named.update(names)
        seen.update(names | {other for group in a.get("aliases", []) if names & set(group) for other in group})
    out: list[list[str]] = []
    for name, _ in named.most_common():
        if seen[name] < max(_COMMON * len(judged), 2.0):
            continue
        beside = next((known for known in out if any({name, known[0]} <= group for group in groups)), None)
        if beside is None:
            out.append([name])
        else:
            beside.append(name)
    return out


def _replayed(answers: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    good = [a for a in answers if "error" not in a]
    acted = sum(a["compensated_s"] > 0.0 for a in good)
    total: Counter[str] = Counter()
    for a in good:
        total.update(a["refusals_s"])
    head = f"The companion would have compensated in {acted} of {len(good)} logs."
    first = to_mend((_REASONS[name], s) for name, s in total.items() if name in _REASONS)
    if first is None:
        return head, "nothing but take-off and landing held it back."
    reason, seconds = first
    return head, f"mend what held it back longest in all: {reason.value} ({lasted(seconds)})."


def _counts(answers: Sequence[Mapping[str, Any]]) -> str:
    good = [a for a in answers if "error" not in a]
    seconds = sum(float(a.get("duration_s", 0.0)) for a in good)
    text = f"{len(good)} of {len(answers)} logs could be used, {lasted(seconds)} in all."
    verdicts = Counter(str(a["verdict"]).replace("_", " ") for a in good if "verdict" in a)
    if verdicts:
        text += " Verdicts: " + ", ".join(f"{name} {count}" for name, count in verdicts.most_common()) + "."
    return text


def _trend(t: Trend) -> str:
    name = escape(f"{t.effect}: {t.parameter}".replace("_", " "))
    said = get(t.effect).sign
    sign = f'<p class="dim">{escape(said)}.</p>' if said.startswith(t.parameter) else ""
    return f"<h2>{name}</h2><p>{escape(t.in_words())}.</p>{sign}{_chart(t) if len(t.points) > 1 else ''}"


def _chart(t: Trend) -> str:
    """Size over days with its 95 % interval, a colour for each vehicle."""
    start = min(p.day for p in t.points)
    first = datetime.fromtimestamp(start * _DAY_S, UTC).strftime("%Y-%m-%d")
    lines = []
    for k, craft in enumerate(t.vehicles):
        own = [p for p in t.points if p.vehicle == craft]
        half = np.array([p.half if math.isfinite(p.half) else 0.0 for p in own])
        days, values = np.array([p.day - start for p in own]), np.array([p.value for p in own])
        lines.append(Line(days, values, _COLOURS[k % len(_COLOURS)], craft, points=True, error=half))
    unit = f" [{t.unit}]" if t.unit != "1" else ""
    return figure(f"{t.parameter.replace('_', ' ')}{unit}", lines, f"days since {first}", "")


def _failed(a: Mapping[str, Any]) -> list[str]:
    return [_log_cell(a), f'<span class="bad">{escape(a["error"])}</span>', ""]


def _log_cell(a: Mapping[str, Any], link: str = "") -> str:
    """Name of the log, and below it vehicle and date."""
    name = escape(Path(a["log"]).name)
    known = "error" not in a
    below = ", ".join(str(part) for part in ((a.get("craft"), a["date"][:10]) if known else ()) if part)
    name = f'<a href="{escape(link)}">{name}</a>' if link else name
    return f'{name}<br><span class="dim small">{escape(below)}</span>' if below else name


def _row(a: Mapping[str, Any], folder: Path) -> list[str]:
    effects = ", ".join(escape(e["name"].replace("_", " ")) for e in a["effects"])
    said = escape(str(a["verdict"]).replace("_", " ")) + (f": <b>{effects}</b>" if effects else "")
    link = _relative(Path(a["page"]), folder) if a.get("page") else ""
    return [_log_cell(a, link), said, f"{a['duration_s']:.0f}&nbsp;s"]


def _relative(target: Path, folder: Path) -> str:
    """A link that still works when the folder is moved."""
    try:
        return target.relative_to(folder.resolve()).as_posix()
    except ValueError:
        return target.as_uri()


def _run_row(a: Mapping[str, Any]) -> list[str]:
    first = to_mend((_REASONS[name], s) for name, s in a["refusals_s"].items() if name in _REASONS)
    why = "" if first is None or first[1] < 1.0 else f"{first[0].value}, {lasted(first[1])}"
    duration, done = a["duration_s"], a["compensated_s"]
    return [_log_cell(a), f"{done:.0f} of {duration:.0f}&nbsp;s", escape(why)]
