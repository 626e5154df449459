"""A whole folder: find the logs, do what is not done yet, write the table and the page."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from models.errors import ConfigError, LogError
from replay.command import declared
from replay.fleet.jobs import Job, Kind
from replay.fleet.page import write_page
from replay.fleet.results import Results, logs_in, split
from replay.fleet.rows import row, write_table
from replay.fleet.scheduler import run_dask, run_local


def run_folder(a: argparse.Namespace, folder: Path, kind: Kind, **options: Any) -> int:
    """The command on every log below ``folder``. 0 where one log at least could be used, else 3.

    An interrupted run goes on where it stopped: answers that are in ``--out`` are not computed again.
    """
    if a.workers is not None and not 1 <= a.workers <= 1024:
        raise ConfigError(f"--workers {a.workers}: must be 1 to 1024")
    if a.scheduler is not None and "://" not in a.scheduler:
        raise ConfigError(f"--scheduler {a.scheduler}: must be an address such as tcp://10.0.0.5:8786")
    declared(a.vehicle, a.model)  # a wrong file is said once, before the work
    if kind is Kind.DIAGNOSE:
        import_module("replay.diagnosis.diagnose")  # a missing package is said once, before the work
    paths, notes = logs_in(folder)
    out = Path(f"{folder.resolve().name}-{kind.value}") if a.out is None else a.out
    results = Results(out)
    vehicle = None if a.vehicle is None else str(a.vehicle.resolve())
    model = a.model if a.model is None or not Path(a.model).is_dir() else str(Path(a.model).resolve())
    pages = None
    if a.report is not None and kind is Kind.DIAGNOSE:
        pages = str((a.report / "logs").resolve())
    jobs = [Job(kind.value, str(p.resolve()), vehicle, model, a.target_system, pages=pages, **options) for p in paths]
    waiting, answers = split(results, jobs)
    for job, answer in _progress(_work(a, waiting), len(jobs), len(answers), a.quiet):
        results.keep(job, answer)
        answers[job] = answer
    ordered = [{**answers[job], "craft": _craft(answers[job], folder.resolve())} for job in jobs]
    return _tell(a, folder, out, kind, ordered, notes, len(jobs) - len(waiting))


def _craft(answer: dict[str, Any], folder: Path) -> str:
    """Which vehicle flew: the folder below ``folder`` in which the log lies, else the system id."""
    below = Path(answer["log"]).relative_to(folder).parts[:-1]
    return below[0] if below else f"system {answer.get('system', '?')}"


def _work(a: argparse.Namespace, jobs: Sequence[Job]) -> Any:
    if not jobs:
        return ()
    if a.scheduler is not None:
        return run_dask(jobs, a.scheduler)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return run_local(jobs, min(a.workers or cores, len(jobs)))


def _progress(work: Any, total: int, done: int, quiet: bool) -> Any:
    from tqdm import tqdm

    shown = sys.stderr.isatty() and not quiet
    return tqdm(work, total=total, initial=done, unit="log", disable=not shown, leave=False, file=sys.stderr)


def _tell(
    a: argparse.Namespace,
    folder: Path,
    out: Path,
    kind: Kind,
    answers: list[dict[str, Any]],
    notes: list[str],
    old: int,
) -> int:
    from models.json_file import write_json

    try:
        table = write_table(out, [row(answer) for answer in answers])
        target = out if a.report is None else a.report
        target.mkdir(parents=True, exist_ok=True)
        page = write_page(target, f"replay {kind.value}: {folder.resolve().name}", answers)
    except OSError as error:
        option = f"--out {out}" if a.report is None else f"--out {out} or --report {a.report}"
        raise ConfigError(f"{option}: cannot be written ({error.strerror})") from None
    bad = [answer for answer in answers if "error" in answer]
    for line in [*notes, *(f"{answer['log']}: {answer['error']}" for answer in bad)]:
        print(f"replay: {line}", file=sys.stderr)
    if a.json is not None:
        write_json({"folder": str(folder), "logs": answers, "table": str(table), "page": str(page)}, a.json)
    if a.json != "-" and not a.quiet:
        again = f" ({old} of them known from before)" if old else ""
        print(f"{len(answers) - len(bad)} of {len(answers)} logs{again}\ntable: {table}\npage: {page}")
    return 0 if len(bad) < len(answers) else LogError.exit_code
