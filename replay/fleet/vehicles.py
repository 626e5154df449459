"""Which vehicle file the logs of a folder are judged with: one given for their identity, or one draft for all of them.

A draft is made anew when its vehicle has twice as many logs as it was made from, up to what a draft looks at. Its logs
are then answered again, so that a folder that grows by a log a day does not answer all of them every day.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from companion.vehicles import chosen_vehicle
from models.common.errors import ConfigError, UserError
from models.common.pages.document import write_document
from models.common.text_file import make_folder
from replay.fleet.store import Store
from replay.fleet.workers import Lost, Place, results
from replay.identity import VehicleIdentity
from replay.logs.formats import load
from replay.progress import Progress
from replay.vehicle.draft import LOGS, draft
from replay.vehicle.given import Given
from replay.vehicle.identity import identity

FOLDER = "vehicles"
"""Of the drafts, below the answers."""


@dataclass(frozen=True)
class Assigned:
    """Vehicle files of logs."""

    files: Mapping[str, Path] = field(default_factory=dict)
    """By sha256; a log without one is drafted by itself."""
    drafts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Of those that were drafted, by sha256: ``vehicle`` and ``notes`` as an answer has them."""
    notes: tuple[str, ...] = ()


def assign(
    logs: Mapping[str, Path],
    given_files: Mapping[str, Path],
    given: Given,
    *,
    target_system: int | None,
    out: Path,
    store: Store,
    place: Place,
    quiet: bool = False,
) -> Assigned:
    """``logs`` by sha256; ``given_files`` by the names of ``named``."""
    known = _identities(logs, target_system, store, place, quiet)
    files = {}
    groups: dict[str, list[str]] = {}
    used = set()
    for sha256, who in known.items():
        file = fitting(given_files, who)
        if file is not None:
            files[sha256] = file
            used.add(file)
        elif (name := shared_name(who)) is not None:
            groups.setdefault(name, []).append(sha256)
    notes = [f"{file}: fits no log" for file in given_files.values() if file not in used]
    drafts = {}
    for name, group in groups.items():
        drafts[name] = [logs[sha256] for sha256 in group]
    made, failed = _drafted(
        drafts,
        given,
        target_system=target_system,
        folder=out / FOLDER,
        store=store,
        place=place,
        quiet=quiet,
    )
    said = {row["name"]: json.loads(row["facts"]) for row in store.rows("SELECT * FROM drafts")}
    told = {}
    for name, file in made.items():
        for sha256 in groups[name]:
            files[sha256] = file
            told[sha256] = said[name]
    return Assigned(files, told, (*notes, *failed))


def named(folder: Path) -> dict[str, Path]:
    """Vehicle files by what they are for. Raises ConfigError where one is wrong or there is none."""
    if not folder.is_dir():
        raise ConfigError(f"--vehicles {folder}: is no folder")
    files = {file.stem: file.resolve() for file in sorted(folder.glob("*.toml"))}
    if not files:
        raise ConfigError(f"--vehicles {folder}: holds no vehicle file (.toml)")
    for file in files.values():
        chosen_vehicle(file)
    return files


def fitting(files: Mapping[str, Path], who: VehicleIdentity) -> Path | None:
    """The file of a vehicle: by the hash of its parameters, its key, its board or its frame, the most special first."""
    for name in (who.parameters, who.vehicle, who.board, who.frame):
        if name and name in files:
            return files[name]
    return None


def shared_name(who: VehicleIdentity) -> str | None:
    """Of the draft that logs of one vehicle share; None where nothing tells the vehicle from others."""
    if who.board or who.vehicle.startswith("sensors-"):
        return who.vehicle
    if who.parameters:
        return f"parameters-{who.parameters}"
    return None


def _identities(
    logs: Mapping[str, Path],
    target_system: int | None,
    store: Store,
    place: Place,
    quiet: bool,
) -> dict[str, VehicleIdentity]:
    """Of all logs that can be read; each is read once."""
    out = {}
    for sha256 in logs:
        for row in store.rows("SELECT * FROM identities WHERE sha256 = ?", (sha256,)):
            out[sha256] = VehicleIdentity(
                vehicle=row["vehicle"],
                board=row["board"],
                firmware=row["firmware"],
                frame=row["frame"],
                parameters=row["parameters"],
            )
    unread = {sha256: log for sha256, log in logs.items() if sha256 not in out}
    identify = partial(_identity, target_system=target_system)
    progress = Progress(what="logs looked at for their vehicle", total=len(unread), quiet=quiet)
    working = results(identify, unread, place)
    for sha256, who in progress.counted(working, failed=lambda done: done[1] is None):
        if isinstance(who, VehicleIdentity):
            out[sha256] = who
            store.put("identities", [(sha256, *who.as_json().values())])
    return {sha256: out[sha256] for sha256 in logs if sha256 in out}


def _identity(log: Path, target_system: int | None) -> VehicleIdentity | None:
    """Of the longest boot; None where the log cannot be read, which its answer says."""
    try:
        boots = load(log, target_system)
    except (UserError, MemoryError):
        return None
    return identity(max(boots, key=lambda boot: boot.duration_s))


def _drafted(
    groups: Mapping[str, Sequence[Path]],
    given: Given,
    *,
    target_system: int | None,
    folder: Path,
    store: Store,
    place: Place,
    quiet: bool,
) -> tuple[dict[str, Path], list[str]]:
    """Vehicle files by name, and a line for every vehicle that cannot be drafted."""
    said = repr(given)
    before = {row["name"]: row for row in store.rows("SELECT * FROM drafts")}
    out = {name: folder / f"{name}.toml" for name in groups}
    wanted = {}
    for name, logs in groups.items():
        row = before.get(name)
        count = min(len(logs), LOGS)
        fresh = row is not None and row["given"] == said and count < 2 * row["logs"]
        if not fresh or not out[name].is_file():
            wanted[name] = logs
    failed = []
    if wanted:
        make_folder("--out", folder)
    draft_vehicle = partial(_draft, given=given, target_system=target_system)
    tasks = {name: (logs, out[name]) for name, logs in wanted.items()}
    of_draft = replace(place, most_s=LOGS * place.most_s)
    progress = Progress(what="vehicles drafted", total=len(tasks), quiet=quiet)
    working = results(draft_vehicle, tasks, of_draft)
    for name, done in progress.counted(working, failed=lambda one: isinstance(one[1], Lost)):
        if isinstance(done, _Drafted):
            store.put("drafts", [(name, min(len(wanted[name]), LOGS), said, done.facts)])
        else:
            del out[name]
            failed.append(
                f"{name}: has no draft of its own ({done.why}); each log is drafted alone"
            )
    return out, failed


@dataclass(frozen=True)
class _Drafted:
    """A vehicle file that is written."""

    facts: str
    """As JSON."""


def _draft(
    task: tuple[Sequence[Path], Path], given: Given, target_system: int | None
) -> _Drafted | Lost:
    """Write the vehicle file of some logs."""
    logs, file = task
    try:
        made = draft(logs, given, target_system)
        write_document("--out", file, made.as_toml())
    except (UserError, MemoryError) as error:
        return Lost(str(error) or "too little memory")
    told = {"vehicle": made.as_json(), "notes": list(made.notes)}
    return _Drafted(json.dumps(told))
