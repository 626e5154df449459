"""Tasks in long-lived processes, each within a limit of memory and of time, on this machine or on a Dask cluster.

Executors of the standard library and loky fail all that waits where one process dies, and have no limit of a task. A
Dask worker may not start a process of ``multiprocessing``. So each worker has a program of its own, ``child.py``; tasks
and results go over a pipe. A task that exceeds its time, or kills its process, costs that process and nothing else.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, TypeVar

from models.common.arguments import installed_version
from models.common.errors import ConfigError
from models.common.extras import how_to_install

K = TypeVar("K")
T = TypeVar("T")
R = TypeVar("R")
Submit = Callable[[Callable[[Any], Any], Any], "Future[Any]"]

USABLE_BYTES = 0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
"""The rest of the machine's memory is for the system and the file cache."""
_POLL_S = 0.5
_TRIES = 2
"""A process may be killed for no fault of its task."""
_AHEAD = 1000
"""Tasks that are handed out and not answered: more than a cluster has cores, and little memory."""


@dataclass(frozen=True)
class Lost:
    """What stands for the result of a task that has none."""

    why: str


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where tasks are done, and the limits of each."""

    workers: int
    """Of this machine."""
    scheduler: str | None = None
    """Of a Dask cluster, which has workers of its own."""
    most_s: float
    most_bytes: float | None = None
    """None: the worker's share of the memory."""


class Worker:
    """A process that does one task after another; a new one takes its place where it ended."""

    def __init__(self, most_bytes: float) -> None:
        self.most_bytes = int(most_bytes)
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    def do(
        self, function: Callable[[T], R], task: T, most_s: float, wanted: Callable[[], bool]
    ) -> R | Lost:
        """The result of ``function``. Raises CancelledError as soon as it is not wanted any more."""
        deaths = 0
        while True:
            pipe = self._opened()
            try:
                pipe.send((function, task))
                end_s = time.monotonic() + most_s
                while not pipe.poll(_POLL_S):
                    if not wanted():
                        self.close()
                        raise CancelledError
                    if time.monotonic() > end_s:
                        self.close()
                        return Lost(f"took more than {most_s / 60.0:.3g} min")
                result: R = pipe.recv()
                return result
            except (EOFError, OSError):
                code = self._gone()
            if code:  # else it ended between two tasks
                deaths += 1
            if deaths == _TRIES:
                return Lost(died(code))

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._gone()

    def _opened(self) -> Connection:
        if self._pipe is not None:
            return self._pipe
        self._pipe, far = Pipe()
        with far:
            words = [str(number) for number in (far.fileno(), os.getpid(), self.most_bytes)]
            self._process = subprocess.Popen(
                [sys.executable, "-m", "replay.fleet.child", *words],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[far.fileno()],
                env=_environment(),
            )
        return self._pipe

    def _gone(self) -> int:
        """Exit code of a process that has ended."""
        assert self._process is not None
        assert self._pipe is not None
        self._pipe.close()
        code = self._process.wait()
        self._process = None
        self._pipe = None
        return code


def _environment() -> dict[str, str]:
    """Of a process that finds the same packages. One thread of linear algebra, as there is a process a core."""
    return {
        "OMP_NUM_THREADS": "1",
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }


def died(code: int) -> str:
    """Why a process ended, from its exit code."""
    how = f"died (signal {-code})" if code < 0 else f"ended with exit code {code}"
    return f"its process {how}: probably too little memory"


def results(
    function: Callable[[T], R], tasks: Mapping[K, T], place: Place
) -> Iterator[tuple[K, R | Lost]]:
    """Of all tasks, in the order in which they come. Function, tasks and results go to other processes.

    A generator that is closed, or a command that is killed, leaves no process behind.
    """
    if not tasks:
        return
    left = iter(tasks.items())
    running: dict[Future[Any], K] = {}
    with _cluster(place) if place.scheduler else _machine(place, len(tasks)) as submit:
        try:
            while True:
                for key, task in islice(left, _AHEAD - len(running)):
                    running[submit(function, task)] = key
                if not running:
                    return
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield running.pop(future), _outcome(future, place)
        finally:
            for future in running:
                future.cancel()


def _outcome(future: Future[Any], place: Place) -> Any:
    try:
        problem = future.exception()
    except CancelledError:
        raise ConfigError(
            f"--scheduler {place.scheduler}: went away; the same command goes on where it stopped"
        ) from None
    if problem is None:
        return future.result()
    return Lost(f"its worker failed ({type(problem).__name__}: {problem})")


@contextmanager
def _machine(place: Place, tasks: int) -> Iterator[Submit]:
    """Workers of this machine, each with a thread that waits for it."""
    count = max(min(place.workers, tasks), 1)
    workers = [Worker(place.most_bytes or USABLE_BYTES / count) for _ in range(count)]
    idle: SimpleQueue[Worker] = SimpleQueue()
    for worker in workers:
        idle.put(worker)
    over = threading.Event()

    def done(function: Callable[[Any], Any], task: Any) -> Any:
        worker = idle.get()
        try:
            return worker.do(function, task, place.most_s, lambda: not over.is_set())
        finally:
            idle.put(worker)

    with ThreadPoolExecutor(count) as threads:
        try:
            yield lambda function, task: threads.submit(done, function, task)
        finally:
            over.set()
    for worker in workers:
        worker.close()


@contextmanager
def _cluster(place: Place) -> Iterator[Submit]:
    """Workers of a Dask cluster, which must see the logs under the same paths, and have this package."""
    try:
        from distributed import Client

        client = Client(place.scheduler, timeout="10s")
    except ImportError:
        raise ConfigError(
            f"--scheduler: needs the package distributed: {how_to_install('cluster')}"
        ) from None
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(
            f"--scheduler {place.scheduler}: no Dask scheduler there ({error})"
        ) from None
    # What its loss means is said in one line.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    with client:
        _check_versions(client, place)
        # Where a worker of the cluster is lost, another one does its task.
        pool = client.get_executor(pure=False, retries=1)
        yield lambda function, task: pool.submit(_in_cluster, function, task, place)


def _check_versions(client: Any, place: Place) -> None:
    """Raise ConfigError where a machine of the cluster lacks this package, or has another version of it."""
    version = installed_version()
    try:
        found = client.run(_version)
        found["scheduler"] = client.run_on_scheduler(_version)
    except Exception as error:
        problem = f"a machine there has no corner-compensator ({error})"
    else:
        others = {name: other for name, other in found.items() if other != version}
        if not others:
            return
        name, other = others.popitem()
        problem = f"{name} has version {other}, and this is {version}"
    raise ConfigError(f"--scheduler {place.scheduler}: {problem}")


def _version() -> str:
    return installed_version()


_of_thread = threading.local()
"""``worker``: each thread of a Dask worker has its own."""


def _in_cluster(function: Callable[[T], R], task: T, place: Place) -> R | Lost:
    """``Worker.do`` within a thread of a Dask worker, until nobody waits for it any more."""
    from distributed import get_worker

    dask = get_worker()
    key = dask.get_current_task()

    def wanted() -> bool:
        known = dask.state.tasks.get(key)
        return known is not None and known.state == "executing"

    memory = dask.memory_manager.memory_limit or USABLE_BYTES
    most_bytes = int(place.most_bytes or memory / dask.state.nthreads)
    worker: Worker | None = getattr(_of_thread, "worker", None)
    if worker is None or worker.most_bytes != most_bytes:
        if worker is not None:
            worker.close()
        worker = _of_thread.worker = Worker(most_bytes)
    return worker.do(function, task, place.most_s, wanted)
