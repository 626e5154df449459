"""The work on one log of a folder: the command that one would type for it, in a process of a worker."""

from __future__ import annotations

import hashlib
import io
import json
import runpy
import sys
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from models.common.arguments import installed_version
from models.common.errors import TOO_LARGE
from replay.fleet.workers import Lost, Place, died, results
from replay.info.abilities import Extent

_EARLIEST_US = 1_100_000_000_000_000
_LATEST_US = 4_000_000_000_000_000
"""2004 and 2096: receiver stamps outside are no date."""
_DIGITS = 20
"""Of a hash, in the name of a file."""
_BLOCK = 1 << 20
"""Bytes that are read at a time."""
_NEEDED = ("forces (Fx Fy Fz)", "thrust of the rotors")
"""Questions of ``replay info`` to which no diagnosis can do without a yes."""
_MOST_LINES = 20
"""Of an error."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One log and the command that answers it."""

    log: Path
    words: tuple[str, ...]
    """What follows ``replay``; places are absolute."""
    sha256: str
    """Of the log's content: a copy, or a log that was moved, is the same log."""
    question: str
    """Changes with vehicle file, model and options."""
    pages: Path | None = None
    """Folder for a folder with the page of this log; None: no page."""

    @classmethod
    def of(
        cls,
        command: str,
        log: Path,
        options: Mapping[str, Any],
        pages: Path | None = None,
        sha256: str | None = None,
    ) -> Job:
        """``options`` by their names on the command line; those that are None are left out, of lists each is given.

        ``sha256``: of the log, where it is known. Raises OSError where the log is gone.
        """
        words = []
        for option, value in options.items():
            words += [
                f"{option}={v}"
                for v in (value if isinstance(value, list) else [value])
                if v is not None
            ]
        digest = hashlib.sha256(json.dumps([command, *words]).encode())
        vehicle, model = (Path(options.get(name) or "") for name in ("--vehicle", "--model"))
        for file in (vehicle, model / "model.json", model / "weights.npz"):
            if file.is_file():
                digest.update(file.read_bytes())
        return cls(
            log=log,
            words=(command, str(log), *words),
            sha256=sha256 or content_hash(log),
            question=digest.hexdigest()[:_DIGITS],
            pages=pages,
        )

    @property
    def name(self) -> str:
        """Of the files of the answer."""
        return f"{self.sha256[:_DIGITS]}-{self.question}"

    @property
    def page(self) -> Path | None:
        """The log's own page."""
        if self.pages is None:
            return None
        return self.pages / self.name / "report.html"

    @property
    def link(self) -> str | None:
        """To that page, from the page of the folder; None where there is none."""
        if self.page is not None and self.page.is_file():
            return f"logs/{self.name}/report.html"
        return None


def content_hash(log: Path, most: int | None = None) -> str:
    """The sha256 of a file, or of ``most`` bytes at its start. Raises OSError."""
    with log.open("rb") as file:
        if most is None:
            return hashlib.file_digest(file, "sha256").hexdigest()
        digest = hashlib.sha256()
        while most and (block := file.read(min(most, _BLOCK))):
            digest.update(block)
            most -= len(block)
        return digest.hexdigest()


def perform(job: Job) -> dict[str, Any]:
    """The answer of the command; a log that cannot be used gives ``error`` instead. Never raises for a bad log."""
    start = time.monotonic()
    if job.page is None:
        page = []
    else:
        page = [f"--report={job.page.parent}"]
    code, said, errors = _command([*job.words, *page, "--json=-", "--quiet"])
    if code:
        line = error_text(errors.replace(f"{job.log}: ", ""), code).splitlines()[-1]
        told = _info(job)
        answer = {"error": line + _to_set(told), "passing": TOO_LARGE in errors}
        if told:
            answer["identity"] = told["identity"]
    else:
        answer = json.loads(said)
    taken_s = round(time.monotonic() - start, 2)
    return {**answer, **about(job), "wall_s": taken_s}


def _command(words: Sequence[str]) -> tuple[int, str, str]:
    """Exit code, output and errors of a command of ``replay`` within this process."""
    said = io.StringIO()
    errors = io.StringIO()
    typed = sys.argv
    sys.argv = ["replay", *words]
    with redirect_stdout(said), redirect_stderr(errors):
        try:
            runpy.run_module("replay", run_name="__main__")
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        except Exception:
            return 1, "", traceback.format_exc()
        finally:
            sys.argv = typed
    return code, said.getvalue(), errors.getvalue()


def _info(job: Job) -> dict[str, Any]:
    """Of a log that is not judged; empty where it cannot be read at all."""
    code, said, _ = _command(["info", str(job.log), "--json=-", "--quiet"])
    if code:
        return {}
    told: dict[str, Any]
    (told,) = json.loads(said)
    return told


def _to_set(told: Mapping[str, Any]) -> str:
    """The setting without which no log like this one can be judged; empty where it is not for want of one."""
    for boot in told.get("boots", ()):
        for ability in boot["judges"]:
            if ability["question"] in _NEEDED and ability["answer"] == Extent.NO:
                return f"; for the next log set {ability['change']}"
    return ""


def about(job: Job) -> dict[str, Any]:
    """What every answer says of its log."""
    return {
        "log": str(job.log),
        "sha256": job.sha256,
        "version": installed_version(),
        **recorded(job.log),
    }


def error_text(stderr: str, code: int) -> str:
    """What a command of ``replay`` that failed says to a person."""
    if code < 0:
        return died(code)
    lines = [line for line in stderr.splitlines() if line.strip()]
    if lines and lines[0].startswith("Traceback"):
        return f"the program broke ({lines[-1]}); please report it"
    return (
        "\n".join(line.removeprefix("replay: ") for line in lines[-_MOST_LINES:])
        or f"ended with exit code {code}"
    )


def work(jobs: Sequence[Job], place: Place) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Answers in the order in which they come. A log that exceeds a limit fails for a passing reason."""
    for job, found in results(perform, {job: job for job in jobs}, place):
        if isinstance(found, Lost):
            yield job, {"error": found.why, "passing": True, **about(job)}
        else:
            yield job, found


def recorded(path: Path) -> dict[str, str]:
    """When the log was recorded: the first receiver stamp of a .tlog, else when the file was last changed."""
    try:
        if path.suffix.lower() == ".tlog":
            with path.open("rb") as file:
                stamp = int.from_bytes(file.read(8), "big")
            if _EARLIEST_US < stamp < _LATEST_US:
                return {"date": _text(stamp / 1e6), "date_from": "log"}
        return {"date": _text(path.stat().st_mtime), "date_from": "file"}
    except OSError:
        return {"date": "", "date_from": "unknown"}


def _text(epoch_s: float) -> str:
    return datetime.fromtimestamp(epoch_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
