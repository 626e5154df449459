"""``replay diagnose FOLDER --watch``: looks at a folder, and says only what is new."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from models.common.arguments import speaks
from models.common.errors import LogError
from models.common.text_file import write_json
from replay.fleet.folder import answer_folder, out_of
from replay.fleet.results import logs_in
from replay.fleet.season import season
from replay.fleet.store import NAME, Store

CHANGED = 1
"""Exit code where a vehicle is not as it was, and that was not said before."""
SETTLED_S = 10.0
"""A log that was changed so recently may still be written; the next look takes it."""


@dataclass(frozen=True)
class _Known:
    """What was known at a look."""

    logs: frozenset[str]
    """By sha256."""
    findings: Mapping[tuple[str, ...], str]
    """What is not as it was, and how it is said; by vehicle, effect and parameter."""


def watch(
    a: argparse.Namespace, folder: Path, options: Mapping[str, Any], every_s: float | None
) -> int:
    """Look once, or until it is interrupted every so many seconds. Returns the exit code of one look."""
    while True:
        code = _look(a, folder, options)
        if every_s is None:
            return code
        sys.stdout.flush()
        time.sleep(every_s)


def _look(a: argparse.Namespace, folder: Path, options: Mapping[str, Any]) -> int:
    paths = _settled(folder)
    if not paths:
        return 0
    store = out_of(a, folder) / NAME
    before = _known(store)
    silent = argparse.Namespace(**{**vars(a), "quiet": True})
    found = answer_folder(silent, folder, options, paths)
    new = [answer for answer in found.answers if answer["sha256"] not in before.logs]
    findings = _known(store).findings
    told = [text for key, text in findings.items() if key not in before.findings]
    if a.json is not None:
        write_json({"folder": str(folder), "logs": new, "changes": told}, a.json)
    if speaks(a):
        for line in [*map(_line, new), *told]:
            print(line)
    if told:
        return CHANGED
    if new and all("error" in answer for answer in new):
        return LogError.exit_code
    return 0


def _settled(folder: Path) -> list[Path]:
    """The logs that nobody writes any more."""
    try:
        paths, _ = logs_in(folder)
    except LogError:
        return []
    latest = time.time() - SETTLED_S
    return [path for path in paths if path.exists() and path.stat().st_mtime < latest]


def _known(file: Path) -> _Known:
    if not file.is_file():
        return _Known(frozenset(), {})
    with Store.open(file) as store:
        logs = frozenset(row["sha256"] for row in store.rows("SELECT sha256 FROM logs"))
        return _Known(logs, dict(_findings(store)))


def _findings(store: Store) -> Iterator[tuple[tuple[str, ...], str]]:
    for v in season(store).vehicles:
        for course in v.changed:
            assert course.change is not None
            change = course.change
            yield (
                (v.vehicle, course.effect, course.parameter),
                f"{v.vehicle}: {course.effect} {course.parameter} {change.before:.3g} -> "
                f"{change.after:.3g} {course.unit} since {change.since}",
            )
        for effect in v.new:
            yield (v.vehicle, effect), f"{v.vehicle}: {effect} is new on its last log"


def _line(answer: Mapping[str, Any]) -> str:
    if "error" in answer:
        return f"{answer['log']}: {answer['error']}"
    vehicle = answer.get("identity", {}).get("vehicle") or "unknown vehicle"
    effects = ", ".join(effect["name"] for effect in answer["effects"]) or "no effect"
    return f"{answer['log']}: {vehicle}: {answer['verdict'].replace('_', ' ')}: {effects}"
