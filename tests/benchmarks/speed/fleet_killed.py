"""A folder of logs while its processes are killed: what is lost, computed twice or left behind, and does memory grow?

    python tests/benchmarks speed.fleet_killed FOLDER [--logs 200] [--seconds 20] [--result FILE]

The logs are copies of the first seconds of the forty shortest .tlog of FOLDER: a board for each of the forty, a line of
its own for each copy. Some are broken, some are there twice. They are diagnosed twice, each time in another way:

- here by two processes: one is killed at a quarter, the command at half (SIGKILL); then the same command again
- by a Dask cluster of two workers: one is killed at a quarter, the command at half; then another worker and the same
  command again
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
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

SOURCES = 40
BROKEN_EVERY = 40
TWICE_EVERY = 25
INFO = mavlink.MAV_SEVERITY_INFO
STAMP = 8
"""Bytes before a packet: microseconds since 1970."""
CHILD = "replay.fleet.child"
LEFT_S = 60.0
"""So long we look for processes that are left behind."""
DASK = [sys.executable, "-m", "dask"]
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def make_logs(sources: Sequence[Path], folder: Path, count: int, seconds: float) -> int:
    """Write so many files; returns how many contents they have."""
    folder.mkdir()
    contents = set()
    cuts = [first(source.read_bytes(), seconds) for source in sources]
    for number in range(count):
        if number % TWICE_EVERY == TWICE_EVERY - 1:
            content = made(number - 1, cuts)
        else:
            content = made(number, cuts)
        (folder / f"{number:05d}.tlog").write_bytes(content)
        contents.add(content)
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


@dataclass
class Memory:
    """Resident memory [MiB] of a command and of its largest process, over answers that are there."""

    command: list[tuple[int, float]] = field(default_factory=list)
    largest: float = 0.0

    def look(self, process: psutil.Process, workers: Sequence[psutil.Process], done: int) -> None:
        """Once."""
        size = mebibytes(process)
        if size:  # else it has just ended
            self.command.append((done, size))
        self.largest = max([self.largest, *map(mebibytes, workers)])

    @property
    def growth(self) -> float:
        """Of the command, MiB for a hundred answers, over the second half of what was looked at."""
        half = self.command[len(self.command) // 2 :]
        (first, low), (last, high) = half[0], half[-1]
        return 100.0 * (high - low) / max(last - first, 1)


def mebibytes(process: psutil.Process) -> float:
    try:
        return process.memory_info().rss / 2**20
    except psutil.NoSuchProcess:
        return 0.0


def children(roots: Sequence[int]) -> list[psutil.Process]:
    """Processes that work on logs, below these."""
    found = []
    for root in roots:
        try:
            found += psutil.Process(root).children(recursive=True)
        except psutil.NoSuchProcess:
            continue
    return [child for child in found if works(child)]


def works(process: psutil.Process) -> bool:
    try:
        return CHILD in process.cmdline() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def answers(out: Path) -> dict[str, tuple[int, int]]:
    """Files of answers: which, and when they were written."""
    files = (out / "results").glob("*.json")
    return {file.name: (file.stat().st_ino, file.stat().st_mtime_ns) for file in files}


@dataclass(frozen=True)
class Outcome:
    """Of one way to do the logs."""

    per_minute: float
    seconds_left: float
    """Until the processes of the killed command were gone."""
    kept: int
    """Answers when the command was killed."""
    known: int
    """Of these, taken over by the same command."""
    rewritten: int
    stored: int
    lost: int
    """Stored answers that failed for a passing reason."""
    memory: Memory


def killed(
    command: Sequence[str],
    out: Path,
    count: int,
    *,
    roots: Callable[[int], Sequence[int]],
    kill: Callable[[], None],
    again: Callable[[], None],
) -> Outcome:
    """``roots``: whose children work, from the process of the command.

    ``kill``: at a quarter; ``again``: before the second start.
    """
    start = time.monotonic()
    memory = Memory()
    process = subprocess.Popen(command, **QUIET)
    watched = psutil.Process(process.pid)
    half_killed = False
    while (done := len(answers(out))) < count // 2 and process.poll() is None:
        memory.look(watched, children(roots(process.pid)), done)
        if done >= count // 4 and not half_killed:
            half_killed = True
            kill()
        time.sleep(1.0)
    left = children(roots(process.pid))
    process.send_signal(signal.SIGKILL)
    process.wait()
    killed_s = time.monotonic()
    while any(works(child) for child in left) and time.monotonic() - killed_s < LEFT_S:
        time.sleep(0.1)
    left_s = time.monotonic() - killed_s
    busy_s = killed_s - start
    before = answers(out)
    again()
    start = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    watched = psutil.Process(process.pid)
    second = Memory()
    while process.poll() is None:
        second.look(watched, children(roots(process.pid)), len(answers(out)))
        time.sleep(1.0)
    said = process.stdout.read()
    busy_s += time.monotonic() - start
    after = answers(out)
    second.largest = max(second.largest, memory.largest)
    known = [
        line.split(", ")[1].split()[0] for line in said.splitlines() if "known from before" in line
    ]
    with Store.open(out) as store:
        stored = store.rows("SELECT count(*) AS n, sum(passing) AS lost FROM logs")[0]
    return Outcome(
        per_minute=60.0 * len(after) / busy_s,
        seconds_left=left_s,
        kept=len(before),
        known=int((known or ["0"])[0]),
        rewritten=sum(after.get(name) != stamp for name, stamp in before.items()),
        stored=stored["n"],
        lost=stored["lost"],
        memory=second,
    )


def here(folder: Path, logs: Path, contents: int) -> Outcome:
    """Two processes of this machine."""
    out = folder / "here"
    command = diagnose(logs, out, "--workers=2")

    def kill() -> None:
        children([os.getpid()])[0].kill()

    return killed(command, out, contents, roots=lambda pid: [pid], kill=kill, again=lambda: None)


def cluster(folder: Path, logs: Path, contents: int) -> Outcome:
    """A Dask cluster of two workers that nobody starts anew."""
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
    started: list[subprocess.Popen[bytes]] = []

    def start(command: Sequence[str]) -> None:
        started.append(subprocess.Popen(command, **QUIET))

    with ended(started):
        start([*DASK, "scheduler", "--port", str(port), "--no-dashboard"])
        start(worker)
        start(worker)
        time.sleep(10.0)
        return killed(
            diagnose(logs, out, f"--scheduler={address}"),
            out,
            contents,
            roots=lambda _: [process.pid for process in started],
            kill=lambda: started[1].kill(),
            again=lambda: start(worker),
        )


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


def figures(name: str, found: Outcome, contents: int) -> list[dict[str, Any]]:
    """Of one way."""
    seen = found.memory
    return [
        figure(f"{name}: answers at the end", f"{found.stored}", "", f"{contents}", found.stored == contents),
        figure(f"{name}: logs that failed as their process was killed", f"{found.lost}", "", "0", found.lost == 0),
        figure(f"{name}: answers taken over after SIGKILL of the command", f"{found.known} of {found.kept}", "", "all",
               found.known == found.kept),
        figure(f"{name}: of them computed again", f"{found.rewritten}", "", "0", found.rewritten == 0),
        figure(f"{name}: processes of the killed command gone after [s]", f"{found.seconds_left:.1f}", "",
               f"{LEFT_S:.0f}", found.seconds_left < LEFT_S),
        figure(f"{name}: logs a minute, drafts and both starts included", f"{found.per_minute:.0f}"),
        figure(f"{name}: largest process of the logs [MiB]", f"{seen.largest:.0f}"),
        figure(f"{name}: the command [MiB]", f"{seen.command[-1][1]:.0f}",
               f"{seen.growth:+.1f} for 100 answers, second half of the second run"),
    ]  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Exit code 1 where something was lost, done twice or left behind."""
    p = command_line.parser(__doc__)
    p.add_argument("folder", type=Path, metavar="FOLDER")
    p.add_argument("--logs", type=int, default=200)
    p.add_argument("--seconds", type=float, default=20.0)
    add_option(p)
    a = p.parse_args(argv)
    sources = sorted(a.folder.rglob("*.tlog"), key=lambda log: log.stat().st_size)[:SOURCES]
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        contents = make_logs(sources, folder / "logs", a.logs, a.seconds)
        for text, way in (("two processes", here), ("cluster of two workers", cluster)):
            found += figures(text, way(folder, folder / "logs", contents), contents)
            for one in found[-8:]:
                print(f"{one['what']}: {one['value']} {one.get('detail', '')}", flush=True)
    write_result(
        a,
        found,
        seeds=f"{a.logs} copies of the first {a.seconds:g} s of {len(sources)} flights",
        simulated=False,
    )
    return int(any(one.get("met") is False for one in found))


if __name__ == "__main__":
    raise SystemExit(main())
