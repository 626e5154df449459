"""``replay diagnose TODAY --since GOOD...`` as a function: what changed since good flights, and since which log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.change_point import change_of_names
from replay.changes.changes import Baseline, Change, changes, learn
from replay.diagnosis.diagnose import read_records
from replay.diagnosis.words import estimate_text, plain
from replay.fleet.jobs import recorded
from replay.numbers import rounded
from replay.report import render
from replay.residual.record import Record


@dataclass(frozen=True)
class ChangeReport:
    """The answer: changes since the good flights that stay, first cause first; usually none."""

    good: Baseline
    flights: tuple[tuple[Record, tuple[Change, ...]], ...]
    """Every flight with what changed on it."""
    changed: tuple[Change, ...]
    """Each with the first log that shows it, and its size on the latest flight that does."""
    notes: tuple[str, ...]

    @property
    def records(self) -> list[Record]:
        """All flights, the good ones first."""
        return [*self.good.records, *(r for r, _ in self.flights)]

    def as_json(self) -> dict[str, Any]:
        """The JSON that docs/formats.md describes."""
        content: dict[str, Any] = rounded(
            {
                "logs": list(dict.fromkeys(str(r.path) for r, _ in self.flights)),
                "good": list(dict.fromkeys(str(r.path) for r in self.good.records)),
                "changed": [c.as_json() | {"since": c.since} for c in self.changed],
                "flights": [
                    {"log": r.name, "changed": [c.as_json() for c in own]}
                    for r, own in self.flights
                ],
                "notes": self.notes,
            }
        )
        return content

    def as_text(self) -> str:
        """A few lines for a person."""
        if self.changed:
            head = "changed"
        else:
            head = "nothing changed"
        lines = [f"{head}  ({len(self.flights)} against {len(self.good.records)} good flights)"]
        for c in self.changed:
            sizes = ", ".join(map(estimate_text, c.estimates))
            lines.append(f"  {c.name} since {c.since} (probability {c.probability:.2f}): {sizes}")
            if c.aliases:
                lines.append(f"    or {', '.join(c.aliases)}; to separate them: {c.effect.excite}")
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])


def since(
    logs: Sequence[Path],
    good: Sequence[Path],
    vehicle: Vehicle,
    model: FanSurrogate | None,
    *,
    target_system: int | None = None,
    progress: Callable[[Sequence[Path]], Iterable[Path]] = lambda paths: paths,
) -> ChangeReport:
    """Compare flights, in order of their date, with the vehicle as its good flights show it."""
    learnt, said = read_records(good, vehicle, model, target_system)
    as_it_was = learn(learnt)
    notes = []
    ordered = by_date(logs)
    if ordered != list(logs):
        notes.append(
            f"the logs were not given in order of their date: {ordered[0].name} is the first"
        )
    records, more = read_records(progress(ordered), vehicle, model, target_system)
    flights = tuple((r, changes(as_it_was, r)) for r in records)
    stays = []
    for name in dict.fromkeys(c.name for _, own in flights for c in own):
        shows = []
        for _, own in flights:
            shows.append([c for c in own if c.name == name])
        at = change_of_names([bool(own) for own in shows])
        if at is None:
            notes.append(f"{name} on single flights only")
        else:
            latest = [c for own in shows[at:] for c in own][-1]
            stays.append(replace(latest, since=flights[at][0].name))
    return ChangeReport(as_it_was, flights, tuple(stays), (*notes, *dict.fromkeys((*said, *more))))


def page(answer: ChangeReport, vehicle: Vehicle, faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The text as one HTML page. ``faults``: ``channel`` and ``what`` of a model or file of another vehicle."""
    findings = [f"{plain(c.name).capitalize()} changed since {c.since}" for c in answer.changed]
    good = ", ".join(r.name for r in answer.good.records)
    return render(
        "answer.html",
        vehicle=vehicle,
        head="; ".join(findings) or "Nothing changed",
        verdict=f"{vehicle.name}, compared with the good flights {good}",
        sentences=[
            *(f"{f['channel']}: {f['what']}" for f in faults),
            *answer.as_text().splitlines(),
        ],
        bad=bool(answer.changed or faults),
    )


def by_date(logs: Sequence[Path]) -> list[Path]:
    """Logs in the order in which they were recorded; without dates of their own as given."""
    dates = {log: recorded(log) for log in logs}
    if any(d["date_from"] != "log" for d in dates.values()):
        return list(logs)
    return sorted(logs, key=lambda log: dates[log]["date"])
