"""Fly a round of simulated flights and see whether ``replay diagnose`` names what was undeclared.

``python tests/benchmarks diagnosis.diagnose_suite [--round N] [--only NAME...] [--json FILE]``. Seeded; flights are
written to a cache folder outside the repository (or ``--keep DIR``), once; the declared model is trained once.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import command_line
from flights.make import make_round
from flights.scenarios import HELD_OUT_ROUND, scenarios
from result_file import counted, write_result
from shares import share

from diagnosis.declared import train
from diagnosis.flights_judge import Judgement, judge
from diagnosis.one_answer import add_options, diagnose, write_rows

GROUPS = ("null", "single", "pair", "unlisted", "bad")
GOAL_SIZE = 0.02
"""Share of the weight from which on an effect is to be named."""


@dataclass(frozen=True)
class Row:
    """One flight's result."""

    name: str
    group: str
    seconds: float
    judgement: Judgement
    size_of_weight: float
    """Of what is undeclared: 95th percentile of its force, or of its moment over the fans' arm."""


def main() -> int:
    args = _parser().parse_args()
    rows: list[Row] = []
    for number in args.round:
        folder = (args.keep or Path(tempfile.gettempdir()) / "diagnose-suite") / f"round{number}"
        names = {s.name for s in scenarios(number)}
        wanted = [n for n in args.only if n in names] if args.only else []
        truth = make_round(folder, number, wanted, progress=args.verbose)
        if args.group:
            truth = {n: t for n, t in truth.items() if t["group"] in args.group}
        model = train(folder / "table.csv", args.method, folder.parent)
        tag = "" if args.round == [number] else f"{number}/"
        with ThreadPoolExecutor(args.jobs) as pool:
            futures = [
                pool.submit(run_one, folder, model, name, t, args.timeout)
                for name, t in truth.items()
            ]
            for future in futures:
                row = future.result()
                rows.append(replace(row, name=tag + row.name))
                print(line(rows[-1]), flush=True)
    print()
    print(summary(rows, held_out=any(n >= HELD_OUT_ROUND for n in args.round)))
    by = by_group(rows)
    effects = by["single"] + by["pair"]
    figures = [
        counted("named right", (j.right for j in effects), least=0.95),
        counted("a wrong name", (bool(j.wrong_names) for j in effects), most=0.03),
        counted(
            "false alarms on flights that lack nothing", (not j.right for j in by["null"]), most=0.0
        ),
        counted("forces outside the catalogue, right", (j.right for j in by["unlisted"])),
        counted("bad input, right", (j.right for j in by["bad"])),
    ]
    write_result(args, figures, seeds=f"round {', '.join(map(str, args.round))}", simulated=True)
    write_rows(args.json, rows)
    return 0


def _parser() -> argparse.ArgumentParser:
    p = command_line.parser(__doc__)
    p.add_argument(
        "--round",
        type=int,
        nargs="+",
        default=[1],
        help=f"sets of seeds; from {HELD_OUT_ROUND} on: held out",
    )
    p.add_argument("--only", nargs="*", default=[], metavar="NAME", help="only these flights")
    p.add_argument(
        "--group", nargs="*", default=[], help="only null, single, pair, unlisted or bad flights"
    )
    p.add_argument("--verbose", action="store_true", help="say which flights are being written")
    add_options(p, timeout_s=180.0)
    return p


def run_one(folder: Path, model: Path, name: str, truth: dict[str, Any], timeout: float) -> Row:
    """``replay diagnose`` on one flight, judged."""
    declared = model if truth["model"] == "table" else None
    asked = diagnose(folder / name, declared, folder / f"{name}.answer.json", timeout)
    verdict = judge(name, truth, asked.answer, asked.exit_code)
    if asked.answer is None:
        crashed = "Traceback" in asked.complaint
        verdict = replace(
            verdict,
            right=verdict.right and not crashed,
            exact=verdict.exact and not crashed,
            note=f"{verdict.note}: {asked.last_words or 'silent'}",
        )
    return Row(name, truth["group"], asked.seconds, verdict, truth["size_of_weight"])


def line(row: Row) -> str:
    """One line of the table."""
    j = row.judgement
    mark = "ok " if j.exact else "ok~" if j.right else "BAD"
    return f"{mark} {row.name:28s} {row.seconds:5.1f} s  rms/oracle {j.rms_ratio:5.2f}  {j.note}"


def by_group(rows: list[Row]) -> dict[str, list[Judgement]]:
    """Judgements of every group."""
    out: dict[str, list[Judgement]] = {group: [] for group in GROUPS}
    for row in rows:
        out[row.group].append(row.judgement)
    return out


def summary(rows: list[Row], *, held_out: bool) -> str:
    """The figures, with Wilson 95 % intervals."""
    by = by_group(rows)
    effects = by["single"] + by["pair"]
    visible = [
        r.judgement for r in rows if r.group in ("single", "pair") and r.size_of_weight >= GOAL_SIZE
    ]
    ratios = [j.rms_ratio for j in effects if j.right and math.isfinite(j.rms_ratio)]
    blank = [j.rms_ratio for j in by["null"] if math.isfinite(j.rms_ratio)]
    times = [r.seconds for r in rows]
    lines = [
        f"{len(rows)} simulated flights, {'held-out' if held_out else 'open'} seeds",
        f"named right (all effects, nothing else)   {share(j.right for j in effects)}",
        f"  of these without an alias entry         {share(j.exact for j in effects)}",
        f"  of {GOAL_SIZE:.0%} of the weight or more             {share(j.right for j in visible)}",
        f"  single effects                          {share(j.right for j in by['single'])}",
        f"  pairs                                   {share(j.right for j in by['pair'])}",
        f"flights with a wrong name                 {share(bool(j.wrong_names) for j in effects)}",
        f"flights with a missed effect              {share(bool(j.missed) for j in effects)}",
        f"false alarms on nulls                     {share(not j.right for j in by['null'])}",
        f"outside every catalogue, answered right   {share(j.right for j in by['unlisted'])}",
        f"  given a wrong name                      {share(bool(j.wrong_names) for j in by['unlisted'])}",
        f"bad input answered right                  {share(j.right for j in by['bad'])}",
        f"RMS after <= 1.1 x oracle, where right    {share(r <= 1.1 for r in ratios)}",
    ]
    if ratios:
        lines.append(f"  median ratio {statistics.median(ratios):.3f}, worst {max(ratios):.2f}")
    if blank:
        lines.append(
            f"  the same ratio on nulls (should be 1): median {statistics.median(blank):.3f}"
        )
    if times:
        lines.append(
            f"run time: median {statistics.median(times):.1f} s, longest {max(times):.1f} s"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
