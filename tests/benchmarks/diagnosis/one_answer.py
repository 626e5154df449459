"""``replay diagnose`` on one simulated flight, and what the commands that do so for many have in common."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from result_file import add_option

from diagnosis.declared import ENVIRONMENT, REPO, be_nice


@dataclass(frozen=True)
class Asked:
    """What came back: the answer (None where there is none), exit code, what stderr says, time it took."""

    answer: dict[str, Any] | None
    exit_code: int = 0
    complaint: str = ""
    seconds: float = 0.0

    @property
    def last_words(self) -> str:
        """Last line of the complaint; empty where there is an answer."""
        if self.answer is not None:
            return ""
        return (self.complaint.splitlines() or [""])[-1]


def run(
    arguments: Sequence[str],
    out: Path,
    timeout_s: float,
    environment: Mapping[str, str] | None = None,
) -> Asked:
    """Run python with ``arguments`` that write an answer to ``out``; exit code -1 where none came in time."""
    out.unlink(missing_ok=True)
    begun = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, *arguments, "--json", str(out), "--quiet"],
            cwd=REPO,
            env=ENVIRONMENT | (environment or {}),
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
            preexec_fn=be_nice,
        )
    except subprocess.TimeoutExpired:
        return Asked(None, -1, f"no answer in {timeout_s:g} s", time.perf_counter() - begun)
    answer = None
    if done.returncode == 0 and out.exists():
        answer = json.loads(out.read_text())
    return Asked(answer, done.returncode, done.stderr.strip(), time.perf_counter() - begun)


def diagnose(flight: Path, model: Path | None, out: Path, timeout_s: float) -> Asked:
    """The answer on ``flight``.tlog with ``flight``.toml, kept as ``out``; ``model`` None: the empty one."""
    arguments = ["-m", "replay", "diagnose", f"{flight}.tlog", "--vehicle", f"{flight}.toml"]
    return run([*arguments, "--model", str(model or "none")], out, timeout_s)


def add_options(p: argparse.ArgumentParser, *, timeout_s: float) -> None:
    """Where flights are kept, how they are diagnosed, and where results go."""
    p.add_argument(
        "--keep", type=Path, metavar="DIR", help="folder of flights (default: a temporary one)"
    )
    p.add_argument("--method", default="ensemble", help="how the declared model is trained")
    p.add_argument("--jobs", type=int, default=1, help="diagnoses at a time")
    p.add_argument("--timeout", type=float, default=timeout_s, metavar="S")
    p.add_argument("--json", metavar="FILE", help="write every judgement (- for stdout)")
    add_option(p)


def write_rows(file: str | None, rows: Iterable[Any]) -> None:
    """Every judgement as JSON, where a file or - was given."""
    if not file:
        return
    text = json.dumps([asdict(row) for row in rows], indent=1)
    if file == "-":
        print(text)
    else:
        Path(file).write_text(text)
