"""``replay``: argument parsing and exit codes; nothing else."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from models.common.arguments import Parser, VersionAction, run_command
from models.common.errors import TOO_LARGE, ConfigError, LogError
from replay.pipeline_options import (
    EXIT_CODES,
    add_answer_options,
    add_folder_options,
    add_pipeline_options,
    assumed_parameters,
    pipeline_config,
)

_COMMANDS = (
    "replay.diagnosis.cli",
    "replay.predict.cli",
    "replay.fleet.season_cli",
    "replay.info.cli",
    "replay.export.cli",
    "replay.audit",
    "replay.desk.cli",
)
"""Modules with ``add_parser(commands)``, which sets ``run``."""
_THREADS = "OMP_NUM_THREADS"
"""How many threads linear algebra uses; it reads this once, when numpy is imported."""


def parser() -> argparse.ArgumentParser:
    """The command line of ``replay``."""
    p = Parser(
        prog="replay",
        description="Recorded flights: what the companion decides on them, and what its model "
        "lacks.",
        epilog=EXIT_CODES,
    )
    p.add_argument("--version", action=VersionAction, nargs=0, help="print the version and exit")
    commands = p.add_subparsers(dest="command", required=True, metavar="COMMAND")
    run = commands.add_parser(
        "run",
        help="feed a log through the flight pipeline and report its decisions",
        epilog=EXIT_CODES,
        description="Feed a recorded log through the same pipeline as in flight, with the same "
        "decisions.",
    )
    run.add_argument(
        "log", type=Path, metavar="LOG", help=".tlog, .BIN or .ulg; or a folder of them"
    )
    add_pipeline_options(run)
    run.add_argument(
        "--report", type=Path, metavar="DIR", help="write one self-contained HTML page"
    )
    add_answer_options(run, "the report as JSON")
    add_folder_options(run)
    run.set_defaults(run=_run)
    for module in _COMMANDS:
        import_module(module).add_parser(commands)
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    # Matrices here are small: a second thread would wait for the first, and take a core to do so.
    os.environ.setdefault(_THREADS, "1")
    arguments = parser().parse_args(argv)
    return run_command("replay", "replay", lambda: _checked(arguments))


def _checked(a: argparse.Namespace) -> int:
    system = getattr(a, "target_system", None)  # a store has none
    if system is not None and not 1 <= system <= 255:
        raise ConfigError(f"--target-system {system}: must be 1 to 255")
    try:
        return int(a.run(a))
    except MemoryError:
        raise LogError(f"{TOO_LARGE}: cut it, or use a machine with more") from None


def _run(a: argparse.Namespace) -> int:
    if a.log.is_dir():
        return _run_folder(a)
    # Imported here so that --help answers at once.
    from replay.command import flown, refuse_of_folder, write_answer
    from replay.rerun.history import History
    from replay.rerun.report import run

    refuse_of_folder(a)
    vehicle, model, assumed = flown(a)
    config, chosen, notes = pipeline_config(a, (vehicle, model))
    history = History()
    report = run(
        a.log,
        config,
        chosen.name,
        a.target_system,
        assumed_parameters(a.param),
        quiet=a.quiet or a.json == "-",
        watch=history.watch,
    )
    report.notes[:0] = [*notes, *assumed]
    # Imported where a page is asked for: it needs the extra "replay", the answer does not.
    write_answer(
        a,
        report.as_json(),
        [report.as_text()],
        lambda: import_module("replay.rerun.page").page(report, history),
    )
    return 0


def _run_folder(a: argparse.Namespace) -> int:
    from replay.command import refuse
    from replay.fleet.folder import run_folder

    refuse(a, ("survey",), f"is of one flight; name one log instead of the folder {a.log}")
    assumed_parameters(a.param)  # a wrong one is said once, before the work
    return run_folder(
        a, a.log, {"--setpoint": a.setpoint, "--param": a.param, "--adapt": a.adapt.value}
    )
