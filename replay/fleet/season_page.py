"""The page of a season: every vehicle, its sizes over time, and what is not as it was."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from models.common.frames import Array
from models.common.pages.svg import Line, figure
from replay.fleet.season import Course, Season, Sized, VehicleSeason
from replay.report import render

DAY_S = 86_400.0
LEAST = 2
"""Logs of a plot."""
MOST_POINTS = 100
"""Of a plot; of more logs it shows means."""
MOST_PLOTS = 200
"""Of a page. Of the other vehicles it has the names."""
MOST_ROWS = 100
"""Of a table of logs that cannot be judged."""


def page(found: Season) -> str:
    """The whole page. However many logs and vehicles there are, a browser opens it at once."""
    if found.altered:
        head = f"{len(found.altered)} of {len(found.vehicles)} vehicles are not as they were"
        step = "look at these first, by the log that shows it."
    else:
        head = "No vehicle has changed"
        step = "nothing."
    shown, others = _chosen(found)
    return render(
        "season.html",
        head=head,
        verdict="What the logs say of every vehicle",
        sentences=[f"Next: {step}"],
        effects=found.effects,
        vehicles=shown,
        others=others,
        common=list(found.common),
        unknown=found.unknown[:MOST_ROWS],
        unknown_left=max(len(found.unknown) - MOST_ROWS, 0),
    )


def _chosen(found: Season) -> tuple[list[dict[str, Any]], list[str]]:
    """Vehicles that are shown with their plots, those that changed first, and names of the others."""
    altered = set(found.altered)
    names = [*found.altered, *(name for name in found.vehicles.names if name not in altered)]
    shown: list[dict[str, Any]] = []
    plots = 0
    for place, name in enumerate(names):
        if plots >= MOST_PLOTS:
            return shown, names[place:]
        shown.append(_shown(found.vehicles.named(name)))
        plots += len(shown[-1]["plots"]) + 1
    return shown, []


def _shown(v: VehicleSeason) -> dict[str, Any]:
    changes = []
    for course in v.changed:
        assert course.change is not None
        change = course.change
        changes.append(
            {
                "effect": course.effect,
                "size": f"{course.effect} {course.parameter}",
                "before": f"{change.before:.3g}",
                "after": f"{change.after:.3g} {course.unit}",
                "log": change.since,
                "date": change.date,
            }
        )
    plots = []
    for course in v.courses:
        if len(course.sizes) >= LEAST:
            plots.append({"effect": course.effect, "svg": _plot(course)})
    kind = ", ".join(text for text in (v.frame, v.firmware) if text)
    return {
        "name": v.vehicle,
        "last": v.last,
        "about": f"{kind}: {v.judged} logs judged, {v.first[:10]} to {v.last[:10]}",
        "changes": changes,
        "new": list(v.new),
        "plots": plots,
        "not_judged": v.not_judged[:MOST_ROWS],
        "not_judged_left": max(len(v.not_judged) - MOST_ROWS, 0),
    }


@dataclass(frozen=True, kw_only=True)
class _Points:
    """Of a plot."""

    days: Array
    values: Array
    half: Array
    """Of the bars."""
    names: list[str]
    """What a browser says under the cursor."""
    label: str


def _plot(course: Course) -> str:
    points = _single(course) if len(course.sizes) <= MOST_POINTS else _blocks(course)
    lines = [
        Line(
            points.days,
            points.values,
            "after",
            points.label,
            points=True,
            error=points.half,
            names=points.names,
        )
    ]
    if course.change is not None:
        before = points.days < _day(course.change.date, course)
        mean = np.where(before, course.change.before, course.change.after)
        lines.append(Line(points.days, mean, "before", "mean before and after"))
    title = f"{course.effect}: {course.parameter}"
    return figure(title, lines, "days since the first log", course.unit)


def _single(course: Course) -> _Points:
    """A point a log."""
    return _Points(
        days=_days(course),
        values=np.array([s.value for s in course.sizes]),
        half=np.array([0.5 * (s.high - s.low) for s in course.sizes]),
        names=[_name(size, course.unit) for size in course.sizes],
        label="with its 95 % interval",
    )


def _blocks(course: Course) -> _Points:
    """A point for some logs that follow each other: their mean, and where 95 % of them lie."""
    days = _days(course)
    values = np.array([s.value for s in course.sizes])
    parts = np.array_split(np.arange(len(values)), MOST_POINTS)
    most = max(len(part) for part in parts)
    names = []
    for part in parts:
        first = course.sizes[part[0]]
        last = course.sizes[part[-1]]
        mean = f"mean {values[part].mean():.3g} {course.unit}"
        names.append(f"{first.date[:10]} to {last.date[:10]}, {len(part)} logs: {mean}")
    return _Points(
        days=np.array([days[part].mean() for part in parts]),
        values=np.array([values[part].mean() for part in parts]),
        half=np.array([1.96 * values[part].std() for part in parts]),
        names=names,
        label=f"means of {most} logs, and where 95 % of these lie",
    )


def _name(size: Sized, unit: str) -> str:
    """What a browser says of one log."""
    numbers = f"{size.value:.3g} {unit}, 95 %: {size.low:.3g} to {size.high:.3g}"
    return f"{size.date[:10]}, {Path(size.log).name}: {numbers}"


def _days(course: Course) -> Array:
    return np.array([_day(s.date, course) for s in course.sizes])


def _day(date: str, course: Course) -> float:
    first = _time(course.sizes[0].date)
    return (_time(date) - first) / DAY_S


def _time(date: str) -> float:
    try:
        return datetime.fromisoformat(date.replace("Z", "+00:00")).timestamp()
    except ValueError:
        return 0.0
