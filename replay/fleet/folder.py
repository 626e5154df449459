"""A whole folder: find the logs, do what is not done yet, write the table and the page."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from tqdm import tqdm

from models.common.arguments import speaks
from models.common.errors import ConfigError, LogError
from models.common.pages.document import write_document
from models.common.text_file import write_json
from replay.command import check_declared, check_targets
from replay.fleet.jobs import Job, work
from replay.fleet.page import page
from replay.fleet.results import keep, known, logs_in, table


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
    jobs = [Job.of(a.command, path.resolve(), {**options, **places}, pages) for path in paths]
    by_job = _answers(a, out, jobs)
    answers = [{**by_job[job], "page": job.link} for job in jobs]
    bad = [answer for answer in answers if "error" in answer]
    for line in [*notes, *(f"{answer['log']}: {answer['error']}" for answer in bad)]:
        print(f"replay: {line}", file=sys.stderr)
    written = {
        "table": str(write_document("--out", out / "table.csv", table(answers))),
        "page": str(
            write_document("--report", (a.report or out) / "report.html", page(title, answers))
        ),
    }
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


def _answers(a: argparse.Namespace, out: Path, jobs: list[Job]) -> dict[Job, dict[str, Any]]:
    """Those of an earlier run, and what had to be worked out, which is kept for the next."""
    answers = {job: answer for job in jobs if (answer := known(out, job)) is not None}
    waiting = [job for job in jobs if job not in answers]
    if answers and speaks(a):
        print(f"{len(jobs)} logs, {len(answers)} of them known from before")
    if waiting:
        working = work(waiting, a.workers or len(os.sched_getaffinity(0)), a.scheduler)
        bar = True if a.quiet else None  # None: only to a terminal
        for job, answer in tqdm(
            working, total=len(jobs), initial=len(answers), unit="log", disable=bar, leave=False
        ):
            keep(out, job, answer)
            answers[job] = answer
    return answers
