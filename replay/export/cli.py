"""``replay export``: arguments and files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from models.errors import ConfigError, LogError
from replay.parameters import assumed_parameters
from replay.pipeline_options import add_pipeline_options, pipeline_config

_EPILOG = """exit codes: 0 done; 2 bad arguments, a missing package or an unwritable file; 3 log unreadable;
130 interrupted. Columns and units: docs/logs.md."""


def add_parser(commands: Any) -> None:
    """Register ``export`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "export", help="a log and the decisions on it as Parquet, CSV or MCAP, with units", epilog=_EPILOG,
        description="Everything a log holds, and what the companion decides on it, in SI units on the vehicle's boot "
        "clock: as one table, or as MCAP for Foxglove.",
    )  # fmt: skip
    p.add_argument("log", type=Path, metavar="LOG", help=".tlog, .BIN or .ulg")
    p.add_argument("--to", required=True, choices=("parquet", "csv", "mcap"), help="format")
    p.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: the log's name, in this folder)")
    add_pipeline_options(p)
    p.add_argument("--no-decisions", action="store_true", help="only what the log holds, which takes less time")
    p.add_argument("--target-system", type=int, metavar="N", help="the vehicle's id (default: whichever flies)")
    p.add_argument("--quiet", action="store_true", help="no progress bar and no text")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    from models.version import installed_version
    from replay.command import of_logs
    from replay.export.decided import Decided
    from replay.export.files import write_csv, write_parquet
    from replay.export.mcap_file import write_mcap
    from replay.export.tables import Tables
    from replay.vehicle.draft import Given

    decided, pipeline, notes = None, {}, list[str]()
    if not a.no_decisions:
        try:
            vehicle, choice, made = of_logs(a.vehicle, a.model, [a.log], Given(), a.target_system)
        except LogError as error:
            notes = [f"no decisions without --vehicle: {error}"]
        else:
            config, chosen, notes = pipeline_config(a, (vehicle, choice))
            notes += [] if made is None else made.notes
            decided = Decided(a.log, config, assumed_parameters(a.param))
            pipeline = {"vehicle": config.vehicle.name, "model": chosen.name}
    tables = Tables(a.log, a.target_system, decided, quiet=a.quiet)
    target = Path(f"{a.log.stem}.{a.to}") if a.out is None else a.out
    about = {
        "log": a.log.name,
        "system": str(tables.system),
        "made_by": f"corner-compensator {installed_version()}",
        "frames": "world NED, body FRD, SI units",
        **pipeline,
    }
    write = {"csv": write_csv, "parquet": write_parquet, "mcap": write_mcap}[a.to]
    try:
        written = write(target, tables, about)
    except OSError as error:
        raise ConfigError(f"--out {target}: cannot be written ({error.strerror or error})") from None
    if not a.quiet:
        print(f"{target}: {written.rows} rows, {written.columns} columns and time_s, {tables.boots} boot(s)")
        if decided is not None:
            print(f"  {decided.decisions} decisions, vehicle “{pipeline['vehicle']}”, model “{pipeline['model']}”")
        for note in notes:
            print(f"  note: {note}")
    return 0
