"""``replay info``: arguments and output; the work is in info.py."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from models.errors import LogError

_EPILOG = """exit codes: 0 done; 2 bad arguments, vehicle or model file; 3 a log was unreadable; 130 interrupted."""


def add_parser(commands: Any) -> None:
    """Register ``info`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "info", help="what is in a log, and what can and cannot be judged with it", epilog=_EPILOG,
        description="What is in a log, at which rates and with which gaps; what can and cannot be judged with it, and "
        "the parameter that would change that; whether companion would have engaged.",
    )  # fmt: skip
    p.add_argument("logs", nargs="+", type=Path, metavar="LOG", help=".tlog, .BIN or .ulg")
    p.add_argument("--vehicle", type=Path, metavar="FILE.toml", help="vehicle file (default: the paper's tandem)")
    p.add_argument("--model", metavar="DIR", help="model directory, or none (default: the shipped model)")
    p.add_argument("--target-system", type=int, metavar="N", help="the vehicle's id (default: whichever flies)")
    p.add_argument(
        "--param", action="append", default=[], metavar="NAME=VALUE",
        help="take an autopilot parameter as given where a log lacks it, such as GUID_OPTIONS=8",
    )  # fmt: skip
    p.add_argument("--json", metavar="FILE", help="write the answers as a JSON list (- for stdout)")
    p.add_argument("--quiet", action="store_true", help="no progress bar and no text")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command. A log that cannot be read is one line on stderr, and the others are still read."""
    # Imported here so that --help answers at once.
    from tqdm import tqdm

    from models.json_file import write_json
    from replay.command import declared
    from replay.info.info import inspect
    from replay.parameters import assumed_parameters

    vehicle, chosen = declared(a.vehicle, a.model)
    shown = sys.stderr.isatty() and not a.quiet and len(a.logs) > 1
    assumed = assumed_parameters(a.param)
    answers: list[dict[str, Any]] = []
    failed = read = 0
    for path in tqdm(a.logs, unit="log", disable=not shown, leave=False, file=sys.stderr):
        try:
            answer = inspect(path, vehicle, chosen, a.target_system, assumed, quiet=a.quiet)
        except LogError as error:
            failed = error.exit_code
            answers.append({"log": str(path), "error": str(error)})
            print(f"replay: {error}", file=sys.stderr)
            continue
        read += 1
        answers.append(answer.as_json())
        if a.json != "-" and not a.quiet:
            print(answer.as_text())
    told = read > 0 and a.json != "-" and not a.quiet
    if told and chosen.note:
        print(chosen.note)
    if told and a.vehicle is None:
        print("no --vehicle was given: judged as the paper's tandem; give your own for answers about your vehicle")
    if a.json is not None:
        write_json(answers, a.json)
    return failed
