"""``replay export``: arguments and files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from models.common.errors import ConfigError, LogError
from models.common.extras import how_to_install
from replay.pipeline_options import add_pipeline_options, assumed_parameters, pipeline_config

_EPILOG = """exit codes: 0 done; 2 bad arguments, a missing package or an unwritable file; 3 log unreadable;
130 interrupted. Columns and units: docs/logs.md."""

_PACKAGES = {"parquet": "pyarrow", "mcap": "mcap.writer"}
"""What a format needs that is installed with the extra ``export``."""


def add_parser(commands: Any) -> None:
    """Register ``export`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "export",
        help="a log and the decisions on it as Parquet, CSV or MCAP, with units",
        epilog=_EPILOG,
        description="Everything a log holds, and what the companion decides on it, in SI units "
        "on the vehicle's boot clock: as one table, or as MCAP for Foxglove.",
    )
    p.add_argument("log", type=Path, metavar="LOG", help=".tlog, .BIN or .ulg")
    p.add_argument("--to", required=True, choices=("parquet", "csv", "mcap"), help="format")
    p.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write (default: the log's name, in this folder)",
    )
    add_pipeline_options(p)
    p.add_argument(
        "--no-decisions", action="store_true", help="only what the log holds, which takes less time"
    )
    p.add_argument(
        "--target-system", type=int, metavar="N", help="the vehicle's id (default: whichever flies)"
    )
    p.add_argument("--quiet", action="store_true", help="no progress bar and no text")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    from models.common.arguments import installed_version
    from replay.command import of_logs
    from replay.export.columns import table
    from replay.export.decided import decide
    from replay.export.files import write_csv, write_parquet
    from replay.export.mcap_file import write_mcap
    from replay.logs.formats import load
    from replay.vehicle.given import Given

    _check_package(a.to)
    target = Path(f"{a.log.stem}.{a.to}") if a.out is None else a.out
    try:
        with _whole(target) as part:
            logs = load(a.log, a.target_system)
            decisions = {}
            pipeline = {}
            notes = list[str]()
            if not a.no_decisions and any(log.attitude is not None for log in logs):
                try:
                    vehicle, choice, made = of_logs(
                        a.vehicle, a.model, [a.log], Given(), a.target_system
                    )
                except LogError as error:
                    notes = [f"no decisions without --vehicle: {error}"]
                else:
                    config, chosen, notes = pipeline_config(a, (vehicle, choice))
                    notes += [] if made is None else made.notes
                    decisions = decide(
                        a.log, config, a.target_system, assumed_parameters(a.param), quiet=a.quiet
                    )
                    pipeline = {"vehicle": config.vehicle.name, "model": chosen.name}
            tables = []
            for log in logs:
                tables.append(
                    table(log, decisions[log.boot].columns() if log.boot in decisions else ())
                )
            columns = list({c.name: c.blank() for one in tables for c in one.columns}.values())
            about = {
                "log": a.log.name,
                "system": str(logs[0].system),
                "made_by": f"corner-compensator {installed_version()}",
                "frames": "world NED, body FRD, SI units",
                **pipeline,
            }
            {"csv": write_csv, "parquet": write_parquet, "mcap": write_mcap}[a.to](
                part, tables, columns, about
            )
    except OSError as error:
        raise ConfigError(
            f"--out {target}: cannot be written ({error.strerror or error})"
        ) from None
    if not a.quiet:
        rows = sum(len(one.t_s) for one in tables)
        print(f"{target}: {rows} rows, {len(columns)} columns and time_s, {len(logs)} boot(s)")
        if decisions:
            print(f"  decided as vehicle “{pipeline['vehicle']}” with model “{pipeline['model']}”")
        for note in notes:
            print(f"  note: {note}")
    return 0


def _check_package(kind: str) -> None:
    """Refuse a kind of file whose package is not installed."""
    package = _PACKAGES.get(kind)
    if package is not None and find_spec(package) is None:
        need = f"--to {kind}: needs the package {package.partition('.')[0]}"
        raise ConfigError(f"{need}: {how_to_install('export')}, or --to csv")


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Where to write what becomes ``path`` when all of it is written: an error leaves what was there before."""
    if path.exists() and not path.is_file():  # a device or a pipe; a directory cannot be opened
        yield path
        return
    path = path.resolve()
    part = path.with_name(f".{path.name}.part")
    try:
        part.touch()
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
