"""What several commands do alike: read what is declared, and write an answer as it was asked for."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from companion.vehicles import default_vehicle
from models.choice import Choice, choose
from models.json_file import write_json
from models.pages.document import write_document
from models.vehicle import Vehicle, load_vehicle


def declared(vehicle_file: Path | str | None, model: str | None) -> tuple[Vehicle, Choice]:
    """The vehicle of ``--vehicle`` (without a file: the paper's tandem), and the model of ``--model`` for it."""
    vehicle = default_vehicle() if vehicle_file is None else load_vehicle(vehicle_file)
    return vehicle, choose(vehicle, model)


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
