"""Logs below a folder, their answers on disk, one file a log, and the table of all."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, overload

from models.common.errors import LogError
from models.common.pages.document import write_document
from models.common.text_file import make_folder, replaced
from replay.fleet.jobs import Job
from replay.logs.formats import known_suffixes

_COLUMNS = (
    "log",
    "date",
    "date_from",
    "error",
    "verdict",
    "duration_s",
    "wall_s",
    "axes",
    "effects",
    "decisions",
    "commands",
    "compensated_s",
    "share_compensated",
    "gaps_s",
    "refusals_s",
    "thrust",
    "roll_deg",
    "pitch_deg",
    "h_m",
    "d_m",
    "trust",
    "lift_n",
    "side_n",
)
"""Of the JSON, in the table."""


def logs_in(folder: Path) -> tuple[list[Path], list[str]]:
    """Every log below a folder in order of name, and a line for what looks like one and cannot be read."""
    suffixes = known_suffixes()
    files, notes = _files_in(folder)
    found = [p for p in files if p.suffix.lower() in suffixes]
    packed = [
        p
        for p in files
        if p.suffix.lower() not in suffixes
        and len(p.suffixes) > 1
        and p.suffixes[-2].lower() in suffixes
    ]
    notes += [f"{p}: is compressed: unpack it first" for p in packed]
    if not found:
        known = ", ".join(suffixes)
        raise LogError(f"{folder}: holds no log ({known}){'; ' + notes[0] if notes else ''}")
    return found, notes


def _files_in(folder: Path) -> tuple[list[Path], list[str]]:
    """Files below a folder in order of name, and a line for every folder that cannot be read.

    Links to folders are not followed, so that none is met twice.
    """
    notes = []

    def refused(error: OSError) -> None:
        notes.append(f"{error.filename}: {error.strerror}")

    files = []
    for place, _, names in os.walk(folder, onerror=refused):
        # os.path: a link in a circle is no file, and raises nothing.
        paths = [os.path.join(place, name) for name in names]
        files += [Path(path) for path in paths if os.path.isfile(path)]
    return sorted(files), notes


def known(out: Path, job: Job) -> dict[str, Any] | None:
    """The answer of an earlier run to exactly this question; None where it, or the page that goes with it, is gone."""
    try:
        answer: dict[str, Any] = json.loads(_file(out, job).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if "error" in answer or job.page is None or job.page.is_file():
        return answer
    return None


def keep(out: Path, job: Job, answer: dict[str, Any]) -> None:
    """Write an answer; an interruption leaves the whole file or none. Raises ConfigError."""
    write_document("--out", _file(out, job), json.dumps(answer, indent=1, allow_nan=False) + "\n")


def _file(out: Path, job: Job) -> Path:
    return out / "results" / f"{job.name}.json"


class Answers(Sequence[dict[str, Any]]):
    """To jobs that are done, each read when it is looked at: memory holds one, of however many logs."""

    def __init__(self, out: Path, jobs: Sequence[Job]) -> None:
        self._out = out
        self._jobs = jobs

    def __len__(self) -> int:
        return len(self._jobs)

    @overload
    def __getitem__(self, place: int) -> dict[str, Any]: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[dict[str, Any]]: ...
    def __getitem__(self, place: int | slice) -> dict[str, Any] | Sequence[dict[str, Any]]:
        """Where the log lies today, and the link to its page. An answer that somebody deleted is an error."""
        if isinstance(place, slice):
            return Answers(self._out, self._jobs[place])
        job = self._jobs[place]
        answer = known(self._out, job) or {
            "error": "its answer is gone",
            "date": "",
            "sha256": job.sha256,
        }
        return {**answer, "log": str(job.log), "page": job.link}


def row(answer: dict[str, Any]) -> dict[str, Any]:
    """Columns by their place in the JSON: ``axes.Fz.rms_before``, ``effects.payload.probability`` …"""
    effects: dict[str, Any] = {}
    for effect in answer.get("effects", []):
        effects.setdefault(effect["name"], effect)  # of two weak fans the one that explains more
    by_name = {"effects": effects}
    return dict(_flat({name: (answer | by_name)[name] for name in _COLUMNS if name in answer}))


def _flat(content: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        inner: Any
        if name == "ci95":
            inner = dict(zip(("low", "high"), value, strict=True))
        else:
            inner = value
        if isinstance(inner, Mapping):
            yield from _flat(inner, f"{before}{name}.")
        elif inner is not None and not isinstance(inner, list):
            yield before + name, inner


def write_table(target: Path, answers: Sequence[dict[str, Any]]) -> Path:
    """As CSV: a row a log, a column a name, empty where a log lacks it; whole, or the old one stays.

    Raises ConfigError.
    """
    columns: dict[str, None] = {}
    for answer in answers:
        columns |= dict.fromkeys(row(answer))
    make_folder("--out", target.parent)
    with (
        replaced("--out", target) as part,
        part.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.DictWriter(file, list(columns), lineterminator="\n")
        writer.writeheader()
        for answer in answers:
            writer.writerow(row(answer))
    return target
