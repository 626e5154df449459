"""Runs jobs on the processes of this machine, or on a Dask cluster; a job that dies takes nothing else with it."""

from __future__ import annotations

import multiprocessing as mp
import os
import resource
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from multiprocessing.connection import Connection
from typing import Any

from models.errors import ConfigError
from replay.fleet.jobs import Job, Kind, perform

_PRELOAD = ["numpy", "replay.fleet.jobs", "replay.diagnosis.diagnose", "replay.rerun.report", "scipy.linalg"]
_MEMORY_SHARE = 0.8
"""Of the machine's memory; the rest is for the system and the file cache."""
_NEEDED_BYTES = {Kind.RUN: 400e6, Kind.DIAGNOSE: 2.0e9}
"""Of a long log: it is read in blocks, and two hours of it are diagnosed (docs/logs.md)."""


def run_local(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Answers in the order in which they come. One fresh process a log, so that memory is given back after each.

    No more at a time than fit into memory together, each taken for a long log.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process a core is enough
    context = mp.get_context("forkserver")
    context.set_forkserver_preload(_PRELOAD)
    fit = int(_physical_bytes() * _MEMORY_SHARE / _NEEDED_BYTES[jobs[0].kind])
    workers = max(min(workers, fit), 1)
    running: list[Any] = []
    pool = ThreadPoolExecutor(workers)
    try:
        futures = {pool.submit(_alone, context, job, running): job for job in jobs}
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in list(running):
            process.terminate()


def run_dask(jobs: Sequence[Job], address: str) -> Iterator[tuple[Job, dict[str, Any]]]:
    """The same on a cluster: its workers must see the logs under the same paths, and have this package."""
    try:
        from distributed import Client
        from distributed import as_completed as completed
    except ImportError:
        raise ConfigError(
            "--scheduler: needs the package distributed: pip install 'corner-compensator[cluster]'"
        ) from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(f"--scheduler {address}: no Dask scheduler there ({error})") from None
    with client:
        futures = {client.submit(perform, job, pure=False, retries=1): job for job in jobs}
        for future in completed(list(futures)):
            try:
                answer = future.result()
            except Exception as error:  # the worker died with it
                answer = {"log": futures[future].path, "error": f"its worker failed ({type(error).__name__}: {error})"}
            yield futures[future], answer


def _physical_bytes() -> float:
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _alone(context: Any, job: Job, running: list[Any]) -> dict[str, Any]:
    """The answer of a process of its own, which is in ``running`` as long as it lives."""
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(job, theirs), daemon=True)
    process.start()
    theirs.close()
    running.append(process)
    try:
        answer: dict[str, Any] = ours.recv()
    except EOFError:
        answer = {}
    ours.close()
    process.join()
    running.remove(process)
    killed = process.exitcode < 0
    reason = f"signal {-process.exitcode}; out of memory?" if killed else f"exit code {process.exitcode}"
    return answer or {"log": job.path, "error": f"its process died ({reason})"}


def _child(job: Job, answers: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to end
    limit = int(_physical_bytes() * _MEMORY_SHARE)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))  # MemoryError rather than the kernel's killer
    answer = perform(job)
    answer["peak_mib"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    answers.send(answer)
    answers.close()
