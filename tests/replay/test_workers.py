"""Workers of a folder: long-lived, each task within its limits, no process left behind, here and on a cluster."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import wait
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest
from patience import HANG_S

from companion.sim.process import free_port
from models.common.errors import ConfigError
from replay.fleet import workers
from replay.fleet.child import MOST_TASKS
from replay.fleet.workers import Lost, Place, results

HERE = Path(__file__).resolve()
BRIEF_S = 6.0
TOO_BIG = 8 * 10**9


def process(_: Any) -> int:
    return os.getpid()


def hang_where_asked(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def grow(many: int) -> tuple[str, int]:
    """Takes memory in steps, as a log does that is too long."""
    held = []
    try:
        held = [bytearray(os.urandom(1)) * 10**7 for _ in range(many // 10**7)]
    except MemoryError:
        return "too much", os.getpid()
    return f"{len(held)} steps", os.getpid()


def die_where(place: Path, times: int) -> int:
    """Kills its process so many times, and says then where it was done."""
    tries = len(list(place.iterdir()))
    (place / f"{tries}").touch()
    if tries < times:
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def tell(place: Path) -> None:
    """Says who works, and never ends."""
    (place / f"{os.getpid()}").touch()
    time.sleep(HANG_S)


def within(condition: Callable[[], bool], seconds: float = 60.0) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return condition()


def running(pids: set[int]) -> set[int]:
    """Those that are there and no zombies."""
    out = set()
    for pid in pids & set(psutil.pids()):
        try:
            if psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
                out.add(pid)
        except psutil.NoSuchProcess:
            continue
    return out


def told(place: Path) -> set[int]:
    return {int(file.name) for file in place.iterdir()}


def here(**limits: Any) -> Place:
    return Place(**{"workers": 1, "most_s": HANG_S, **limits})


def test_a_process_does_many_tasks_and_then_gives_its_memory_back() -> None:
    count = MOST_TASKS + 5
    found = dict(results(process, {k: k for k in range(count)}, here()))
    assert sorted(found) == list(range(count))
    assert len(set(found.values())) == 2
    assert os.getpid() not in found.values()


def test_two_workers_are_two_processes() -> None:
    tasks = {k: 0.2 for k in range(6)}
    assert len(set(dict(results(hang_where_asked, tasks, here(workers=2))).values())) == 2


@pytest.mark.slow
def test_what_takes_too_long_is_given_up_and_costs_its_process_alone() -> None:
    tasks = {"first": 0.0, "hangs": HANG_S, "last": 0.0}
    found = dict(results(hang_where_asked, tasks, here(most_s=BRIEF_S)))
    assert found["hangs"] == Lost("took more than 0.1 min")
    assert found["first"] != found["last"]
    assert isinstance(found["last"], int)


def test_memory_has_a_limit_and_a_process_that_grew_is_replaced() -> None:
    tasks = {"small": 10**8, "same": 10**8, "large": TOO_BIG, "after": 10**8}
    found: dict[str, Any] = dict(results(grow, tasks, here(most_bytes=10**9)))
    said = {name: text for name, (text, _) in found.items()}
    assert said == {
        "small": "10 steps",
        "same": "10 steps",
        "large": "too much",
        "after": "10 steps",
    }
    pids = [found[name][1] for name in tasks]
    assert pids[0] == pids[1] == pids[2] != pids[3]


def test_a_killed_process_loses_nothing_and_one_that_dies_again_is_said(tmp_path: Path) -> None:
    for name in ("once", "always"):
        (tmp_path / name).mkdir()
    assert isinstance(
        dict(results(partial(die_where, times=1), {0: tmp_path / "once"}, here()))[0], int
    )
    found = dict(results(partial(die_where, times=9), {0: tmp_path / "always"}, here()))
    assert isinstance(found[0], Lost)
    assert "signal 9" in found[0].why


def test_a_generator_that_is_closed_leaves_no_process() -> None:
    before = set(psutil.Process().children(recursive=True))
    working = results(hang_where_asked, {0: 0.0, 1: HANG_S, 2: HANG_S}, here(workers=2))
    _, pid = next(working)
    now = set(psutil.Process().children(recursive=True))
    children = {child.pid for child in now - before}
    assert pid in children
    working.close()  # type: ignore[attr-defined]
    assert not running(children)


CLIENT = """
import sys
from pathlib import Path
sys.path.insert(0, {folder!r})
from test_workers import tell
from replay.fleet.workers import Place, results
place = Path(sys.argv[1])
where = Place(workers=2, most_s=1000.0, scheduler=(sys.argv[2:] or [None])[0])
list(results(tell, {{0: place, 1: place}}, where))
"""


def client_killed(place: Path, *scheduler: str) -> set[int]:
    """The processes that worked for a client when it was killed."""
    code = CLIENT.format(folder=str(HERE.parent))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", code, str(place), *scheduler]
    with subprocess.Popen(command, env=environment) as client:
        assert within(lambda: len(told(place)) == 2, HANG_S)
        client.send_signal(signal.SIGKILL)
    return told(place)


def test_a_killed_client_leaves_no_process(tmp_path: Path) -> None:
    known = client_killed(tmp_path)
    assert within(lambda: not running(known))


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip(
        "distributed", reason="distributed is not installed (extra: cluster)"
    )
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit="2GB"
    ) as found:
        yield found


@pytest.mark.slow
def test_a_cluster_keeps_the_same_limits(cluster: Any) -> None:
    there = here(scheduler=cluster.scheduler_address, most_s=BRIEF_S)
    tasks = {k: 0.0 for k in range(6)} | {"hangs": HANG_S}
    found = dict(results(hang_where_asked, tasks, there))
    assert found.pop("hangs") == Lost("took more than 0.1 min")
    assert len(set(found.values())) <= 3
    patient = here(scheduler=cluster.scheduler_address)
    large = dict(results(grow, {0: TOO_BIG}, patient))[0]
    assert isinstance(large, tuple)
    assert large[0] == "too much", "of the memory of a worker of the cluster"


@pytest.mark.slow
def test_a_client_that_is_killed_leaves_no_process_on_a_cluster(
    cluster: Any, tmp_path: Path
) -> None:
    known = client_killed(tmp_path, cluster.scheduler_address)
    assert within(lambda: not running(known))
    assert len(dict(results(process, {0: 0}, here(scheduler=cluster.scheduler_address)))) == 1


@pytest.mark.slow
def test_a_lost_worker_of_a_cluster_loses_nothing(cluster: Any) -> None:
    tasks = {k: 0.3 for k in range(12)}
    working = results(hang_where_asked, tasks, here(scheduler=cluster.scheduler_address))
    found = [next(working)]
    os.kill(next(iter(cluster.workers.values())).process.process.pid, signal.SIGKILL)
    found += working
    assert sorted(key for key, _ in found) == sorted(tasks)
    assert all(isinstance(result, int) for _, result in found)


@pytest.mark.slow
def test_a_cluster_of_another_version_is_refused(
    cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "installed_version", lambda: "0.9")
    with pytest.raises(ConfigError, match=r"has version .*, and this is 0\.9"):
        list(results(process, {0: 0}, here(scheduler=cluster.scheduler_address)))


@pytest.mark.slow
def test_a_lost_scheduler_is_one_line(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="distributed is not installed (extra: cluster)")
    port = free_port()
    command = [sys.executable, "-m", "dask", "scheduler", "--port", str(port)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen([*command, "--dashboard-address", ":0"], **quiet) as scheduler:

        def lost(*futures: Any, **options: Any) -> Any:
            scheduler.kill()
            return wait(*futures, **options)

        monkeypatch.setattr(workers, "wait", lost)
        assert within(lambda: answers(port), HANG_S)
        with pytest.raises(ConfigError, match="went away; the same command goes on"):
            list(results(abs, {0: 0}, here(scheduler=f"tcp://127.0.0.1:{port}")))
    assert "Traceback" not in capfd.readouterr().err


def answers(port: int) -> bool:
    """Whether somebody listens there."""
    with socket.socket() as sock:
        return sock.connect_ex(("127.0.0.1", port)) == 0
