"""What the desk keeps on disk: a folder for each drop, with its logs, what is in them, and what was asked."""

from __future__ import annotations

import filecmp
import json
import os
import re
import secrets
from collections.abc import AsyncIterator, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from models.common.errors import ConfigError
from replay.fleet.jobs import content_hash
from replay.fleet.store import NAME, Store
from replay.logs.formats import known_suffixes

MOST_BYTES = 2 << 30
"""Of one log."""


@dataclass(frozen=True)
class Ask:
    """One question about the logs of a drop, and its answer when it is there."""

    folder: Path

    @property
    def question(self) -> Any:
        """As ``Question.written`` left it."""
        return read_json(self.folder / "question.json")

    @property
    def answered(self) -> bool:
        """Whether the page of the answer is there."""
        return (self.folder / "report.html").is_file() and not self.failure

    @property
    def over_time(self) -> bool:
        """Whether there is a page of every vehicle over time."""
        return (self.folder / "season" / "report.html").is_file()

    @property
    def answer(self) -> Any:
        """The JSON of the command; empty where there is none yet."""
        return read_json(self.folder / "answer.json")

    @property
    def season(self) -> list[dict[str, Any]]:
        """What that says of each log by itself; empty where the logs were asked about together."""
        return [log for log in self.answer.get("logs", ()) if isinstance(log, dict)]

    @property
    def failure(self) -> str:
        """Why there is no answer; empty where there is one, or none yet."""
        return read_text(self.folder / "error.txt")

    @property
    def vehicle_text(self) -> str:
        """The vehicle file that was asked with, or drafted."""
        return read_text(self.folder / "edited.toml") or read_text(self.folder / "vehicle.toml")


@dataclass(frozen=True)
class Drop:
    """Logs that were dropped together."""

    folder: Path

    @property
    def logs(self) -> list[Path]:
        """By name."""
        return sorted((self.folder / "logs").iterdir())

    @property
    def asks(self) -> list[Ask]:
        """The newest first."""
        folders = sorted((self.folder / "asks").iterdir(), key=lambda folder: int(folder.name))
        return [Ask(folder) for folder in reversed(folders)]

    @property
    def each(self) -> Path:
        """Answers to every log by itself, and their store: of all questions, so that none is worked out twice."""
        return self.folder / "each"

    @property
    def last(self) -> int:
        """A number that grows with every answer in that store; 0 where there is none."""
        try:
            with Store.look(self.each) as store:
                return store.last()
        except ConfigError:
            return 0

    def remove(self, log: Path) -> None:
        """Delete a log, and what the store says of it."""
        if (self.each / NAME).is_file():
            with Store.open(self.each) as store:
                store.forget(content_hash(log))
        self.info(log).unlink(missing_ok=True)
        log.unlink(missing_ok=True)

    def info(self, log: Path) -> Path:
        """The text of ``replay info``."""
        return self.folder / "info" / f"{log.name}.txt"

    async def receive(
        self, name: str, chunks: AsyncIterator[bytes], most: int, changed_s: str = ""
    ) -> Path:
        """Write a log to disk as it comes in. Raises HTTPException, or OSError where the disk is full.

        ``most``: bytes that are taken. ``changed_s``: when it was last changed, seconds since 1970: the date of a log
        that holds none.
        """
        name = safe_name(name)
        part = self.folder / f"{secrets.token_hex(8)}.part"
        try:
            with part.open("wb") as file:
                async for chunk in chunks:
                    file.write(chunk)
                    if file.tell() > most:
                        raise HTTPException(
                            413,
                            f"{name}: is larger than {most / 2**30:.3g} GiB; cut it, or use "
                            "replay diagnose itself",
                        )
            if changed_s.isdecimal():
                os.utime(part, (int(changed_s), int(changed_s)))
            return await run_in_threadpool(self._keep, part, name)
        except ClientDisconnect:
            raise HTTPException(400, f"{name}: the copy broke off") from None
        finally:
            part.unlink(missing_ok=True)

    def _keep(self, part: Path, name: str) -> Path:
        """Give a complete log its name. Raises HTTPException where it is here already."""
        same = next((log for log in self.logs if filecmp.cmp(part, log, shallow=False)), None)
        if same is not None:
            raise HTTPException(409, f"{name}: is the same log as {same.name}")
        target = self.folder / "logs" / name
        number = 1
        while target.exists():
            number += 1
            target = target.with_name(f"{Path(name).stem}-{number}{Path(name).suffix}")
        return part.rename(target)


@dataclass(frozen=True)
class Desk:
    """The folder of everything."""

    folder: Path

    @classmethod
    def of(cls, folder: Path) -> Desk:
        """Create the folder; only its owner may read it. Raises ConfigError."""
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            for part in folder.glob("*/*.part"):  # of a desk that was killed
                part.unlink()
        except OSError as error:
            raise ConfigError(
                f"--folder {folder}: cannot be written ({error.strerror}); name another"
            ) from None
        return cls(folder.resolve())

    @property
    def drops(self) -> list[Drop]:
        """The newest first."""
        questions = list(self.folder.glob("*/asks"))
        questions.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        return [Drop(question.parent) for question in questions]

    def new_drop(self) -> Drop:
        """An empty one."""
        folder = self.folder / secrets.token_hex(8)
        for name in ("logs", "info", "asks"):
            (folder / name).mkdir(parents=True)
        return Drop(folder)


def safe_name(name: str) -> str:
    """The last part of a name, without signs that mean something to a file system or a shell. Raises HTTPException."""
    last = re.split(r"[/\\]", name)[-1]
    safe = re.sub(r"[^\w.() +-]", "_", last).lstrip(". -")[-120:]
    suffixes = known_suffixes()
    if Path(safe).suffix.lower() not in suffixes:
        raise HTTPException(415, f"{safe or 'the file'}: is no log; logs are {', '.join(suffixes)}")
    return safe


def one_of(paths: Iterable[Path], name: str) -> Path:
    """The path of this name; a name from outside is never made into a path. Raises HTTPException."""
    for path in paths:
        if path.name == name:
            return path
    raise HTTPException(404, f"{name}: is not here; it may have been deleted")


def read_text(path: Path) -> str:
    """Empty where there is no such file."""
    try:
        return path.read_text("utf-8", errors="replace")
    except OSError:
        return ""


def read_json(path: Path) -> Any:
    """An empty dictionary where there is no such file yet, or half of it."""
    try:
        return json.loads(read_text(path))
    except ValueError:
        return {}
