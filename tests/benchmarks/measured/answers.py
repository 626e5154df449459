"""Ask ``replay diagnose`` about a flight as a user would: a command, its exit code and its JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnosis.declared import ENVIRONMENT, REPO, be_nice, train

from models.common.frames import GRAVITY

DATA = Path(os.environ.get("CORNER_SHARED", REPO.parent / "shared")) / "data"
"""Where recorded flights lie that are not part of the project."""


@dataclass(frozen=True)
class Asked:
    """What came back: the answer (None where there is none), exit code, last line on stderr, time it took."""

    answer: dict[str, Any] | None
    exit_code: int
    complaint: str
    seconds: float


def ask(
    logs: list[Path], vehicle: Path, model: str, timeout_s: float, environment: Mapping[str, str] | None = None,
    settings: Sequence[str] = (), drafted: bool = False,
) -> Asked:  # fmt: skip
    """Run the command on ``logs``; its exit code is -1 where it did not answer in time.

    ``settings``: numbers of the search that are others than its own, ``NAME=VALUE`` each. ``drafted``: of the vehicle
    file the command gets the mass alone.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "answer.json"
        program = (
            [str(Path(__file__).with_name("settings.py")), *settings, "--"]
            if settings
            else ["-m", "replay"]
        )
        command = [
            sys.executable, *program, "diagnose", *(str(log.resolve()) for log in logs),
            *(["--mass", f"{_mass_kg(vehicle):g}"] if drafted else ["--vehicle", str(vehicle.resolve())]),
            "--model", model, "--json", str(out), "--quiet",
        ]  # fmt: skip
        begun = time.perf_counter()
        try:
            done = subprocess.run(
                command, cwd=REPO, capture_output=True, text=True, timeout=timeout_s, check=False,
                env=ENVIRONMENT | (environment or {}), preexec_fn=be_nice,
            )  # fmt: skip
            code = done.returncode
            complaint = (done.stderr.strip().splitlines() or [""])[-1]
        except subprocess.TimeoutExpired:
            code = -1
            complaint = f"no answer in {timeout_s:g} s"
        answer = json.loads(out.read_text()) if code == 0 and out.exists() else None
        return Asked(answer, code, complaint, time.perf_counter() - begun)


def declared(table: Path) -> Path:
    """The model of a table of the air, kept in a temporary folder."""
    folder = Path(tempfile.gettempdir()) / "measured-flights"
    return train(table, "ensemble", folder)


def weight_n(vehicle: Path) -> float:
    """Declared weight of a vehicle file."""
    return _mass_kg(vehicle) * GRAVITY


def _mass_kg(vehicle: Path) -> float:
    return float(tomllib.loads(vehicle.read_text(encoding="utf-8"))["mass_kg"])
