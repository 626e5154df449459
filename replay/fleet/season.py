"""``replay season``: what the answers of a store say of every vehicle over time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np

from replay.change_point import change_of_sizes
from replay.fleet.store import Row, Store

FLEET = 2
"""Vehicles, of which an effect can be common."""
WIDTH = 2.0 * 1.96
"""Of a 95 % interval, in standard deviations."""
OFTEN = 0.5
"""Share of the vehicles from which an effect is of all of them: of a firmware, or of a lot of propellers."""


@dataclass(frozen=True, kw_only=True)
class Sized:
    """A parameter on one log."""

    log: str
    date: str
    value: float
    low: float
    high: float

    @property
    def sd(self) -> float:
        """Standard deviation."""
        return max((self.high - self.low) / WIDTH, 1e-9 * max(abs(self.value), 1.0))


@dataclass(frozen=True, kw_only=True)
class SizeChange:
    """A parameter that is another one from a log on."""

    since: str
    date: str
    before: float
    after: float
    log_odds: float


@dataclass(frozen=True, kw_only=True)
class Course:
    """One parameter of one effect on one vehicle, in order of date."""

    effect: str
    parameter: str
    unit: str
    sizes: tuple[Sized, ...]
    change: SizeChange | None


@dataclass(frozen=True, kw_only=True)
class VehicleSeason:
    """What is known of one vehicle."""

    vehicle: str
    board: str
    firmware: str
    frame: str
    first: str
    last: str
    """Dates."""
    judged: int
    courses: tuple[Course, ...]
    new: tuple[str, ...]
    """Effects of the vehicle that the last log has, and no log before it."""
    not_judged: tuple[tuple[str, str], ...]
    """Logs, and why."""

    @property
    def changed(self) -> list[Course]:
        """Parameters that are not as they were."""
        return [course for course in self.courses if course.change is not None]


@dataclass(frozen=True, kw_only=True)
class Season:
    """All vehicles of a store."""

    vehicles: tuple[VehicleSeason, ...]
    common: tuple[str, ...]
    """Effects that half of the vehicles have, of two or more."""
    unknown: tuple[tuple[str, str], ...]
    """Logs that do not say of which vehicle they are, and why they are not judged."""

    def as_json(self) -> dict[str, Any]:
        """The keys that docs/formats.md describes."""
        return {
            "vehicles": [_vehicle_json(v) for v in self.vehicles],
            "common": list(self.common),
            "unknown": [{"log": log, "why": why} for log, why in self.unknown],
        }

    def as_text(self) -> str:
        """A few lines for a person."""
        logs = sum(v.judged for v in self.vehicles)
        lines = [f"vehicles: {len(self.vehicles)}, logs judged: {logs}"]
        for v in self.vehicles:
            lines += _vehicle_text(v)
        if self.common:
            lines.append(f"on half of the vehicles or more: {', '.join(self.common)}")
        if self.unknown:
            lines.append(f"{len(self.unknown)} logs do not say of which vehicle they are")
        return "\n".join(lines)


@dataclass(frozen=True)
class Wanted:
    """What of a store is asked about; None: all."""

    vehicle: str | None = None
    effect: str | None = None
    first: date | None = None
    last: date | None = None
    """Days, both included."""

    def has(self, row: Row) -> bool:
        """Whether a log is of the vehicle and of these days."""
        day = (row["date"] or "")[:10]
        if self.first is not None and day < self.first.isoformat():
            return False
        if self.last is not None and day > self.last.isoformat():
            return False
        return self.vehicle in (None, row["vehicle"])


ALL = Wanted()


def season(store: Store, wanted: Wanted = ALL) -> Season:
    """The vehicles, by the newest answer to every log."""
    by_vehicle: dict[str, list[Row]] = {}
    unknown = []
    for row in filter(wanted.has, _newest(store)):
        if row["vehicle"] is None:
            unknown.append((row["path"], row["error"] or "does not say"))
        else:
            by_vehicle.setdefault(row["vehicle"], []).append(row)
    effects: dict[tuple[str, str], list[Row]] = {}
    for row in store.rows("SELECT * FROM effects"):
        if wanted.effect in (None, row["effect"]):
            effects.setdefault((row["sha256"], row["question"]), []).append(row)
    vehicles = tuple(_vehicle(name, rows, effects) for name, rows in sorted(by_vehicle.items()))
    return Season(vehicles=vehicles, common=_common(vehicles), unknown=tuple(unknown))


def _newest(store: Store) -> list[Row]:
    """Of every log the answer that was added last, in order of date."""
    newest: dict[str, Row] = {}
    for row in store.rows("SELECT * FROM logs ORDER BY rowid"):
        newest[row["sha256"]] = row
    return sorted(newest.values(), key=lambda row: (row["date"] or "", row["path"]))


def _vehicle(
    name: str,
    logs: Sequence[Row],
    effects: Mapping[tuple[str, str], Sequence[Row]],
) -> VehicleSeason:
    judged = [row for row in logs if row["error"] is None]
    of_log = {row["sha256"]: effects.get((row["sha256"], row["question"]), []) for row in judged}
    last = logs[-1]
    names = [_names(of_log[row["sha256"]]) for row in judged]
    new: set[str] = set()
    if len(names) > 1:
        new = names[-1] - set().union(*names[:-1])
    return VehicleSeason(
        vehicle=name,
        board=last["board"] or "",
        firmware=last["firmware"] or "",
        frame=last["frame"] or "",
        first=logs[0]["date"] or "",
        last=last["date"] or "",
        judged=len(judged),
        courses=tuple(_courses(judged, of_log)),
        new=tuple(sorted(new)),
        not_judged=tuple((row["path"], row["error"]) for row in logs if row["error"] is not None),
    )


def _names(effects: Sequence[Row]) -> set[str]:
    """What of a log's effects the next flight has, too: every day has another wind."""
    return {row["effect"] for row in effects if row["kept"]}


def _courses(logs: Sequence[Row], of_log: Mapping[str, Sequence[Row]]) -> Iterable[Course]:
    """Every parameter with a size, over all logs that have it."""
    sizes: dict[tuple[str, str, str], list[Sized]] = {}
    for row in logs:
        for e in of_log[row["sha256"]]:
            if e["value"] is None or e["low"] is None or not e["kept"]:
                continue
            key = (e["effect"], e["parameter"], e["unit"] or "")
            sizes.setdefault(key, []).append(
                Sized(
                    log=row["path"],
                    date=row["date"] or "",
                    value=e["value"],
                    low=e["low"],
                    high=e["high"],
                )
            )
    for (effect, parameter, unit), course in sorted(sizes.items()):
        yield Course(
            effect=effect,
            parameter=parameter,
            unit=unit,
            sizes=tuple(course),
            change=change_of(course),
        )


def change_of(sizes: Sequence[Sized]) -> SizeChange | None:
    """The likeliest change of a parameter over its logs; None where one mean will do."""
    values = np.array([s.value for s in sizes])
    step = change_of_sizes(values, np.array([s.sd for s in sizes]))
    if step is None:
        return None
    return SizeChange(
        since=sizes[step.at].log,
        date=sizes[step.at].date,
        before=step.before,
        after=step.after,
        log_odds=step.log_odds,
    )


def _common(vehicles: Sequence[VehicleSeason]) -> tuple[str, ...]:
    judged = [v for v in vehicles if v.judged]
    if len(judged) < FLEET:
        return ()
    count: Counter[str] = Counter()
    for v in judged:
        count.update({course.effect for course in v.courses})
    return tuple(sorted(name for name, n in count.items() if n >= max(OFTEN * len(judged), 2.0)))


def _vehicle_json(v: VehicleSeason) -> dict[str, Any]:
    return {
        "vehicle": v.vehicle,
        "board": v.board,
        "firmware": v.firmware,
        "frame": v.frame,
        "first": v.first,
        "last": v.last,
        "judged": v.judged,
        "sizes": [_course_json(course) for course in v.courses],
        "new": list(v.new),
        "not_judged": [{"log": log, "why": why} for log, why in v.not_judged],
    }


def _course_json(course: Course) -> dict[str, Any]:
    change = course.change
    out: dict[str, Any] = {
        "effect": course.effect,
        "parameter": course.parameter,
        "unit": course.unit,
        "logs": [
            {"log": s.log, "date": s.date, "value": s.value, "interval": [s.low, s.high]}
            for s in course.sizes
        ],
        "change": None,
    }
    if change is not None:
        out["change"] = {
            "since": change.since,
            "date": change.date,
            "before": change.before,
            "after": change.after,
            "log_odds": change.log_odds,
        }
    return out


def _vehicle_text(v: VehicleSeason) -> list[str]:
    kind = ", ".join(text for text in (v.frame, v.firmware) if text)
    head = f"{v.vehicle} ({kind}): logs judged: {v.judged}, {v.first[:10]} to {v.last[:10]}"
    lines = [head]
    for course in v.changed:
        assert course.change is not None
        change = course.change
        lines.append(
            f"  {course.effect} {course.parameter} {change.before:.3g} -> {change.after:.3g} "
            f"{course.unit} since {change.since}"
        )
    if v.new:
        lines.append(f"  new on the last log: {', '.join(v.new)}")
    for log, why in v.not_judged:
        lines.append(f"  not judged: {log}: {why}")
    return lines
