"""Fly seeds of the second simulator (``tests/simulators/independent/``) and see what ``replay diagnose`` makes of them.

``python tests/benchmarks diagnosis.diagnose_independent --seed 1 2 [--only TEXT...] [--jobs N] [--json FILE]``. Flights
go to a cache folder (or ``--keep DIR``), once. Seeds from 100 on are held out. Everything is simulated.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import command_line
from independent.cases import HELD_OUT, Case
from independent.make import make, read_truth, stem
from result_file import counted, write_result
from shares import share

from diagnosis.declared import train
from diagnosis.independent_judge import NEEDED, Judgement, judge, needed_of
from diagnosis.one_answer import Asked, add_options, diagnose, write_rows


@dataclass(frozen=True)
class Row:
    """One flight's result."""

    seed: int
    name: str
    group: str
    seconds: float
    needed: tuple[str, ...]
    judgement: Judgement


def main() -> int:
    args = _parser().parse_args()
    folder = args.keep or Path(tempfile.gettempdir()) / "diagnose-independent"
    flown = make(
        folder, args.seed, args.only, lambda text: print(text, file=sys.stderr, flush=True)
    )
    model = None
    if any(c.frame.table for c in flown):
        model = train(folder / "guarded.csv", args.method, folder)
    rows: list[Row] = []
    with ThreadPoolExecutor(args.jobs) as pool:
        for row in pool.map(lambda case: run_one(folder, case, model, args), flown):
            rows.append(row)
            print(line(row), flush=True)
    print()
    print(summary(rows))
    every = [r.judgement for r in rows]
    needed = needed_named(rows)
    figures = [
        counted("right", (j.right for j in every), least=0.95),
        counted("needed effects named", needed, least=0.95),
        counted("a wrong name", (bool(j.wrong) for j in every), most=0.03),
        counted("too sure", (j.overclaimed for j in every)),
    ]
    write_result(args, figures, seeds=f"seed {', '.join(map(str, args.seed))}", simulated=True)
    write_rows(args.json, rows)
    return 0


def _parser() -> argparse.ArgumentParser:
    p = command_line.parser(__doc__)
    p.add_argument(
        "--seed",
        type=int,
        nargs="+",
        default=[1],
        help=f"which sets of flights; from {HELD_OUT} on: held out",
    )
    p.add_argument(
        "--only", nargs="*", default=[], metavar="TEXT", help="only flights whose name contains it"
    )
    p.add_argument(
        "--judge",
        action="store_true",
        help="judge answers that are there instead of diagnosing again",
    )
    add_options(p, timeout_s=300.0)
    return p


def run_one(folder: Path, case: Case, model: Path | None, args: argparse.Namespace) -> Row:
    """``replay diagnose`` on one flight, judged."""
    base = stem(folder, case)
    truth = read_truth(folder, case)
    out = base.with_name(case.name + ".answer.json")
    declared = model if truth["model"] == "table" else None
    if args.judge and out.exists():
        asked = Asked(json.loads(out.read_text()))
    else:
        asked = diagnose(base, declared, out, args.timeout)
    strange = {n for n, s in truth["sizes"].items() if s >= NEEDED and n.startswith("x_")}
    needed = tuple(sorted(needed_of(truth) | strange))
    return Row(
        seed=case.seed,
        name=case.name,
        group=case.group,
        seconds=asked.seconds,
        needed=needed,
        judgement=judge(truth, asked.answer, asked.last_words),
    )


def line(row: Row) -> str:
    """One line of the table."""
    j = row.judgement
    mark = "ok " if j.exact else "ok~" if j.right else "BAD"
    why = []
    if j.wrong:
        why.append(f"wrong {', '.join(j.wrong)}")
    if j.missed:
        why.append(f"missed {', '.join(j.missed)}")
    if j.overclaimed:
        why.append("overclaimed")
    text = (
        f"{mark} {row.seed}/{row.name:36s} needed {', '.join(row.needed) or 'nothing'} | {j.note}"
    )
    return f"{text} | {'; '.join(why)}" if why else text


def needed_named(rows: list[Row]) -> list[bool]:
    """Whether each needed effect of the catalogue was named."""
    out = []
    for row in rows:
        out += [name in row.judgement.named for name in row.needed if not name.startswith("x_")]
    return out


def summary(rows: list[Row]) -> str:
    """The figures, with Wilson 95 % intervals."""
    by = {
        g: [r.judgement for r in rows if r.group == g]
        for g in ("null", "single", "pair", "unknown")
    }
    every = [r.judgement for r in rows]
    held_out = any(r.seed >= HELD_OUT for r in rows)
    needed = needed_named(rows)
    lines = [
        f"{len(rows)} simulated flights (second simulator), {'held-out' if held_out else 'open'} seeds",
        f"flights answered right                    {share(j.right for j in every)}",
        f"  of these without an alias entry         {share(j.exact for j in every)}",
        f"  one effect made large                   {share(j.right for j in by['single'])}",
        f"  pairs                                   {share(j.right for j in by['pair'])}",
        f"  in no catalogue                         {share(j.right for j in by['unknown'])}",
        f"  nulls                                   {share(j.right for j in by['null'])}",
        f"nulls silent (no name at all)             {share(j.silent for j in by['null'])}",
        f"needed effects named                      {share(needed)}",
        f"flights with a wrong name                 {share(bool(j.wrong) for j in every)}",
        f"flights with a missed effect              {share(bool(j.missed) for j in every)}",
        f"flights overclaimed                       {share(j.overclaimed for j in every)}",
    ]
    times = sorted(r.seconds for r in rows)
    return "\n".join(
        [*lines, f"run time: median {times[len(times) // 2]:.1f} s, longest {times[-1]:.1f} s"]
    )


if __name__ == "__main__":
    sys.exit(main())
