"""``replay diagnose``: arguments, files and text; the work is in diagnose.py."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from companion.vehicles import vehicle_path
from models.common.errors import ConfigError
from replay.pipeline_options import EXIT_CODES, add_answer_options, add_folder_options
from replay.source_options import add_source_option

if TYPE_CHECKING:
    from models.surrogate.fan_surrogate import FanSurrogate
    from models.vehicle import Vehicle
    from replay.progress import Step

_EPILOG = f"{EXIT_CODES} How to read the answer: docs/diagnose.md."


def add_parser(commands: Any) -> None:
    """Register ``diagnose`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "diagnose",
        help="find what the declared model lacks, name it, and amend the model",
        epilog=_EPILOG,
        description="Measured minus modelled wrench of recorded flights: which physical effect "
        "is missing, how large it is, and the error before and after adding it, on held-out time.",
    )
    p.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help=".tlog, .BIN or .ulg; several confirm each other; a folder: each by itself",
    )
    p.add_argument(
        "--vehicle",
        type=vehicle_path,
        metavar="FILE",
        help="vehicle file (default: drafted from the logs)",
    )
    _add_fleet_options(p)
    _add_draft_options(p)
    p.add_argument(
        "--model",
        metavar="DIR",
        help="declared model, or none: rotors in free air (default: the shipped model)",
    )
    p.add_argument(
        "--save-model",
        type=Path,
        metavar="DIR",
        help="write the amended model; companion --model flies it",
    )
    p.add_argument(
        "--test",
        nargs="+",
        type=Path,
        default=[],
        metavar="LOG",
        help="other flights, on which the amended model is judged as replay predict does",
    )
    p.add_argument(
        "--report",
        type=Path,
        metavar="DIR",
        help="write a self-contained HTML page; for a folder, of each log",
    )
    p.add_argument(
        "--since",
        nargs="+",
        metavar="GOOD",
        help="good flights of the vehicle: name only what changed since (with a folder: how many "
        "of its first logs)",
    )
    add_source_option(p)
    add_answer_options(p)
    add_folder_options(p)
    p.set_defaults(run=run)


def _add_fleet_options(p: argparse.ArgumentParser) -> None:
    """What tells the vehicles of a folder apart, and what looks at it again."""
    p.add_argument(
        "--vehicles",
        type=Path,
        metavar="DIR",
        help="of a folder: vehicle files by identity, NAME.toml (default: one draft a vehicle)",
    )
    p.add_argument(
        "--watch",
        nargs="?",
        type=float,
        const=0.0,
        metavar="SECONDS",
        help="of a folder: say only what is new since the last look; with SECONDS look again and "
        "again (exit codes: docs/logs.md)",
    )


def _add_draft_options(p: argparse.ArgumentParser) -> None:
    """Of a vehicle that is drafted from the logs."""
    p.add_argument(
        "--mass",
        type=float,
        metavar="KG",
        help="of the drafted vehicle, with battery (default: typical)",
    )
    p.add_argument("--propeller", type=float, metavar="INCH", help="diameter (default: typical)")
    p.add_argument(
        "--span",
        type=float,
        metavar="M",
        help="motor axis to the opposite motor's axis (default: no moments)",
    )
    p.add_argument(
        "--save-vehicle",
        type=Path,
        metavar="FILE.toml",
        help="write the drafted vehicle for --vehicle",
    )


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    # Imported here so that --help answers at once.
    from replay.command import check_targets, refuse_of_folder
    from replay.progress import Step, said_often

    _check_drafting(a)
    check_targets(a)
    if a.since:
        from replay.changes.cli import run as run_since

        return run_since(a)
    if any(log.is_dir() for log in a.logs):
        return _folder(a)
    refuse_of_folder(a)
    step = Step(text="reads the logs")
    with said_often(step.line, silent=a.quiet or sys.stderr.isatty()):
        return _judge(a, step)


def _judge(a: argparse.Namespace, step: Step) -> int:
    """Logs of one vehicle together."""
    from models.common.text_file import write_text
    from models.vehicle.plausibility import warnings
    from replay.command import fault_lines, given, of_logs, progress_bar, write_answer
    from replay.diagnosis.amended_model import amended
    from replay.diagnosis.diagnose import diagnose
    from replay.diagnosis.model_faults import model_faults

    vehicle, chosen, draft = of_logs(a.vehicle, a.model, a.logs, given(a), a.target_system)
    if draft is not None and a.save_vehicle is not None:
        write_text("--save-vehicle", a.save_vehicle, draft.as_toml())
    step.text = "judges the logs"
    answer = diagnose(
        a.logs,
        vehicle,
        chosen.judged,
        target_system=a.target_system,
        settings=given(a).settings,
        read=None if draft is None else draft.read,
        progress=progress_bar(a),
    )
    faults = model_faults(answer.records, chosen)
    if chosen.note is None:
        notes = []
    else:
        notes = [chosen.note]
    notes += warnings(vehicle) if draft is None else draft.notes
    answer = replace(answer, notes=(*notes, *answer.notes))
    content = answer.as_json(None if a.save_model is None else str(a.save_model))
    content["log_faults"] = [*faults, *content["log_faults"]]
    lines = [*fault_lines(faults), answer.as_text()]
    if draft is not None:
        content["vehicle"] = draft.as_json()
        lines = [
            "vehicle drafted from the log",
            *(f"  {fact.as_text()}" for fact in draft.known),
            *lines,
        ]
    if a.save_model is not None or a.test:
        made = amended(chosen.judged, vehicle, answer.adopted, [r.path for r in answer.records])
        lines += _use(a, made, vehicle, content)

    def page() -> str:
        # Templates are loaded only where a page is asked for.
        from replay.diagnosis import html_report

        return html_report.page(answer, vehicle, faults)

    write_answer(a, content, lines, page)
    return 0


def _use(
    a: argparse.Namespace, made: FanSurrogate, vehicle: Vehicle, content: dict[str, Any]
) -> list[str]:
    """Test the amended model on other flights, and write it; lines of what came of it."""
    from models.surrogate.store import save_model
    from replay.command import progress_bar
    from replay.predict.predict import predict

    lines = []
    if a.test:
        test = predict(
            a.test, vehicle, made, target_system=a.target_system, progress=progress_bar(a)
        )
        content["test"] = test.as_json(content["model"])
        lines.append(f"on other flights, {test.as_text()}")
    if a.save_model is not None:
        save_model(a.save_model, made)
        lines.append(f"amended model: {a.save_model}")
    return lines


def _check_drafting(a: argparse.Namespace) -> None:
    from replay.command import refuse
    from replay.vehicle.given import MOST_INCH, MOST_KG, MOST_SPAN_M, check_size

    check_size("--mass", a.mass, MOST_KG)
    check_size("--propeller", a.propeller, MOST_INCH)
    check_size("--span", a.span, MOST_SPAN_M)
    if a.vehicle is not None:
        why = "is of a drafted vehicle, and --vehicle gives one; leave one of them out"
        refuse(a, ("mass", "propeller", "span", "save_vehicle", "vehicles"), why)


def _folder(a: argparse.Namespace) -> int:
    from replay.command import refuse
    from replay.fleet.folder import check_folder, run_folder
    from replay.fleet.watch import watch

    if len(a.logs) > 1:
        raise ConfigError(
            "a folder is diagnosed log by log: give it alone, or name the logs that belong together"
        )
    instead = f"give those of one vehicle by name, as in replay diagnose {a.logs[0]}/*.tlog"
    for option in ("test", "save_vehicle", "save_model"):
        said = f"a folder's logs may be of several vehicles; {instead} --{option.replace('_', '-')}"
        refuse(a, (option,), said)
    refuse(a, ("set",), f"names an instance of one log; give that log, not the folder {a.logs[0]}")
    options = {"--mass": a.mass, "--propeller": a.propeller, "--span": a.span}
    if a.watch is None:
        return run_folder(a, a.logs[0], options)
    if not 0.0 <= a.watch < math.inf:
        raise ConfigError(f"--watch {a.watch:g}: must be 0 (one look) or seconds between looks")
    check_folder(a)
    return watch(a, a.logs[0], options, a.watch or None)
