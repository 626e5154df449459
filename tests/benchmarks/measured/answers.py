"""Ask ``replay diagnose`` about a flight as a user would: a command, its exit code and its JSON."""

from __future__ import annotations

import os
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from diagnosis.declared import REPO, train
from diagnosis.one_answer import Asked, run

from models.common.frames import GRAVITY

DATA = Path(os.environ.get("CORNER_SHARED", REPO.parent / "shared")) / "data"
"""Where recorded flights lie that are not part of the project."""


def ask(
    logs: list[Path],
    vehicle: Path,
    model: str,
    timeout_s: float,
    environment: Mapping[str, str] | None = None,
    settings: Sequence[str] = (),
    drafted: bool = False,
) -> Asked:
    """Run the command on ``logs``; its exit code is -1 where it did not answer in time.

    ``settings``: numbers of the search that are others than its own, ``NAME=VALUE`` each. ``drafted``: of the vehicle
    file the command gets the mass alone.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "answer.json"
        if settings:
            program = [str(Path(__file__).with_name("settings.py")), *settings, "--"]
        else:
            program = ["-m", "replay"]
        if drafted:
            known = ["--mass", f"{_mass_kg(vehicle):g}"]
        else:
            known = ["--vehicle", str(vehicle.resolve())]
        paths = [str(log.resolve()) for log in logs]
        arguments = [*program, "diagnose", *paths, *known, "--model", model]
        return run(arguments, out, timeout_s, environment)


def declared(table: Path) -> Path:
    """The model of a table of the air, kept in a temporary folder."""
    folder = Path(tempfile.gettempdir()) / "measured-flights"
    return train(table, "ensemble", folder)


def weight_n(vehicle: Path) -> float:
    """Declared weight of a vehicle file."""
    return _mass_kg(vehicle) * GRAVITY


def _mass_kg(vehicle: Path) -> float:
    return float(tomllib.loads(vehicle.read_text(encoding="utf-8"))["mass_kg"])
