"""The page of a season: every vehicle, its sizes over time, and what is not as it was."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np

from models.common.frames import Array
from models.common.pages.svg import Line, figure
from replay.fleet.season import Course, Season, Sized, VehicleSeason
from replay.report import render

DAY_S = 86_400.0
LEAST = 2
"""Logs of a plot."""


def page(found: Season) -> str:
    """The whole page."""
    changed = [v for v in found.vehicles if v.changed or v.new]
    others = [v for v in found.vehicles if v not in changed]
    effects: set[str] = set()
    for vehicle in found.vehicles:
        effects |= {course.effect for course in vehicle.courses}
    if changed:
        head = f"{len(changed)} of {len(found.vehicles)} vehicles are not as they were"
        step = "look at these first, by the log that shows it."
    else:
        head = "No vehicle has changed"
        step = "nothing."
    return render(
        "season.html",
        head=head,
        verdict="What the logs say of every vehicle",
        sentences=[f"Next: {step}"],
        effects=sorted(effects),
        vehicles=[_shown(v) for v in (*changed, *others)],
        common=list(found.common),
        unknown=list(found.unknown),
    )


def _shown(v: VehicleSeason) -> dict[str, object]:
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
        "not_judged": list(v.not_judged),
    }


def _plot(course: Course) -> str:
    days = _days(course)
    values = np.array([s.value for s in course.sizes])
    half = np.array([0.5 * (s.high - s.low) for s in course.sizes])
    names = [_name(size, course.unit) for size in course.sizes]
    label = "with its 95 % interval"
    lines = [Line(days, values, "after", label, points=True, error=half, names=names)]
    if course.change is not None:
        before = days < _day(course.change.date, course)
        mean = np.where(before, course.change.before, course.change.after)
        lines.append(Line(days, mean, "before", "mean before and after"))
    title = f"{course.effect}: {course.parameter}"
    return figure(title, lines, "days since the first log", course.unit)


def _name(size: Sized, unit: str) -> str:
    """What a browser says of a point under the cursor."""
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
