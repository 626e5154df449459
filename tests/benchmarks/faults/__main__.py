"""The fault campaign: ``python tests/benchmarks faults [NAME...]`` prints fault, noticed, output, recovery.

Everything is simulated, in lockstep: the same seed gives the same table on every machine. ``--json`` is written after
every flight, and ``--resume`` goes on from it. Exit code 1 where a promise was broken or a fault went otherwise than
expected.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import command_line
from result_file import add_option, counted, figure, write_result

from companion.adapt_options import Adapt
from faults.campaign import STACKS, Fault, Result, complaints
from faults.catalog import BY_NAME, FAULTS, fly_named
from models.common.progress import Bars

HEAD = (
    f"{'fault':28}{'stack':10}{'noticed s':>10}  {'by':22}{'thrust':>7}{'tilt °':>7}{'off m':>7}{'contact':>8}"
    f"{'back s':>7}{'outputs':>8}  complaints"
)
Job = tuple[str, str, int]


def row(r: Result) -> str:
    """One line of the table."""
    noticed = "-" if r.noticed_s is None else f"{r.noticed_s:.2f}"
    back = "-" if r.recovered_s is None else f"{r.recovered_s:.2f}"
    contact = f"{r.wall_s + r.ground_s:.2f}" if r.wall_s + r.ground_s > 0.01 else "-"
    return (
        f"{r.fault:28}{r.stack:10}{noticed:>10}  {r.why[:21]:22}{r.thrust:7.3f}{r.tilt_deg:7.2f}{r.off_m:7.2f}"
        f"{contact:>8}{back:>7}{r.outputs:8d}  {'; '.join(complaints(BY_NAME[r.fault], r))}"
    ).rstrip()


def markdown(results: Sequence[Result]) -> str:
    """The table as a document shows it: one line a fault, both stacks side by side."""
    by = {(r.fault, r.stack): r for r in results}
    lines = [
        "| fault | noticed after, s | worst output, % thrust / ° tilt | driven off, m | recovered after, s |",
        "|---|---|---|---|---|",
    ]
    for fault in FAULTS:
        both = [by.get((fault.name, stack)) for stack in STACKS]
        if not any(both):
            continue
        noticed, output, off, back = (
            " · ".join("" if r is None else show(r) for r in both)
            for show in (_noticed, _output, _off, _back)
        )
        lines.append(f"| {fault.what} | {noticed} | {output} | {off} | {back} |")
    return "\n".join(lines) + "\n"


def _noticed(r: Result) -> str:
    return "not" if r.noticed_s is None else f"{r.noticed_s:.2f}"


def _output(r: Result) -> str:
    return f"{100.0 * r.thrust:.1f} / {r.tilt_deg:.1f}"


def _off(r: Result) -> str:
    return f"{r.off_m:.2f}"


def _back(r: Result) -> str:
    if r.recovered_s is not None:
        return f"{r.recovered_s:.2f}"
    return "landed" if r.stack in BY_NAME[r.fault].lands else "by hand"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = command_line.parser(__doc__, prog="faults")
    p.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="faults to fly (default: all); a part of a name is enough",
    )
    p.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="exactly this fault; may be repeated",
    )
    p.add_argument(
        "--stack", choices=STACKS, action="append", help="one autopilot only (default: both)"
    )
    p.add_argument("--seed", type=int, default=1)
    p.add_argument(
        "--adapt", choices=[m.value for m in Adapt], default="full", help="as companion --adapt"
    )
    p.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    p.add_argument(
        "--json", type=Path, metavar="FILE", help="the results, written after every flight"
    )
    p.add_argument(
        "--resume", action="store_true", help="fly only what --json FILE does not hold yet"
    )
    p.add_argument(
        "--table",
        type=Path,
        metavar="FILE.md",
        help="the table in Markdown, both stacks side by side",
    )
    add_option(p)
    p.add_argument("--list", action="store_true", help="say what the faults are")
    return p


def chosen(a: argparse.Namespace) -> list[Fault]:
    """The faults that were asked for."""
    if not a.names and not a.only:
        return list(FAULTS)
    return [f for f in FAULTS if f.name in a.only or any(part in f.name for part in a.names)]


def flown_before(path: Path, seed: int, adapt: Adapt) -> dict[Job, Result]:
    """What an earlier run wrote, by job; nothing where there is none, or of another seed or ``--adapt``."""
    if not path.exists():
        return {}
    data = json.loads(path.read_text(encoding="utf-8"))
    names = Result.__dataclass_fields__
    flights = [Result(**{k: v for k, v in f.items() if k in names}) for f in data["flights"]]
    if (data["seed"], data.get("adapt", Adapt.OFF.value)) != (seed, adapt.value):
        return {}
    return {(r.fault, r.stack, seed): r for r in flights if r.fault in BY_NAME}


def write_json(path: Path, results: Sequence[Result], seed: int, adapt: Adapt) -> None:
    """Whole or not at all."""
    flights = [{**r.as_json(), "complaints": complaints(BY_NAME[r.fault], r)} for r in results]
    data = {
        "seed": seed,
        "adapt": adapt.value,
        "setpoints": sum(r.outputs for r in results),
        "flights": flights,
    }
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def fly_all(
    jobs: Sequence[Job], done: dict[Job, Result], a: argparse.Namespace
) -> dict[Job, Result]:
    """Every job that is not done; rows are printed as flights end."""
    left = [job for job in jobs if job not in done]
    bars = Bars()
    with ProcessPoolExecutor(a.workers, mp_context=get_context("spawn")) as pool:
        pending = {pool.submit(fly_named, job, Adapt(a.adapt)): job for job in left}
        for future in as_completed(pending):
            done[pending[future]] = future.result()
            bars.close()
            print(row(future.result()), flush=True)
            bars("faults", len(done), len(jobs))
            if a.json is not None:
                write_json(a.json, list(done.values()), a.seed, Adapt(a.adapt))
    bars.close()
    return done


def main() -> int:
    """Fly and print."""
    a = parser().parse_args()
    faults = chosen(a)
    if a.list or not faults:
        print("\n".join(f"{f.name:28}{f.what}" for f in faults or FAULTS))
        return 0 if a.list else 2
    stacks = a.stack or STACKS
    jobs = [(f.name, stack, a.seed) for f in faults for stack in stacks if stack in f.stacks]
    before = flown_before(a.json, a.seed, Adapt(a.adapt)) if a.resume and a.json is not None else {}
    print(f"simulated, in lockstep, seed {a.seed}\n{HEAD}", flush=True)
    done = fly_all(jobs, {job: r for job, r in before.items() if job in jobs}, a)
    results = [done[job] for job in jobs]
    outputs = sum(r.outputs for r in results)
    broken = [r for r in results if r.broken]
    odd = sum(bool(complaints(BY_NAME[r.fault], r)) for r in results)
    print(
        f"{len(results)} flights, {len({r.fault for r in results})} faults, {outputs} setpoints checked: "
        f"requirements broken in {len(broken)} flights, {odd} flights with complaints"
    )
    figures = [
        counted(
            "flights as they should be",
            (not complaints(BY_NAME[r.fault], r) for r in results),
            least=1.0,
        ),
        figure("setpoints checked", f"{outputs}"),
        figure("safety requirements broken", f"{len(broken)}", goal="0", met=not broken),
    ]
    write_result(
        a, figures, seeds=f"seed {a.seed}; {len(faults)} faults", simulated=True, repeatable=True
    )
    if a.table is not None:
        a.table.write_text(markdown(results), encoding="utf-8")
    return 1 if odd else 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
