"""``replay season``: arguments, files and text; the work is in season.py."""

from __future__ import annotations

import argparse
from datetime import date
from pathlib import Path
from typing import Any

from replay.pipeline_options import EXIT_CODES

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
    p.add_argument("--effect", metavar="NAME", help="only this effect")
    p.add_argument("--from", dest="first", type=_day, metavar="DAY", help="first day, 2026-05-31")
    p.add_argument("--to", dest="last", type=_day, metavar="DAY", help="last day")
    p.add_argument(
        "--alarm",
        action="store_true",
        help=f"exit code {CHANGED} where a size changed, or the last log of a vehicle has a new "
        "effect (for a job that runs every night)",
    )
    p.add_argument(
        "--view",
        choices=("sizes", "changes", "vehicles", "unjudged"),
        default="sizes",
        help="of --csv and --parquet: what has a row (default: sizes)",
    )
    p.add_argument("--csv", type=Path, metavar="FILE", help="write the view as CSV")
    p.add_argument(
        "--parquet", type=Path, metavar="FILE", help="write it as Parquet (extra: export)"
    )
    p.add_argument("--report", type=Path, metavar="DIR", help="write the page, as report.html")
    p.add_argument("--json", metavar="FILE", help="write the answer as JSON (- for stdout)")
    p.add_argument("--quiet", action="store_true", help="no text")
    p.set_defaults(run=run)


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is no day such as 2026-05-31") from None


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    # Imported here so that --help answers at once.
    from models.common.arguments import speaks
    from models.common.errors import ConfigError
    from replay.command import check_targets, write_answer
    from replay.fleet.season import Wanted, season
    from replay.fleet.season_page import page
    from replay.fleet.season_tables import check_parquet, write_csv, write_parquet
    from replay.fleet.store import Store

    check_targets(a)
    if a.parquet is not None:
        check_parquet()
    wanted = Wanted(a.vehicle, a.effect, a.first, a.last)
    with Store.open(a.store) as store:
        found = season(store, wanted)
        if a.vehicle is not None and not found.vehicles:
            raise ConfigError(f"--vehicle {a.vehicle}: the store has no log of it on these days")
        if a.csv is not None:
            write_csv(found, a.view, a.csv)
        if a.parquet is not None:
            write_parquet(found, a.view, a.parquet)
        content: dict[str, Any] = {}
        if a.json is not None:
            content = {"store": str(a.store), **found.as_json()}
        lines = [found.as_text()] if speaks(a) else []
        write_answer(a, content, lines, lambda: page(found))
    if a.alarm and found.altered:
        return CHANGED
    return 0
