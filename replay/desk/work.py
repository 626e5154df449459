"""The work behind the page: each diagnosis in a process of its own, two at a time, the others wait."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from replay.desk.question import Question
from replay.desk.store import Ask, Drop, read_text

AT_ONCE = 2


class _Task:
    """One question that waits or is worked on."""

    def __init__(self) -> None:
        self.step = "waits for its turn"
        self._process: subprocess.Popen[bytes] | None = None
        self.cancelled = False

    def call(self, arguments: list[str], out: Path, err: Path) -> int:
        """Run ``replay`` with these arguments; the exit code."""
        with out.open("wb") as stdout, err.open("wb") as stderr:
            if not self.cancelled:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "replay", *arguments],
                    stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr, start_new_session=True,
                )  # fmt: skip
            if self.cancelled:  # before it started, or while
                self.cancel()
            return 0 if self._process is None else self._process.wait()

    def cancel(self) -> None:
        """End what runs, with the processes that it started."""
        self.cancelled, self.step = True, "is being cancelled"
        if self._process is not None and self._process.poll() is None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)


class Work:
    """What is asked and not yet answered."""

    def __init__(self, at_once: int = AT_ONCE) -> None:
        self._pool = ThreadPoolExecutor(at_once)
        self._tasks: dict[Path, _Task] = {}

    def start(self, drop: Drop, ask: Ask, question: Question) -> None:
        """Put a question into the queue."""
        self._tasks[ask.folder] = task = _Task()
        self._pool.submit(self._answer, drop, ask, question, task)

    def cancel(self, ask: Ask) -> None:
        """End it; nothing where it is over."""
        if ask.folder in self._tasks:
            self._tasks[ask.folder].cancel()

    def close(self) -> None:
        """End everything."""
        for task in list(self._tasks.values()):
            task.cancel()
        self._pool.shutdown()

    def step(self, ask: Ask) -> str:
        """What is being done; empty where it is over."""
        task = self._tasks.get(ask.folder)
        if task is None:
            return ""
        done = len(list(ask.folder.glob("each/results/*.json")))
        drafted = "the vehicle is drafted; looks what the model lacks" if ask.vehicle_text else task.step
        return f"{task.step}: {done} done" if done else drafted

    def _answer(self, drop: Drop, ask: Ask, question: Question, task: _Task) -> None:
        said = ask.folder / "stderr.txt"
        failure = ""
        try:
            _look(drop, ask, task)
            task.step = "reads the logs"
            code = task.call(question.command(drop, ask), ask.folder / "stdout.txt", said)
            failure = error_line(read_text(said), code, drop.folder) if code else ""
        except OSError as problem:
            failure = f"the work could not be done ({problem.strerror})"
        finally:
            failure = "cancelled" if task.cancelled else failure
            if failure:
                with suppress(OSError):  # deleted meanwhile, or the disk is full: the page then says that it stopped
                    (ask.folder / "error.txt").write_text(failure, encoding="utf-8")
            del self._tasks[ask.folder]


def _look(drop: Drop, ask: Ask, task: _Task) -> None:
    """What is in the logs, where that is not known yet."""
    for log in drop.logs:
        target = drop.info(log)
        if not target.exists() and not task.cancelled:
            task.step = f"looks what is in {log.name}"
            part = ask.folder / "info.json"
            wanted = ["info", str(log), f"--json={part}"]
            task.call(wanted, target.with_suffix(".txt"), ask.folder / "stderr.txt")
            if part.exists():
                part.rename(target)


def error_line(stderr: str, code: int, drop: Path) -> str:
    """What a command that failed says to a person, without the desk's own paths."""
    if code < 0:
        return f"the diagnosis was ended by the system (signal {-code}): probably too little memory"
    lines = [line for line in stderr.replace(f"{drop}/logs/", "").replace(f"{drop}/", "").splitlines() if line.strip()]
    if lines and lines[0].startswith("Traceback"):
        return f"the diagnosis broke ({lines[-1]}); please report it"
    return "\n".join(line.removeprefix("replay: ") for line in lines[-20:]) or f"ended with exit code {code}"
