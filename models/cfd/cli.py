"""``models cfd``: run the cases, assemble the data set."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from models.common.arguments import speaks
from models.common.errors import ConfigError

SHIPPED_CASES = Path(__file__).parents[1] / "data" / "corner_cfd_cases.csv"


def add(commands: Any, every: argparse.ArgumentParser) -> None:
    """Add the ``cfd`` command to the commands of ``models``; ``every``: the options that each command has."""
    parser = commands.add_parser(
        "cfd", help="compute a fan's wrench near ground and wall with an open flow solver"
    )
    what = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    common = argparse.ArgumentParser(add_help=False, parents=[every])
    common.add_argument(
        "--fan", type=Path, metavar="FILE", help="fan file (default: the built-in fan)"
    )

    run = what.add_parser(
        "run",
        parents=[common],
        help="compute all cases that are not there yet; Ctrl-C and run again to go on",
    )
    run.add_argument(
        "--work", required=True, type=Path, metavar="DIR", help="cases, their logs and states"
    )
    run.add_argument(
        "--model",
        choices=("half", "full"),
        default="half",
        help="half models without swirl (default), or full models with swirl",
    )
    run.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="solvers at a time (all cores)",
    )
    run.add_argument("--dry-run", action="store_true", help="list the cases, compute nothing")
    run.set_defaults(run=_run)

    assemble = what.add_parser(
        "assemble", parents=[common], help="make the data set and its tables from computed cases"
    )
    assemble.add_argument(
        "--work",
        type=Path,
        action="append",
        metavar="DIR",
        help="folder of 'models cfd run'; may be given several times",
    )
    assemble.add_argument(
        "--cases",
        type=Path,
        metavar="CSV",
        help="case table, completed by --work (default: the shipped one alone)",
    )
    assemble.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="where corner_cfd*.csv are written"
    )
    assemble.set_defaults(run=_assemble)


def _run(args: argparse.Namespace) -> Any:
    from models.cfd import campaign, config, foam, polars
    from models.common.progress import Bars

    if args.jobs < 1:
        raise ConfigError(f"--jobs {args.jobs}: must be at least 1")
    setup = config.load(args.fan)
    positions = campaign.plan(setup, args.model)
    if args.dry_run:
        if speaks(args):
            print("\n".join(p.key for p in positions))
        return {"cases": [p.key for p in positions]}
    foam.require()
    section = polars.neural_section(setup.rotor.section)
    bars = Bars(args.quiet)
    campaign.run(args.work, setup, section, positions, args.jobs, bars)
    bars.close()
    rows = campaign.rows(args.work, positions)
    count = {}
    for s in sorted({r.result.status for r in rows}):
        count[s] = sum(r.result.status == s for r in rows)
    if speaks(args):
        print(
            f"{len(rows)} of {len(positions)} cases: "
            + ", ".join(f"{n} {s}" for s, n in count.items())
        )
    return {"cases": len(positions), "done": len(rows), "status": count}


def _rows(args: argparse.Namespace, setup: Any) -> Any:
    from models.cfd import campaign, table
    from models.cfd.position import MODELS

    if args.work is None:
        return table.read(args.cases or SHIPPED_CASES)
    found = {}
    for row in table.read(args.cases) if args.cases else []:
        found[row.position] = row
    for folder in args.work:
        here = campaign.rows(folder, [p for model in MODELS for p in campaign.plan(setup, model)])
        if not here:
            raise ConfigError(
                f"--work {folder}: no finished cases of this fan; run 'models cfd run --work "
                f"{folder}'"
            )
        found |= {row.position: row for row in here}
    return list(found.values())


def _assemble(args: argparse.Namespace) -> Any:
    from models.cfd import assemble, config, table

    setup = config.load(args.fan)
    rows = _rows(args, setup)
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        if args.work is not None:
            # The set is made from the table as written, so that the table alone gives it again to the last digit.
            table.write(args.out / "corner_cfd_cases.csv", rows)
            rows = table.read(args.out / "corner_cfd_cases.csv")
        made = assemble.assemble(rows, setup)
        assemble.write_data(args.out / "corner_cfd.csv", made)
        assemble.write_marks(args.out / "corner_cfd_rows.csv", made)
    except OSError as error:
        raise ConfigError(f"--out {args.out}: cannot be written ({error.strerror})") from None
    solved = sum(mark.made != "law" for mark in made.marks)
    if speaks(args):
        print(
            f"{len(made.table)} rows written to {args.out / 'corner_cfd.csv'}: Fx, Fz, My of "
            f"{solved} from the solver, of {len(made.table) - solved} by the fitted law of rotor "
            "speed"
        )
    return {"rows": len(made.table), "solved": solved, "out": str(args.out)}
