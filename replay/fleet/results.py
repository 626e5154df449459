"""Answers on disk, one file a log: what is there need not be computed again."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from models.errors import ConfigError, LogError
from replay.fleet.jobs import Job
from replay.logs.formats import READERS


class Results:
    """The folder ``results`` below ``out``."""

    def __init__(self, out: Path) -> None:
        self.folder = out / "results"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"--out {out}: cannot be written ({error.strerror})") from None

    def _file(self, job: Job) -> Path:
        return self.folder / f"{Path(job.path).stem}-{job.key()}.json"

    def known(self, job: Job) -> dict[str, Any] | None:
        """The answer of an earlier run to exactly this question."""
        try:
            answer = json.loads(self._file(job).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        if not isinstance(answer, dict) or (job.pages and "page" in answer and not Path(answer["page"]).is_file()):
            return None
        return answer

    def keep(self, job: Job, answer: dict[str, Any]) -> None:
        """Write an answer; an interruption leaves the whole file or none."""
        try:
            target = self._file(job)
            part = target.with_suffix(".part")
            part.write_text(json.dumps(answer, indent=1, allow_nan=False) + "\n", encoding="utf-8")
            os.replace(part, target)
        except OSError as error:
            raise ConfigError(f"--out {self.folder}: cannot be written ({error.strerror})") from None


def logs_in(folder: Path) -> tuple[list[Path], list[str]]:
    """Every log below a folder in order of name, and a line for what looks like one and cannot be read."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    found = [p for p in files if p.suffix.lower() in READERS]
    packed = [p for p in files if p not in found and len(p.suffixes) > 1 and p.suffixes[-2].lower() in READERS]
    notes = [f"{p}: is compressed: unpack it first" for p in packed]
    if not found:
        known = ", ".join(READERS)
        raise LogError(f"{folder}: holds no log ({known}){'; ' + notes[0] if notes else ''}")
    return found, notes
