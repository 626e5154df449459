"""A folder of logs while its processes are killed: what is lost, computed twice or left behind, and does memory grow?

    python tests/benchmarks speed.fleet_killed FOLDER [--logs 200] [--seconds 20] [--workers 2] [--way here]
        [--keep DIR] [--result FILE]

The logs are copies of the first seconds of the forty shortest .tlog of FOLDER: a board for each of the forty, a line of
its own for each copy. Some are broken, some are there twice. They are diagnosed twice, each time in another way:

- here by two processes: one is killed at a quarter, the command at half (SIGKILL); then the same command again
- by a Dask cluster of two workers: one is killed at a quarter, the command at half; then another worker and the same
  command again

With ``--keep`` it can itself be killed: the same command goes on. Answers that were there at any start must stay as
they are. At last the store is asked, as ``speed.fleet`` does.
"""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_line
import psutil
from log_writers import frame, record
from result_file import add_option, figure, write_result

from companion.mavlink.dialect import mavlink
from companion.mavlink.wire_frames import checked_end
from companion.sim.process import free_port
from replay.fleet.store import Store
from speed.fleet import asked, asked_figures
from speed.fleet_notes import Notes, children, works
from speed.fleet_notes import count as answers

SOURCES = 40
BROKEN_EVERY = 40
TWICE_EVERY = 25
INFO = mavlink.MAV_SEVERITY_INFO
STAMP = 8
"""Bytes before a packet: microseconds since 1970."""
LOGS = "logs"
LEFT_S = 60.0
"""So long we look for processes that are left behind."""
LOOK_S = 1.0
WRITE_EVERY = 30
"""Looks."""
DASK = [sys.executable, "-m", "dask"]
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def make_logs(sources: Sequence[Path], folder: Path, count: int, seconds: float) -> int:
    """Write so many files; returns how many contents they have."""
    folder.mkdir(exist_ok=True)
    contents = set()
    cuts = [first(source.read_bytes(), seconds) for source in sources]
    for number in range(count):
        if number % TWICE_EVERY == TWICE_EVERY - 1:
            content = made(number - 1, cuts)
        else:
            content = made(number, cuts)
        contents.add(hashlib.sha256(content).digest())
        file = folder / f"{number:05d}.tlog"
        if not file.is_file() or file.stat().st_size != len(content):
            file.write_bytes(content)
    return len(contents)


def made(number: int, cuts: Sequence[bytes]) -> bytes:
    """A log that says its board and its number at its start; now and then it is broken."""
    which = number % len(cuts)
    board = f"CubeBlack {which:08X} 30355112 37313838"
    arrival_us = int.from_bytes(cuts[which][:STAMP], "big")
    said = b""
    for text in (board, f"copy {number}"):
        line = mavlink.MAVLink_statustext_message(INFO, text.encode())
        said += record(arrival_us, frame(line))
    content = said + cuts[which]
    if number % BROKEN_EVERY == BROKEN_EVERY // 2:
        return content[: len(content) // 20]
    return content


def first(content: bytes, seconds: float) -> bytes:
    """The records of the first seconds of a .tlog."""
    end_us = int.from_bytes(content[:STAMP], "big") + int(1e6 * seconds)
    at = 0
    while at + STAMP < len(content) and int.from_bytes(content[at : at + STAMP], "big") < end_us:
        end = checked_end(content, at + STAMP)
        if not end:
            break
        at = end
    return content[:at]


@dataclass(frozen=True, kw_only=True)
class Way:
    """To do the logs."""

    command: Sequence[str]
    out: Path
    roots: Callable[[int], Sequence[int]]
    """Whose children work, from the process of the command."""
    kill: Callable[[], None]
    """At a quarter."""
    again: Callable[[], None] = lambda: None
    """Before the second start."""


def killed(way: Way, count: int, notes: Notes) -> None:
    """Start, kill a worker, kill the command, start again; goes on where the notes end."""
    if notes.left_s is None:
        notes.left_s = first_start(way, count, notes)
        notes.write()
        way.again()
    said = way.out.with_suffix(".txt")
    with said.open("w", encoding="utf-8") as stdout, started(way, notes, stdout) as process:
        while process.poll() is None:
            looked(way, notes, process)
    for line in said.read_text(encoding="utf-8").splitlines():
        if "known from before" in line:
            notes.known = int(line.split(", ")[1].split()[0])
    notes.write()


def first_start(way: Way, count: int, notes: Notes) -> float:
    """Up to the kill of the command; seconds until its processes were gone."""
    with started(way, notes, subprocess.DEVNULL) as process:
        while process.poll() is None and (done := looked(way, notes, process)) < count // 2:
            if done >= count // 4 and not notes.worker_killed:
                notes.worker_killed = True
                way.kill()
        left = children(way.roots(process.pid))
    start_s = time.monotonic()
    while any(works(child) for child in left) and time.monotonic() - start_s < LEFT_S:
        time.sleep(0.1)
    return time.monotonic() - start_s


@contextmanager
def started(way: Way, notes: Notes, stdout: Any) -> Iterator[subprocess.Popen[bytes]]:
    """The command; after the block it is killed."""
    notes.started(way.out)
    process = subprocess.Popen(way.command, stdout=stdout)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()


def looked(way: Way, notes: Notes, process: subprocess.Popen[bytes]) -> int:
    """A look at the memory after a while; answers that are there."""
    start_s = time.monotonic()
    time.sleep(LOOK_S)
    done = answers(way.out)
    with suppress(psutil.NoSuchProcess):
        notes.look(psutil.Process(process.pid), children(way.roots(process.pid)), done)
    notes.busy_s += time.monotonic() - start_s
    if len(notes.command) % WRITE_EVERY == 0:
        notes.write()
    return done


def here(folder: Path, contents: int, notes: Notes, workers: int) -> Path:
    """Processes of this machine."""
    out = folder / "here"

    def kill() -> None:
        for one in children([os.getpid()])[:1]:
            one.kill()

    way = Way(
        command=diagnose(folder / LOGS, out, f"--workers={workers}"),
        out=out,
        roots=lambda pid: [pid],
        kill=kill,
    )
    killed(way, contents, notes)
    return out


def cluster(folder: Path, contents: int, notes: Notes, workers: int) -> Path:
    """A Dask cluster of workers that nobody starts anew."""
    out = folder / "cluster"
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    worker = [
        *DASK,
        "worker",
        address,
        "--nthreads=1",
        "--no-nanny",
        "--no-dashboard",
        "--local-directory",
        str(folder),
    ]
    running: list[subprocess.Popen[bytes]] = []

    def start(command: Sequence[str]) -> None:
        running.append(subprocess.Popen(command, **QUIET))

    way = Way(
        command=diagnose(folder / LOGS, out, f"--scheduler={address}"),
        out=out,
        roots=lambda _: [process.pid for process in running],
        kill=lambda: running[1].kill(),
        again=lambda: start(worker),
    )
    with ended(running):
        start([*DASK, "scheduler", "--port", str(port), "--no-dashboard"])
        for _ in range(workers):
            start(worker)
        time.sleep(10.0)
        killed(way, contents, notes)
    return out


@contextmanager
def ended(processes: Sequence[subprocess.Popen[Any]]) -> Iterator[None]:
    """End them after a block."""
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def diagnose(logs: Path, out: Path, *where: str) -> list[str]:
    return [
        sys.executable,
        "-m",
        "replay",
        "diagnose",
        str(logs),
        "--model=none",
        f"--out={out}",
        *where,
    ]


def figures(name: str, out: Path, notes: Notes, contents: int) -> list[dict[str, Any]]:
    """Of one way."""
    with Store.open(out) as store:
        found = store.rows("SELECT count(*) AS n, sum(passing) AS lost FROM logs")[0]
    rewritten = notes.rewritten(out)
    per_minute = 60.0 * answers(out) / notes.busy_s
    assert notes.left_s is not None
    return [
        figure(f"{name}: answers at the end", f"{found['n']}", "", f"{contents}", found["n"] == contents),
        figure(f"{name}: logs that failed as their process was killed", f"{found['lost']}", "", "0",
               found["lost"] == 0),
        figure(f"{name}: answers taken over after SIGKILL of the command", f"{notes.known} of {notes.kept}", "", "all",
               notes.known == notes.kept),
        figure(f"{name}: of them computed again", f"{rewritten}", f"{notes.starts} starts", "0", rewritten == 0),
        figure(f"{name}: processes of the killed command gone after [s]", f"{notes.left_s:.1f}", "",
               f"{LEFT_S:.0f}", notes.left_s < LEFT_S),
        figure(f"{name}: logs a minute, drafts and all starts included", f"{per_minute:.0f}"),
        figure(f"{name}: largest process of the logs [MiB]", f"{notes.largest:.0f}"),
        figure(f"{name}: the command [MiB]", f"{notes.command[-1][2]:.0f}",
               f"{notes.growth:+.1f} for 100 answers, second half of the longest start"),
    ]  # fmt: skip


def of_store(out: Path) -> list[dict[str, Any]]:
    """What questions to it and its season cost."""
    times: dict[str, float] = {}
    with Store.open(out) as store:
        size, peak = asked(store, times)
    return asked_figures(times, f"{answers(out)} answers", size, peak)


def main(argv: list[str] | None = None) -> int:
    """Exit code 1 where something was lost, done twice or left behind."""
    p = command_line.parser(__doc__)
    p.add_argument("folder", type=Path, metavar="FOLDER")
    p.add_argument("--logs", type=int, default=200)
    p.add_argument("--seconds", type=float, default=20.0)
    p.add_argument("--workers", type=int, default=2)
    p.add_argument("--way", choices=WAYS, action="append", help="default: both")
    p.add_argument("--keep", type=Path, metavar="DIR", help="the same command goes on from there")
    add_option(p)
    a = p.parse_args(argv)
    sources = sorted(a.folder.rglob("*.tlog"), key=lambda log: log.stat().st_size)[:SOURCES]
    found = []
    with kept(a.keep) as folder:
        contents = make_logs(sources, folder / LOGS, a.logs, a.seconds)
        for way in a.way or WAYS:
            notes = Notes.of(folder / f"{way}.json")
            out = WAYS[way](folder, contents, notes, a.workers)
            found += [*figures(way, out, notes, contents), *of_store(out)]
            for one in found:
                print(f"{one['what']}: {one['value']} {one.get('detail', '')}", flush=True)
    write_result(
        a,
        found,
        seeds=f"{a.logs} copies of the first {a.seconds:g} s of {len(sources)} flights",
        simulated=False,
    )
    return int(any(one.get("met") is False for one in found))


@contextmanager
def kept(folder: Path | None) -> Iterator[Path]:
    """Where logs, answers and notes lie: a folder that stays, or one that goes."""
    if folder is None:
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)
    else:
        folder.mkdir(parents=True, exist_ok=True)
        yield folder.resolve()


WAYS = {"here": here, "cluster": cluster}


if __name__ == "__main__":
    raise SystemExit(main())
