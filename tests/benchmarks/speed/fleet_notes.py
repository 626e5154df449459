"""What was seen of a folder of logs while its processes were killed, in a file: the same command can go on."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import psutil

CHILD = "replay.fleet.child"
Stamps = dict[str, list[int]]


@dataclass(kw_only=True)
class Notes:
    """Of one way to do the logs."""

    file: Path
    starts: int = 0
    busy_s: float = 0.0
    """While the command ran."""
    worker_killed: bool = False
    left_s: float | None = None
    """Until the processes of the killed command were gone; None: it was not killed yet."""
    kept: int = 0
    """Answers when the last command was started."""
    known: int = 0
    """Of these, taken over by it."""
    stamps: Stamps = field(default_factory=dict)
    """Of answers that were there at a start, as they were first seen."""
    largest: float = 0.0
    """Resident memory [MiB] of a process that works on logs."""
    command: list[tuple[int, int, float]] = field(default_factory=list)
    """That of the command: which start, answers that are there, MiB."""

    @classmethod
    def of(cls, file: Path) -> Notes:
        """As they were left, or empty ones."""
        if not file.is_file():
            return cls(file=file)
        said: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        said["command"] = [tuple(one) for one in said["command"]]
        return cls(file=file, **said)

    def write(self) -> None:
        """Whole or not at all."""
        said = asdict(self)
        del said["file"]
        part = self.file.with_suffix(".part")
        part.write_text(json.dumps(said), encoding="utf-8")
        os.replace(part, self.file)

    def started(self, out: Path) -> None:
        """Before a start of the command."""
        self.starts += 1
        self.stamps = stamps(out) | self.stamps
        self.kept = count(out)
        self.write()

    def look(self, process: psutil.Process, workers: Sequence[psutil.Process], done: int) -> None:
        """At the memory, once."""
        size = mebibytes(process)
        if size:  # else it has just ended
            self.command.append((self.starts, done, size))
        self.largest = max([self.largest, *map(mebibytes, workers)])

    def rewritten(self, out: Path) -> int:
        """Answers that were there at a start, and were computed again or are gone."""
        now = stamps(out)
        return sum(now.get(name) != stamp for name, stamp in self.stamps.items())

    @property
    def growth(self) -> float:
        """Of the command, MiB for a hundred answers, over the second half of the longest start."""
        last = max(self.command, key=lambda one: one[1])[0]
        seen = [(done, size) for start, done, size in self.command if start == last]
        half = seen[len(seen) // 2 :]
        (first, low), (end, high) = half[0], half[-1]
        return 100.0 * (high - low) / max(end - first, 1)


def count(out: Path) -> int:
    """Answers that are there."""
    try:
        return sum(name.endswith(".json") for name in os.listdir(out / "results"))
    except FileNotFoundError:
        return 0


def stamps(out: Path) -> Stamps:
    """Files of answers: which, and when they were written."""
    found = {}
    for file in (out / "results").glob("*.json"):
        about = file.stat()
        found[file.name] = [about.st_ino, about.st_mtime_ns]
    return found


def mebibytes(process: psutil.Process) -> float:
    """Resident memory; 0 of a process that has ended."""
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
    """Whether it is there and works on logs."""
    try:
        return CHILD in process.cmdline() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
