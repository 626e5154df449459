"""The work behind the page: each diagnosis in a process of its own, two at a time, the others wait."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from asyncio.subprocess import DEVNULL
from collections import defaultdict
from contextlib import AbstractAsyncContextManager, nullcontext, suppress
from pathlib import Path
from typing import Any

from replay.desk.question import Asked, Question, in_words
from replay.desk.store import Ask, Drop, read_text
from replay.fleet.jobs import error_text

AT_ONCE = 2


class Work:
    """What is asked and not yet answered."""

    def __init__(self, at_once: int = AT_ONCE) -> None:
        self._turn = asyncio.Semaphore(at_once)
        self._tasks: dict[Path, asyncio.Task[None]] = {}
        self._steps: dict[Path, str] = {}
        self._stores: defaultdict[Path, asyncio.Lock] = defaultdict(asyncio.Lock)
        self._before: dict[Path, int] = {}
        """What ``Drop.last`` was when each log was begun to be asked by itself."""

    def start(self, drop: Drop, ask: Ask, question: Question) -> None:
        """Put a question into the queue."""
        self._steps[ask.folder] = "waits for its turn"
        self._tasks[ask.folder] = asyncio.create_task(self._answer(drop, ask, question))

    async def cancel(self, *asks: Ask) -> None:
        """End them; nothing where they are over."""
        tasks = [self._tasks[ask.folder] for ask in asks if ask.folder in self._tasks]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def close(self) -> None:
        """End everything."""
        await self.cancel(*map(Ask, self._tasks))

    def step(self, ask: Ask) -> str:
        """What is being done; empty where it is over."""
        # A page is made in a thread of its own: meanwhile the work may end.
        step = self._steps.get(ask.folder, "")
        before = self._before.get(ask.folder)
        if step and before is not None:
            drop = Drop(ask.folder.parents[1])
            count = len(drop.logs)
            done = min(drop.last - before, count)
            return f"{step}: {done} of {count} done"
        if step and ask.vehicle_text:
            return "the vehicle is drafted; looks what the model lacks"
        return step

    async def _answer(self, drop: Drop, ask: Ask, question: Question) -> None:
        said = ask.folder / "stderr.txt"
        failure = ""
        try:
            async with self._alone(drop, question), self._turn:
                await self._look(drop, ask)
                self._steps[ask.folder] = "reads the logs"
                if question.kind == Asked.SEASON:
                    self._before[ask.folder] = drop.last
                out = ask.folder / "stdout.txt"
                code = await _call(question.command(drop, ask), out, said)
                more = question.over_time(drop, ask)
                if more and not code:
                    code = await _call(more, out, said)
            if code:
                failure = _failure(said, code, drop)
            else:
                failure = ""
        except asyncio.CancelledError:
            failure = "cancelled"
        except OSError as problem:
            failure = f"the work could not be done ({problem.strerror})"
        finally:
            if failure:
                with suppress(OSError):  # the disk is full: the page then says that it stopped
                    (ask.folder / "error.txt").write_text(failure, encoding="utf-8")
            del self._tasks[ask.folder], self._steps[ask.folder]
            self._before.pop(ask.folder, None)

    def _alone(self, drop: Drop, question: Question) -> AbstractAsyncContextManager[Any]:
        """Questions that write to one store come one after the other."""
        if question.kind == Asked.SEASON:
            return self._stores[drop.folder]
        return nullcontext()

    async def _look(self, drop: Drop, ask: Ask) -> None:
        """What is in the logs, where that is not known yet."""
        for log in drop.logs:
            if not drop.info(log).exists():
                self._steps[ask.folder] = f"looks what is in {log.name}"
                part = ask.folder / "info.txt"
                said = ask.folder / "stderr.txt"
                code = await _call(["info", str(log)], part, said)
                if code:
                    text = _failure(said, code, drop)
                else:
                    text = read_text(part)
                drop.info(log).write_text(text, encoding="utf-8")


def _failure(said: Path, code: int, drop: Drop) -> str:
    """What went wrong, in the words of the form and without the desk's own paths."""
    text = read_text(said).replace(f"{drop.folder}/logs/", "").replace(f"{drop.folder}/", "")
    return in_words(error_text(text, code))


async def _call(arguments: list[str], out: Path, err: Path) -> int:
    """Run ``replay`` with these arguments; the exit code. Cancelled, it ends the processes that this started, too."""
    with out.open("wb") as stdout, err.open("wb") as stderr:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "replay",
            *arguments,
            stdin=DEVNULL,
            stdout=stdout,
            stderr=stderr,
            start_new_session=True,
        )
        try:
            return await process.wait()
        finally:
            if process.returncode is None:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
