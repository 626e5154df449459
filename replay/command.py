"""What several commands do alike: read what is declared, and write an answer as it was asked for."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from companion.vehicles import default_vehicle
from models.choice import NONE, Choice, choose
from models.json_file import write_json
from models.pages.document import write_document
from models.surrogate.store import load
from models.vehicle import Vehicle, load_vehicle
from replay.vehicle.draft import INCH_M, Draft, Given, draft


def declared(vehicle_file: Path | str | None, model: str | None) -> tuple[Vehicle, Choice]:
    """The vehicle of ``--vehicle`` (without a file: the paper's tandem), and the model of ``--model`` for it."""
    vehicle = default_vehicle() if vehicle_file is None else load_vehicle(vehicle_file)
    return vehicle, choose(vehicle, model)


def given(a: argparse.Namespace) -> Given:
    """What ``--mass``, ``--propeller`` and ``--span`` say of a vehicle that is drafted."""
    return Given(a.mass, None if a.propeller is None else a.propeller * INCH_M, a.span)


def of_logs(
    vehicle_file: Path | str | None, model: str | None, logs: Sequence[Path], known: Given, target_system: int | None
) -> tuple[Vehicle, Choice, Draft | None]:
    """``declared``; without ``--vehicle`` the vehicle is drafted from the logs."""
    if vehicle_file is not None:
        return *declared(vehicle_file, model), None
    if model not in (None, NONE):  # a wrong model is said before the logs are read
        load(model)
    made = draft(logs, known, target_system)
    return made.vehicle, choose(made.vehicle, model), made


def write_answer(a: argparse.Namespace, content: Mapping[str, Any], text: str, page: Callable[[], str]) -> None:
    """Write what ``--json``, ``--report`` and ``--quiet`` ask for; ``log_faults`` of the content are printed first."""
    if a.json is not None:
        write_json(content, a.json)
    if a.report is not None:
        write_document("--report", a.report / "report.html", page())
    if a.json != "-" and not a.quiet:
        for fault in content["log_faults"]:
            print(f"{fault['channel']}: {fault['what']}")
        print(text)
        if a.report is not None:
            print(f"report: {a.report / 'report.html'}")
