"""``replay season``: what the answers of a store say of every vehicle over time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any, overload

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

    vehicles: Vehicles
    altered: tuple[str, ...]
    """Names of vehicles that are not as they were."""
    judged: int
    """Logs."""
    common: tuple[str, ...]
    """Effects that half of the vehicles have, of two or more."""
    effects: tuple[str, ...]
    """Of any vehicle."""
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
        lines = [f"vehicles: {len(self.vehicles)}, logs judged: {self.judged}"]
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

    @property
    def values(self) -> dict[str, str | None]:
        """Of ``_WANTED``."""
        return {
            "vehicle": self.vehicle,
            "first": None if self.first is None else self.first.isoformat(),
            "last": None if self.last is None else self.last.isoformat(),
        }


ALL = Wanted()
_WANTED = """
FROM logs AS log
WHERE NOT EXISTS (
    SELECT 1 FROM logs AS newer WHERE newer.sha256 = log.sha256 AND newer.rowid > log.rowid
)
AND (:vehicle IS NULL OR vehicle = :vehicle)
AND (:first IS NULL OR substr(coalesce(date, ''), 1, 10) >= :first)
AND (:last IS NULL OR substr(coalesce(date, ''), 1, 10) <= :last)
"""
"""Of every log the answer that was added last."""
_IN_ORDER = "ORDER BY coalesce(date, ''), path"


class Vehicles(Sequence[VehicleSeason]):
    """Of a store in order of name, each read when it is looked at: memory holds one, of however many logs."""

    def __init__(self, store: Store, wanted: Wanted) -> None:
        self._store = store
        self._wanted = wanted
        found = store.rows(
            f"SELECT DISTINCT vehicle {_WANTED} AND vehicle IS NOT NULL ORDER BY vehicle",
            wanted.values,
        )
        self.names = [row["vehicle"] for row in found]
        self._changes: dict[tuple[str, str, str], SizeChange | None] = {}
        """Looking for one takes longer than reading the sizes."""

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, place: int) -> VehicleSeason: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[VehicleSeason]: ...
    def __getitem__(self, place: int | slice) -> VehicleSeason | Sequence[VehicleSeason]:
        """One is read from the store."""
        if isinstance(place, slice):
            return [self.named(name) for name in self.names[place]]
        return self.named(self.names[place])

    def named(self, name: str) -> VehicleSeason:
        """The vehicle of a name."""
        values = {**self._wanted.values, "name": name, "effect": self._wanted.effect}
        of_name = f"{_WANTED} AND vehicle = :name"
        logs = self._store.rows(f"SELECT * {of_name} {_IN_ORDER}", values)
        effects: dict[str, list[Row]] = {}
        for row in self._store.rows(
            f"SELECT e.* FROM (SELECT sha256, question {of_name}) CROSS JOIN effects AS e "
            "USING (sha256, question) WHERE :effect IS NULL OR effect = :effect ORDER BY e.rowid",
            values,
        ):
            effects.setdefault(row["sha256"], []).append(row)
        return self._vehicle(name, logs, effects)

    def _vehicle(
        self, name: str, logs: Sequence[Row], effects: Mapping[str, Sequence[Row]]
    ) -> VehicleSeason:
        judged = [row for row in logs if row["error"] is None]
        last = logs[-1]
        names = [_names(effects.get(row["sha256"], ())) for row in judged]
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
            courses=tuple(self._courses(name, judged, effects)),
            new=tuple(sorted(new)),
            not_judged=tuple(
                (row["path"], row["error"]) for row in logs if row["error"] is not None
            ),
        )

    def _courses(
        self, vehicle: str, logs: Sequence[Row], effects: Mapping[str, Sequence[Row]]
    ) -> Iterator[Course]:
        """Every parameter with a size, over all logs that have it."""
        sizes: dict[tuple[str, str, str], list[Sized]] = {}
        for row in logs:
            for e in effects.get(row["sha256"], ()):
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
            known = (vehicle, effect, f"{parameter} {unit}")
            if known not in self._changes:
                self._changes[known] = change_of(course)
            yield Course(
                effect=effect,
                parameter=parameter,
                unit=unit,
                sizes=tuple(course),
                change=self._changes[known],
            )


def season(store: Store, wanted: Wanted = ALL) -> Season:
    """The vehicles, by the newest answer to every log; as long as the store is open."""
    vehicles = Vehicles(store, wanted)
    altered = []
    judged = 0
    of_effect: Counter[str] = Counter()
    flown = 0
    for v in vehicles:
        judged += v.judged
        flown += v.judged > 0
        of_effect.update({course.effect for course in v.courses})
        if v.changed or v.new:
            altered.append(v.vehicle)
    unknown = store.rows(
        f"SELECT path, error {_WANTED} AND vehicle IS NULL {_IN_ORDER}", wanted.values
    )
    return Season(
        vehicles=vehicles,
        altered=tuple(altered),
        judged=judged,
        common=_common(of_effect, flown),
        effects=tuple(sorted(of_effect)),
        unknown=tuple((row["path"], row["error"] or "does not say") for row in unknown),
    )


def _names(effects: Sequence[Row]) -> set[str]:
    """What of a log's effects the next flight has, too: every day has another wind."""
    return {row["effect"] for row in effects if row["kept"]}


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


def _common(of_effect: Counter[str], vehicles: int) -> tuple[str, ...]:
    """By vehicles of every effect, of those that were judged."""
    if vehicles < FLEET:
        return ()
    least = max(OFTEN * vehicles, 2.0)
    return tuple(sorted(name for name, count in of_effect.items() if count >= least))


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
    latest = {why: log for log, why in v.not_judged}
    count = Counter(why for _, why in v.not_judged)
    for why, log in latest.items():
        many = f"{count[why]} logs, the latest " if count[why] > 1 else ""
        lines.append(f"  not judged: {many}{log}: {why}")
    return lines
