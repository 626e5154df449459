"""A whole folder: find the logs, do what is not done yet, write the table and the page."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from tqdm import tqdm

from models.common.arguments import installed_version, speaks
from models.common.errors import ConfigError, LogError
from models.common.pages.document import write_document
from models.common.text_file import write_json
from replay.command import check_declared, check_targets
from replay.fleet.jobs import Job, work
from replay.fleet.page import page
from replay.fleet.results import keep, known, logs_in, table
from replay.fleet.store import NAME, Store

SAY_EVERY_S = 30.0
"""Between two lines of a run whose output is redirected."""


def run_folder(a: argparse.Namespace, folder: Path, options: Mapping[str, Any]) -> int:
    """The command of ``a`` with these ``options`` on every log below ``folder``. 0 where one was used, else 3.

    An interrupted run goes on where it stopped: answers that are in ``--out`` are not computed again.
    """
    if a.workers is not None and not 1 <= a.workers <= 1024:
        raise ConfigError(f"--workers {a.workers}: must be 1 to 1024")
    if a.scheduler is not None and "://" not in a.scheduler:
        raise ConfigError(
            f"--scheduler {a.scheduler}: must be an address such as tcp://10.0.0.5:8786"
        )
    check_targets(a)
    # A wrong file and a missing package are said once, before the work.
    check_declared(a.vehicle, a.model)
    if a.command == "diagnose":
        import_module("replay.diagnosis.diagnose")
    paths, notes = logs_in(folder)
    title = f"{folder.resolve().name}-{a.command}"
    out = a.out or Path(title)
    if a.report is None:
        pages = None
    else:
        pages = (a.report / "logs").resolve()
    places = {
        "--vehicle": None if a.vehicle is None else a.vehicle.resolve(),
        "--model": Path(a.model).resolve()
        if a.model is not None and Path(a.model).is_dir()
        else a.model,
        "--target-system": a.target_system,
    }
    jobs, copies = _jobs(a, paths, {**options, **places}, pages)
    notes += [f"{copy}: is a copy of {first}" for copy, first in copies]
    out.mkdir(parents=True, exist_ok=True)
    by_job: dict[Job, dict[str, Any]] = {}
    try:
        for job, answer in _answers(a, out, jobs):
            by_job[job] = answer
    except BaseException:
        # An interrupted run shows what it has; one that never began changes no table.
        if by_job:
            _write(a, out, title, by_job)
        raise
    written = _write(a, out, title, by_job)
    answers = [by_job[job] for job in jobs]
    bad = [answer for answer in answers if "error" in answer]
    for line in [*notes, *(f"{answer['log']}: {answer['error']}" for answer in bad)]:
        print(f"replay: {line}", file=sys.stderr)
    if a.json is not None:
        write_json({"folder": str(folder), "logs": answers, **written}, a.json)
    if speaks(a):
        print(
            f"{len(jobs) - len(bad)} of {len(jobs)} logs\ntable: {written['table']}\npage: "
            f"{written['page']}"
        )
    if len(bad) < len(jobs):
        return 0
    return LogError.exit_code


def _jobs(
    a: argparse.Namespace, paths: Sequence[Path], options: Mapping[str, Any], pages: Path | None
) -> tuple[list[Job], list[tuple[Path, Path]]]:
    """One job for every content, and which log is a copy of which. A log that vanished meanwhile is left out."""
    jobs: dict[str, Job] = {}
    copies = []
    for path in paths:
        try:
            job = Job.of(a.command, path.resolve(), options, pages)
        except OSError as error:
            print(f"replay: {path}: {error.strerror or error}", file=sys.stderr)
            continue
        if job.sha256 in jobs:
            copies.append((path, jobs[job.sha256].log))
        else:
            jobs[job.sha256] = job
    return list(jobs.values()), copies


def _answers(
    a: argparse.Namespace, out: Path, jobs: Sequence[Job]
) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Those of an earlier run, and what had to be worked out, which is kept for the next."""
    old = {job: _known(a, out, job) for job in jobs}
    waiting = [job for job in jobs if old[job] is None]
    told = [job for job in jobs if old[job] is not None]
    if told and speaks(a):
        print(f"{len(jobs)} logs, {len(told)} of them known from before")
    with _stored(a, out) as store:
        for job, answer in old.items():
            if answer is not None:
                store(job, answer)
                yield job, {**answer, "page": job.link}
        if waiting:
            working = work(waiting, a.workers or len(os.sched_getaffinity(0)), a.scheduler)
            for job, answer in _counted(a, working, len(jobs), len(told)):
                keep(out, job, answer)
                store(job, answer)
                yield job, {**answer, "page": job.link}


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
def _stored(a: argparse.Namespace, out: Path) -> Iterator[Callable[[Job, Mapping[str, Any]], None]]:
    """What puts an answer into the store of the folder; replays have none."""
    if a.command != "diagnose":
        yield lambda job, answer: None
        return
    with Store.open(out / NAME, make=True) as store:
        yield lambda job, answer: store.add(job.question, answer)


def _counted(
    a: argparse.Namespace, working: Iterable[tuple[Job, dict[str, Any]]], count: int, done: int
) -> Iterator[tuple[Job, dict[str, Any]]]:
    """The same with a progress bar; where the output is redirected, a line now and then."""
    shown = sys.stderr.isatty() and not a.quiet
    start = time.monotonic()
    said = start
    first = done
    failed = 0
    for job, answer in tqdm(
        working, total=count, initial=done, unit="log", disable=not shown, leave=False
    ):
        yield job, answer
        done += 1
        failed += "error" in answer
        now = time.monotonic()
        if not shown and not a.quiet and now - said > SAY_EVERY_S:
            said = now
            left_s = (now - start) / (done - first) * (count - done)
            print(
                f"replay: {done} of {count} logs, {failed} failed, about {left_s / 60.0:.0f} min "
                "left",
                file=sys.stderr,
                flush=True,
            )


def _write(
    a: argparse.Namespace, out: Path, title: str, by_job: Mapping[Job, dict[str, Any]]
) -> dict[str, str]:
    """Table and page of the answers that are there."""
    answers = list(by_job.values())
    target = (a.report or out) / "report.html"
    return {
        "table": str(write_document("--out", out / "table.csv", table(answers))),
        "page": str(write_document("--report", target, page(title, answers))),
    }
