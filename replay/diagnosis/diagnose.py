"""``replay diagnose`` as a function: logs in, what the declared model lacks out; one flight or several at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from models.common.errors import LogError
from models.effects import AdoptedEffect, Effect, catalogue
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.diagnosis.answer import Diagnosis
from replay.diagnosis.stretches import Stretches
from replay.flightlog import FlightLog
from replay.logs.formats import load
from replay.residual.motion import ENOUGH_S
from replay.residual.record import Record, build_record, check_model, too_short
from replay.search.curves import CarryingChannel
from replay.search.held_out import FlightFit
from replay.search.results import Found, summarise
from replay.search.walk import walk
from replay.vehicle.identity import identity


def diagnose(
    paths: Sequence[Path],
    vehicle: Vehicle,
    model: FanSurrogate | None,
    *,
    target_system: int | None = None,
    settings: Mapping[str, str] | None = None,
    read: dict[Path, list[FlightLog]] | None = None,
    progress: Callable[[Sequence[Path]], Iterable[Path]] = lambda paths: paths,
) -> Diagnosis:
    """Read, compare, search, and answer. ``progress`` may wrap the logs while they are read.

    ``settings``: the instance to read, by quantity. Logs in ``read`` are not read again; they are taken out, so that
    none stays in memory for the search.
    """
    if read is None:
        held = {}
    else:
        held = read
    records, notes = read_records(
        progress(paths),
        vehicle,
        model,
        target_system,
        settings=settings,
        read=held,
    )
    return conclude(records, notes)


def conclude(
    records: Sequence[Record], notes: Sequence[str] = (), *, effects: Sequence[Effect] | None = None
) -> Diagnosis:
    """One answer from one flight or several together; ``effects`` instead of the whole catalogue."""
    searched = summarise(walk(records, catalogue() if effects is None else effects))
    channels = _channels(searched.traces)
    open_ = bool(channels) or any(t.outside for t in searched.traces)
    faults = tuple(dict.fromkeys(f for r in records for f in r.faults))
    named = bool(searched.found) or any(fault.loss is not None for fault in faults)
    verdict = {
        (False, False): "nothing_missing",
        (False, True): "unexplained",
        (True, False): "explained",
        (True, True): "partly_explained",
    }[named, open_]
    if not any(r.axes for r in records):
        verdict = "not_judged"
    all_notes = [
        *notes,
        *_left_out(searched.left_out),
        *_remarks(searched.found, records),
        *dict.fromkeys(note for r in records for note in r.notes),
    ]
    answer = Diagnosis(
        traces=searched.traces,
        found=searched.found,
        rejected=searched.rejected,
        visible=searched.visible,
        left_out=searched.left_out,
        channels=channels,
        verdict=verdict,
        notes=tuple(all_notes),
        faults=faults,
    )
    return replace(answer, notes=(*answer.notes, *_one_wind(answer)))


def read_records(
    paths: Iterable[Path],
    vehicle: Vehicle,
    model: FanSurrogate | None,
    target_system: int | None,
    settings: Mapping[str, str] | None = None,
    read: dict[Path, list[FlightLog]] | None = None,
) -> tuple[list[Record], list[str]]:
    """Flights of some logs, and what is to be said of reading them; logs are taken out of ``read`` where it has them.

    LogError where none can be judged, ConfigError where the vehicle file lacks what the empty model needs.
    """
    check_model(vehicle, model)
    records: list[Record] = []
    notes: list[str] = []
    problems: list[LogError] = []
    effects: tuple[AdoptedEffect, ...]
    if model is None:
        effects = ()
    else:
        effects = model.effects
    for path in paths:
        said: dict[str, None] = {}
        own = Stretches()
        boot = 0
        try:
            if read is not None and path in read:
                boots = read.pop(path)
            else:
                boots = load(path, target_system, settings)
            for log in boots:
                boot = log.boot
                who = identity(log)
                for part in log.stretches():
                    if not own.wants_next():
                        continue
                    said |= dict.fromkeys(part.summary.notes)
                    try:
                        record = build_record(part, vehicle, model, effects, _name(part, log))
                        own.add(replace(record, identity=who))
                    except LogError as error:
                        problems.append(error)
        except LogError as error:
            problems.append(error)
        alone = len(own.records) == 1 and not boot
        records += [replace(own.records[0], name=path.name)] if alone else own.records
        if boot:
            notes.append(
                f"{path.name}: the vehicle started {boot + 1} times; every start is a flight of "
                "its own"
            )
        notes += [f"{path.name}: {note}" for note in (*own.notes(), *said)]
    if not records:
        raise problems[0]
    if sum(r.seconds for r in records) < ENOUGH_S:
        raise too_short(max(records, key=lambda r: r.seconds))
    return records, notes + [f"left out: {p}" for p in problems]


def _name(part: FlightLog, log: FlightLog) -> str:
    """Of a record: file and boot, and which time of it where a boot comes in stretches."""
    if part is log:
        since = ""
    else:
        since = f", from {(part.start_s - log.start_s) / 60.0:.0f} min"
    return f"{log.path.name} (boot {log.boot + 1}{since})"


def _channels(traces: Sequence[FlightFit]) -> tuple[CarryingChannel, ...]:
    """Channels that carry what is left, each where it carries most, in the order of the flights."""
    best: dict[str, CarryingChannel] = {}
    for c in (c for t in traces for c in t.carriers):
        if c.name not in best or c.score > best[c.name].score:
            best[c.name] = c
    return tuple(best.values())


def _left_out(what: Sequence[str]) -> list[str]:
    """A search that would take too long stops with the best that it has."""
    if not what:
        return []
    return [
        f"left out of the search, which would take too long: {', '.join(what)}; a part of the "
        "flight takes less"
    ]


def _one_wind(answer: Diagnosis) -> list[str]:
    """Only flights in different winds separate drag from wind."""
    kept = f"{1.0 - answer.of_one_wind:.0%}"
    if kept == "100%":
        return []
    return [
        f"one flight in one wind does not separate drag from wind: an amended model keeps {kept} "
        "of the drag and of the inflow; diagnose it together with a flight in another wind"
    ]


def _remarks(found: Sequence[Found], records: Sequence[Record]) -> list[str]:
    """What effects say of parameters that the flights do not determine."""
    out = []
    for f in found:
        remark = f.effect.shown.remark
        if remark is None:
            note = None
        else:
            note = remark({e.name: e.determined for e in f.fitted})
        if note is not None:
            out.append(f"{records[f.flight].name}: {note}")
    return out
