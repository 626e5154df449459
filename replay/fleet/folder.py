"""A whole folder: find the logs, do what is not done yet, write the table and the page."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from models.common.arguments import installed_version, speaks
from models.common.errors import ConfigError, LogError
from models.common.pages.document import write_document
from models.common.text_file import make_folder, write_json
from replay.command import check_declared, check_targets, given
from replay.fleet.contents import contents
from replay.fleet.jobs import Job, work
from replay.fleet.page import page
from replay.fleet.results import Answers, keep, known, logs_in, write_table
from replay.fleet.store import NAME, Store
from replay.fleet.vehicles import Assigned, assign, named
from replay.fleet.workers import USABLE_BYTES, Place
from replay.pipeline_options import LOG_MINUTES
from replay.progress import Progress

_NEEDED_BYTES = {"run": 400e6, "diagnose": 2.0e9}
"""Of a long log: it is read in blocks, and two hours of it are diagnosed (docs/logs.md)."""
WRITE_EVERY_S = 300.0
"""Table and page, at most as often."""
_UNDRAFTED = {"--mass": None, "--propeller": None, "--span": None}
"""A draft has these already."""


@dataclass(frozen=True, kw_only=True)
class FolderAnswers:
    """What came of a folder."""

    answers: Answers
    """One a content, in order of name."""
    bad: dict[Path, str]
    """Logs that could not be used, and why."""
    notes: list[str]
    written: dict[str, str]
    """Table and page."""


def run_folder(a: argparse.Namespace, folder: Path, options: Mapping[str, Any]) -> int:
    """The command of ``a`` with these ``options`` on every log below ``folder``. 0 where one was used, else 3."""
    check_folder(a)
    paths, packed = logs_in(folder)
    found = answer_folder(a, folder, options, paths)
    errors = [f"{log}: {error}" for log, error in found.bad.items()]
    for line in [*packed, *found.notes, *errors]:
        print(f"replay: {line}", file=sys.stderr)
    if a.json is not None:
        write_json({"folder": str(folder), "logs": list(found.answers), **found.written}, a.json)
    count = len(found.answers)
    if speaks(a):
        print(
            f"{count - len(found.bad)} of {count} logs\ntable: {found.written['table']}\npage: "
            f"{found.written['page']}"
        )
    if len(found.bad) < count:
        return 0
    return LogError.exit_code


def check_folder(a: argparse.Namespace) -> None:
    """A wrong option or file, and a missing package, are said once, before the work."""
    if a.workers is not None and not 1 <= a.workers <= 1024:
        raise ConfigError(f"--workers {a.workers}: must be 1 to 1024")
    if a.scheduler is not None and "://" not in a.scheduler:
        raise ConfigError(
            f"--scheduler {a.scheduler}: must be an address such as tcp://10.0.0.5:8786"
        )
    if a.scheduler is not None and a.workers is not None:
        raise ConfigError(
            "--workers: is of this machine, and --scheduler names a cluster, which has workers of "
            "its own; leave one of them out"
        )
    for option, unit in (("log_minutes", "minutes"), ("log_gb", "GB")):
        number = getattr(a, option)
        if number is not None and not 0.0 < number < math.inf:
            said = f"--{option.replace('_', '-')} {number:g}"
            raise ConfigError(f"{said}: must be {unit} above 0")
    check_targets(a)
    check_declared(a.vehicle, a.model)
    if a.command == "diagnose":
        import_module("replay.diagnosis.diagnose")
        if a.vehicles is not None:
            named(a.vehicles)


def out_of(a: argparse.Namespace, folder: Path) -> Path:
    """Where the answers are."""
    return a.out or Path(_title(a, folder))


def _title(a: argparse.Namespace, folder: Path) -> str:
    return f"{folder.resolve().name}-{a.command}"


def answer_folder(
    a: argparse.Namespace, folder: Path, options: Mapping[str, Any], paths: Sequence[Path]
) -> FolderAnswers:
    """The answers to the logs of ``paths``, kept in ``--out``, and table and page of them.

    An interrupted run goes on where it stopped: answers that are there are not computed again.
    """
    title = _title(a, folder)
    out = out_of(a, folder)
    make_folder("--out", out)
    done: list[Job] = []
    failed: dict[Job, str] = {}
    with _store(a, out) as store:
        found = contents(paths, store)
        notes = [f"{copy}: is a copy of {first}" for copy, first in found.copies]
        notes += _forgotten(found.grown, store)
        assigned = _assigned(a, found.logs, out, store)
        notes += assigned.notes
        jobs = _jobs(a, found.logs, options, assigned.files)
        due = _Due()
        try:
            for job, answer in _answers(a, out, jobs, store, assigned.drafts):
                done.append(job)
                if "error" in answer:
                    failed[job] = answer["error"]
                if due.now():
                    _write(a, out, title, Answers(out, done))
                    due.done()
        except BaseException:
            # An interrupted run shows what it has; one that never began changes no table.
            if done:
                _write(a, out, title, Answers(out, done))
            raise
    answers = Answers(out, jobs)
    return FolderAnswers(
        answers=answers,
        bad={job.log: failed[job] for job in jobs if job in failed},
        notes=notes,
        written=_write(a, out, title, answers),
    )


class _Due:
    """When table and page are written as the work goes: seldom enough to take a twentieth of the time at most."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._wait_s = WRITE_EVERY_S

    def now(self) -> bool:
        """Whether they are due; the writing begins."""
        if time.monotonic() - self._start < self._wait_s:
            return False
        self._start = time.monotonic()
        return True

    def done(self) -> None:
        """They are written."""
        taken_s = time.monotonic() - self._start
        self._wait_s = max(WRITE_EVERY_S, 20.0 * taken_s)


def _forgotten(grown: Sequence[tuple[Path, str]], store: Store | None) -> list[str]:
    """Forget what was said of the beginnings of logs, and say so."""
    if store is not None:
        for _, sha256 in grown:
            store.forget(sha256)
    return [f"{path}: has grown since it was answered: is asked anew" for path, _ in grown]


def _jobs(
    a: argparse.Namespace,
    logs: Mapping[str, Path],
    options: Mapping[str, Any],
    vehicles: Mapping[str, Path],
) -> list[Job]:
    """One job for every content; ``logs`` and ``vehicles`` by sha256. A log that is gone meanwhile is left out."""
    if a.report is None:
        pages = None
    else:
        pages = (a.report / "logs").resolve()
    common = {**options, **_places(a)}
    jobs = []
    for sha256, log in logs.items():
        of_log = common
        if sha256 in vehicles:
            of_log = {**common, **_UNDRAFTED, "--vehicle": vehicles[sha256]}
        try:
            jobs.append(Job.of(a.command, log, of_log, pages, sha256))
        except OSError as error:
            print(f"replay: {log}: {error.strerror or error}", file=sys.stderr)
    return jobs


def _places(a: argparse.Namespace) -> dict[str, Any]:
    """Options that every log has alike; places are absolute."""
    model = a.model
    if model is not None and Path(model).is_dir():
        model = Path(model).resolve()
    return {
        "--vehicle": None if a.vehicle is None else a.vehicle.resolve(),
        "--model": model,
        "--target-system": a.target_system,
    }


def _assigned(
    a: argparse.Namespace, logs: Mapping[str, Path], out: Path, store: Store | None
) -> Assigned:
    """Vehicle files by identity: those of ``--vehicles``, and drafts; none where one is given for all."""
    if store is None or a.vehicle is not None:
        return Assigned()
    return assign(
        logs,
        {} if a.vehicles is None else named(a.vehicles),
        given(a),
        target_system=a.target_system,
        out=out.resolve(),
        store=store,
        place=_place(a),
        quiet=a.quiet,
    )


def _place(a: argparse.Namespace) -> Place:
    """Here no more workers than fit into memory together, each with a long log."""
    most_bytes = None if a.log_gb is None else 1e9 * a.log_gb
    fitting = int(USABLE_BYTES / (most_bytes or _NEEDED_BYTES[a.command]))
    wished = a.workers or len(os.sched_getaffinity(0))
    return Place(
        workers=max(min(wished, fitting), 1),
        scheduler=a.scheduler,
        most_s=60.0 * (a.log_minutes or LOG_MINUTES),
        most_bytes=most_bytes,
    )


def _answers(
    a: argparse.Namespace,
    out: Path,
    jobs: Sequence[Job],
    store: Store | None,
    drafts: Mapping[str, Mapping[str, Any]],
) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Those of an earlier run, and what had to be worked out, which is kept for the next.

    ``drafts``: what the logs' vehicles are drafted from, by sha256.
    """
    waiting = []
    for job in jobs:
        old = _known(a, out, job)
        if old is None:
            waiting.append(job)
        else:
            _into(store, job, old)
            yield job, old
    told = len(jobs) - len(waiting)
    if told and speaks(a):
        print(f"{len(jobs)} logs, {told} of them known from before")
    progress = Progress(what="logs", total=len(jobs), done=told, quiet=a.quiet)
    working = work(waiting, _place(a))
    for job, found in progress.counted(working, failed=lambda done: "error" in done[1]):
        answer = dict(found)
        if job.sha256 in drafts and "error" not in answer:
            draft = drafts[job.sha256]
            answer["vehicle"] = draft["vehicle"]
            answer["notes"] = [*draft["notes"], *answer["notes"]]
        keep(out, job, answer)
        _into(store, job, answer)
        yield job, answer


def _into(store: Store | None, job: Job, answer: Mapping[str, Any]) -> None:
    if store is not None:
        store.add(job.question, answer)


def _known(a: argparse.Namespace, out: Path, job: Job) -> dict[str, Any] | None:
    """The answer of an earlier run, unless it is asked for again; where the log lies today."""
    answer = known(out, job)
    if answer is None:
        return None
    if a.retry and answer.get("passing"):
        return None
    if a.refresh and answer.get("version") != installed_version():
        return None
    return {**answer, "log": str(job.log)}


@contextmanager
def _store(a: argparse.Namespace, out: Path) -> Iterator[Store | None]:
    """The store of the folder; replays have none."""
    if a.command != "diagnose":
        yield None
        return
    with Store.open(out / NAME, make=True) as store:
        yield store


def _write(a: argparse.Namespace, out: Path, title: str, answers: Answers) -> dict[str, str]:
    """Table and page of the answers that are there."""
    target = (a.report or out) / "report.html"
    return {
        "table": str(write_table(out / "table.csv", answers)),
        "page": str(write_document("--report", target, page(title, answers))),
    }
