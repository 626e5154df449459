"""The fault campaign: ``python -m faults [NAME...]`` in tests/benchmarks prints fault, noticed, output, recovery.

Everything is simulated, in lockstep: the same seed gives the same table on every machine. Exit code 1 where a promise
was broken or a fault did not go as expected (--strict).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from faults.campaign import Result, complaints
from faults.catalog import BY_NAME, FAULTS, fly_named
from models.progress import Bars

HEAD = (
    f"{'fault':28}{'stack':10}{'noticed s':>10}  {'by':22}{'thrust':>7}{'tilt °':>7}{'off m':>7}{'contact':>8}"
    f"{'back s':>7}{'outputs':>8}  complaints"
)


def row(r: Result) -> str:
    """One line of the table."""
    noticed = "-" if r.noticed_s is None else f"{r.noticed_s:.2f}"
    back = "-" if r.recovered_s is None else f"{r.recovered_s:.2f}"
    contact = f"{r.contact_s:.2f}" if r.contact_s > 0.01 else "-"
    return (
        f"{r.fault:28}{r.stack:10}{noticed:>10}  {r.why[:21]:22}{r.thrust:7.3f}{r.tilt_deg:7.2f}{r.off_m:7.2f}"
        f"{contact:>8}{back:>7}{r.outputs:8d}  {'; '.join(complaints(BY_NAME[r.fault], r))}"
    ).rstrip()


def main() -> int:
    """Fly and print."""
    p = argparse.ArgumentParser(
        prog="faults", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("names", nargs="*", metavar="NAME", help="faults to fly (default: all); a part of a name is enough")
    p.add_argument("--stack", choices=("ardupilot", "px4"), action="append", help="one manner only (default: both)")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    p.add_argument("--json", type=Path, metavar="FILE")
    p.add_argument("--list", action="store_true", help="say what the faults are")
    a = p.parse_args()
    chosen = [f for f in FAULTS if not a.names or any(part in f.name for part in a.names)]
    if a.list or not chosen:
        print("\n".join(f"{f.name:28}{f.what}" for f in chosen or FAULTS))
        return 0 if a.list else 2
    stacks = a.stack or ["ardupilot", "px4"]
    jobs = [(f.name, stack, a.seed) for f in chosen for stack in stacks if stack in f.stacks]
    print(f"simulated, in lockstep, seed {a.seed}\n{HEAD}", flush=True)
    results: list[Result] = []
    bars = Bars()
    with ProcessPoolExecutor(a.workers, mp_context=get_context("spawn")) as pool:
        for result in pool.map(fly_named, jobs):
            results.append(result)
            bars.close()
            print(row(result), flush=True)
            bars("faults", len(results), len(jobs))
    bars.close()
    outputs, broken = sum(r.outputs for r in results), [r for r in results if r.broken]
    odd = sum(bool(complaints(BY_NAME[r.fault], r)) for r in results)
    print(
        f"{len(results)} flights, {len({r.fault for r in results})} faults, {outputs} setpoints checked: "
        f"promises broken in {len(broken)} flights, {odd} flights with complaints"
    )
    if a.json is not None:
        flights = [{**r.as_json(), "complaints": complaints(BY_NAME[r.fault], r)} for r in results]
        a.json.write_text(json.dumps({"seed": a.seed, "setpoints": outputs, "flights": flights}, indent=1) + "\n")
    return 1 if odd else 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
