"""``replay info``: arguments and output; the work is in info.py."""

from __future__ import annotations

import argparse
import sys
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from companion.vehicles import vehicle_path
from models.common.arguments import speaks
from models.common.errors import LogError
from replay.pipeline_options import add_answer_options, assumed_parameters
from replay.source_options import add_source_option, source_settings

_EPILOG = """exit codes: 0 done; 2 bad arguments, vehicle or model file; 3 a log was unreadable; 130 interrupted."""


def add_parser(commands: Any) -> None:
    """Register ``info`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "info",
        help="what is in a log, and what can and cannot be judged with it",
        epilog=_EPILOG,
        description="What is in a log, at which rates and with which gaps; what can and cannot "
        "be judged with it, and the parameter that would change that; with --companion, whether "
        "it would have engaged.",
    )
    p.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help=".tlog, .BIN or .ulg; a folder: one line a log",
    )
    p.add_argument(
        "--vehicle",
        type=vehicle_path,
        metavar="FILE",
        help="vehicle file (default: drafted from each log)",
    )
    p.add_argument(
        "--companion", action="store_true", help="decide as companion would have, too: takes longer"
    )
    p.add_argument(
        "--model", metavar="DIR", help="model directory, or none (default: the shipped model)"
    )
    p.add_argument(
        "--param",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="take an autopilot parameter as given where a log lacks it, such as GUID_OPTIONS=8",
    )
    add_source_option(p)
    add_answer_options(p, "the answers as a JSON list")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command. A log that cannot be read is one line on stderr, and the others are still read."""
    # Imported here so that --help answers at once.
    from companion.config import PipelineConfig
    from models.common.text_file import write_json
    from replay.command import check_declared, of_logs, progress_bar
    from replay.fleet.results import logs_in
    from replay.info.info import decided, inspect, unasked
    from replay.logs.formats import load
    from replay.vehicle.given import Given

    check_declared(a.vehicle, a.model)
    folders = any(log.is_dir() for log in a.logs)
    named: dict[Path, str] = {}
    for log in a.logs:
        found, above = (logs_in(log)[0], log) if log.is_dir() else ([log], log.parent)
        named |= {path: str(path.relative_to(above)) for path in found}
    assumed = assumed_parameters(a.param)
    known = Given(settings=source_settings(a.set))
    answers: list[dict[str, Any]] = []
    failed = 0
    for path in progress_bar(a)(list(named)):
        vehicle_and_model = partial(of_logs, a.vehicle, a.model, [path], known, a.target_system)
        refusal = ""
        vehicle = None
        draft = None
        try:
            vehicle, chosen, draft = vehicle_and_model(measured=a.companion)
        except LogError as error:
            refusal = str(error).removeprefix(f"{path}: ")
            if a.companion:
                with suppress(LogError):  # no diagnosis takes it, but its vehicle may be known
                    vehicle, chosen, _ = vehicle_and_model(measured=False)
        try:
            read = {} if draft is None else draft.read
            logs = read.get(path) or load(path, a.target_system, known.settings)
            answer = inspect(path, logs, vehicle, refusal)
        except LogError as error:
            failed = error.exit_code
            answers.append({"log": str(path), "error": str(error)})
            print(f"replay: {error}", file=sys.stderr)
            continue
        if a.companion and vehicle is not None:
            config = PipelineConfig(vehicle=vehicle, model=chosen.model, dry_run=True)
            answer = replace(
                answer, companion=decided(path, config, a.target_system, assumed, quiet=a.quiet)
            )
        elif a.companion:
            answer = replace(answer, companion=unasked(refusal))
        content = answer.as_json()
        if draft is not None and a.companion:
            content["drafted"] = draft.as_json()
        answers.append(content)
        if speaks(a):
            print(answer.as_line(named[path]) if folders else answer.as_text())
            if a.companion and vehicle is not None and chosen.note and not folders:
                print(chosen.note)
    if a.json is not None:
        write_json(answers, a.json)
    return failed
