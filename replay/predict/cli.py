"""``replay predict``: arguments, files and text; the work is in predict.py."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from companion.vehicles import vehicle_path
from models.common.errors import ConfigError
from replay.pipeline_options import EXIT_CODES, add_answer_options

MOST_S = 10.0
"""Longest horizon: far beyond what an open loop can foretell of a multirotor."""

if TYPE_CHECKING:
    from models.choice import Choice
    from models.vehicle import Vehicle


def add_parser(commands: Any) -> None:
    """Register ``predict`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "predict",
        help="the error of a model on flights that it was not made from",
        epilog=EXIT_CODES,
        description="Measured minus modelled wrench of flights that a model was not made from, "
        "with and without its adopted effects, by axis and by how and where it flew. Nothing of "
        "the vehicle is fitted.",
    )
    p.add_argument("logs", nargs="+", type=Path, metavar="LOG", help=".tlog, .BIN or .ulg")
    p.add_argument("--vehicle", type=vehicle_path, metavar="FILE", help="vehicle file of the model")
    p.add_argument(
        "--model",
        metavar="DIR",
        required=True,
        help="model directory, as replay diagnose --save-model wrote",
    )
    p.add_argument(
        "--frozen",
        action="store_true",
        help="fit nothing; without it, wind, load and accelerometer offset come from the first "
        "20 s of each flight",
    )
    p.add_argument(
        "--horizon",
        type=seconds,
        metavar="S",
        help="the motion, too: from every measured state so many seconds ahead, by measured rotor "
        "speeds or outputs",
    )
    p.add_argument(
        "--report", type=Path, metavar="DIR", help="write the page there, as report.html"
    )
    add_answer_options(p)
    p.set_defaults(run=run)


def seconds(text: str) -> float:
    """A time ahead [s]."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= MOST_S:
        raise argparse.ArgumentTypeError(f"{text} is no time between 0 and {MOST_S:g} s")
    return value


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    # Imported here so that --help answers at once.
    from replay.command import check_targets, fault_lines, progress_bar, write_answer
    from replay.diagnosis.model_faults import model_faults
    from replay.predict.page import page
    from replay.predict.predict import predict

    check_targets(a)
    folders = [log for log in a.logs if log.is_dir()]
    if folders:
        raise ConfigError(
            f"{folders[0]}: is a folder; name the logs, as in replay predict {folders[0]}/*.tlog"
        )
    vehicle, chosen = _vehicle(a)
    answer = predict(
        a.logs,
        vehicle,
        chosen.model,
        frozen=a.frozen,
        horizon_s=a.horizon,
        target_system=a.target_system,
        progress=progress_bar(a),
    )
    faults = model_faults(answer.records, chosen)
    content = answer.as_json(a.model) | {"log_faults": faults}
    write_answer(
        a, content, [*fault_lines(faults), answer.as_text()], lambda: page(answer, a.model)
    )
    return 0


def _vehicle(a: argparse.Namespace) -> tuple[Vehicle, Choice]:
    """The vehicle of ``--vehicle``; without it only one that needs no fit: the paper's tandem, where the logs show it.

    A draft would fit the vehicle to the flights that are to be foretold.
    """
    from companion.vehicles import default_vehicle
    from replay.command import declared, of_logs
    from replay.vehicle.given import Given

    if a.vehicle is not None:
        return declared(a.vehicle, a.model)
    vehicle, chosen, _ = of_logs(None, a.model, a.logs, Given(), a.target_system, measured=False)
    if vehicle != default_vehicle():
        raise ConfigError(
            "--vehicle: is missing: name the vehicle file that the model was made with; replay "
            "diagnose LOG --save-vehicle FILE drafts one"
        )
    return vehicle, chosen
