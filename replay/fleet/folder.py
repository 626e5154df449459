"""A whole folder: find the logs, do what is not done yet, write the table and the page."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from tqdm import tqdm

from models.errors import ConfigError, LogError
from models.json_file import write_json
from replay.command import declared
from replay.fleet.jobs import Job, Kind
from replay.fleet.options import FolderOptions
from replay.fleet.page import write_page
from replay.fleet.results import Results, logs_in
from replay.fleet.rows import row, write_table
from replay.fleet.scheduler import run_dask, run_local


def run_folder(question: Job, options: FolderOptions) -> int:
    """The question, asked of every log below the folder ``question.path``. 0 where one log at least was used, else 3.

    An interrupted run goes on where it stopped: answers that are in ``--out`` are not computed again.
    """
    declared(question.vehicle, question.model)  # a wrong file is said once, before the work
    if question.kind == Kind.DIAGNOSE:
        import_module("replay.diagnosis.diagnose")  # a missing package is said once, before the work
    folder = Path(question.path)
    paths, notes = logs_in(folder)
    out = options.out or Path(f"{folder.resolve().name}-{question.kind}")
    results = Results(out)
    if options.report is not None and question.kind == Kind.DIAGNOSE:
        question = replace(question, pages=str((options.report / "logs").resolve()))
    jobs = [replace(question, path=str(p.resolve())) for p in paths]
    answers = {job: answer for job in jobs if (answer := results.known(job)) is not None}
    waiting = [job for job in jobs if job not in answers]
    bar = True if options.quiet else None  # None: only to a terminal
    for job, answer in tqdm(
        _work(options, waiting), total=len(jobs), initial=len(answers), unit="log", disable=bar, leave=False
    ):
        results.keep(job, answer)
        answers[job] = answer
    ordered = [answers[job] for job in jobs]
    bad = [answer for answer in ordered if "error" in answer]
    for line in [*notes, *(f"{answer['log']}: {answer['error']}" for answer in bad)]:
        print(f"replay: {line}", file=sys.stderr)
    again = f" ({len(jobs) - len(waiting)} of them known from before)" if len(waiting) < len(jobs) else ""
    said = f"{len(jobs) - len(bad)} of {len(jobs)} logs{again}"
    _write(options, folder, out, f"replay {question.kind}: {folder.resolve().name}", ordered, said)
    return 0 if len(bad) < len(jobs) else LogError.exit_code


def _work(options: FolderOptions, jobs: Sequence[Job]) -> Iterable[tuple[Job, dict[str, Any]]]:
    if not jobs:
        return ()
    if options.scheduler is not None:
        return run_dask(jobs, options.scheduler)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return run_local(jobs, min(options.workers or cores, len(jobs)))


def _write(
    options: FolderOptions, folder: Path, out: Path, title: str, answers: list[dict[str, Any]], said: str
) -> None:
    """Table, page and what ``--json`` asks for."""
    target = options.report or out
    try:
        table = write_table(out, [row(answer) for answer in answers])
        target.mkdir(parents=True, exist_ok=True)
        page = write_page(target, title, answers)
    except OSError as error:
        option = f"--out {out}" if options.report is None else f"--out {out} or --report {target}"
        raise ConfigError(f"{option}: cannot be written ({error.strerror})") from None
    if options.json is not None:
        write_json({"folder": str(folder), "logs": answers, "table": str(table), "page": str(page)}, options.json)
    if options.json != "-" and not options.quiet:
        print(f"{said}\ntable: {table}\npage: {page}")
