"""``replay season``: arguments, files and text; the work is in season.py."""

from __future__ import annotations

import argparse
import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from replay.pipeline_options import EXIT_CODES

if TYPE_CHECKING:
    from replay.fleet.season import Season

CHANGED = 1
"""Exit code of ``--alarm``: something changed, or is new."""


def add_parser(commands: Any) -> None:
    """Register ``season`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "season",
        help="every vehicle of a store over time: sizes, changes, what is new",
        epilog=EXIT_CODES,
        description="What the answers that replay diagnose FOLDER stored say of every vehicle: "
        "sizes of its effects over time, what changed and since which log, what is new, and which "
        "logs cannot be judged.",
    )
    p.add_argument(
        "store", type=Path, metavar="STORE", help="store.sqlite, or the folder that holds it"
    )
    p.add_argument("--vehicle", metavar="NAME", help="only this vehicle, as the text names it")
    p.add_argument(
        "--alarm",
        action="store_true",
        help=f"exit code {CHANGED} where a size changed, or the last log of a vehicle has a new "
        "effect (for a job that runs every night)",
    )
    p.add_argument("--csv", type=Path, metavar="FILE", help="write every size, a row each")
    p.add_argument("--report", type=Path, metavar="DIR", help="write the page, as report.html")
    p.add_argument("--json", metavar="FILE", help="write the answer as JSON (- for stdout)")
    p.add_argument("--quiet", action="store_true", help="no text")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    # Imported here so that --help answers at once.
    from models.common.errors import ConfigError
    from models.common.pages.document import write_document
    from replay.command import check_targets, write_answer
    from replay.fleet.season import season
    from replay.fleet.season_page import page
    from replay.fleet.store import Store

    check_targets(a)
    with Store.open(a.store) as store:
        found = season(store, a.vehicle)
    if a.vehicle is not None and not found.vehicles:
        raise ConfigError(f"--vehicle {a.vehicle}: the store has no log of it")
    if a.csv is not None:
        write_document("--csv", a.csv, as_csv(found))
    content = {"store": str(a.store), **found.as_json()}
    write_answer(a, content, [found.as_text()], lambda: page(found))
    alarm = any(v.changed or v.new for v in found.vehicles)
    if a.alarm and alarm:
        return CHANGED
    return 0


def as_csv(found: Season) -> str:
    """A row for every size of every log."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ("vehicle", "date", "log", "effect", "parameter", "value", "low", "high", "unit")
    )
    for v in found.vehicles:
        for course in v.courses:
            for s in course.sizes:
                writer.writerow(
                    (
                        v.vehicle,
                        s.date,
                        s.log,
                        course.effect,
                        course.parameter,
                        s.value,
                        s.low,
                        s.high,
                        course.unit,
                    )
                )
    return text.getvalue()
