"""A folder of logs by one process and by several: the time, and how well the processes share the work.

    python tests/benchmarks/folder_speed.py --logs 200 --workers 2 [--command diagnose] [--folder LOGS]

Without ``--folder`` it writes simulated hovers of 40 s. Pieces of the folder alternate between one process and several,
so that a machine that does other work disturbs both alike. Beside every piece, plain arithmetic is timed with as many
processes: ``machine`` is the speed-up that the machine gave to work that shares nothing, ``logs`` that of the folder.
Efficiency = speed-up / workers; ``of the machine`` = logs / machine.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import tempfile
import time
from pathlib import Path

from log_writers import quad_flight, write_tlog

from replay.fleet.jobs import Job
from replay.fleet.scheduler import run_local

ROOT = Path(__file__).resolve().parents[2]
ARITHMETIC = 6_000_000
"""Additions of one process: about half a second."""


def arithmetic(_: int) -> int:
    """Work that needs no memory, no file and no other process."""
    return sum(range(ARITHMETIC)) + sum(i & 3 for i in range(ARITHMETIC))


def machine_s(workers: int, pieces: int = 4) -> float:
    """Seconds for a fixed number of pieces of arithmetic by ``workers`` processes."""
    with mp.get_context("fork").Pool(workers) as pool:
        start = time.perf_counter()
        pool.map(arithmetic, range(pieces), chunksize=1)
        return time.perf_counter() - start


def folder_s(jobs: list[Job], workers: int) -> tuple[float, int]:
    """Seconds and failed logs of one piece."""
    start = time.perf_counter()
    answers = [answer for _, answer in run_local(jobs, workers)]
    return time.perf_counter() - start, sum("error" in a for a in answers)


def write_logs(folder: Path, count: int) -> None:
    """Simulated hovers of the shipped quadrotor, some of them heavier than declared."""
    for k in range(count):
        write_tlog(folder / f"log{k:03d}.tlog", quad_flight(40.0, mass_kg=3.0 + 0.1 * (k % 4), seed=k))


def main() -> int:
    """Run and print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--folder", type=Path, help="logs to use (default: simulated ones)")
    p.add_argument("--logs", type=int, default=200)
    p.add_argument("--workers", type=int, default=2)
    p.add_argument("--pieces", type=int, default=5)
    p.add_argument("--command", choices=("run", "diagnose"), default="diagnose")
    p.add_argument("--json", type=Path)
    a = p.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = a.folder or Path(made)
        if a.folder is None:
            write_logs(folder, a.logs)
        paths = sorted(folder.glob("*.tlog"))[: a.logs]
        vehicle = str(ROOT / "companion" / "vehicles" / "quad.toml")
        jobs = [Job(a.command, str(path), vehicle, "none") for path in paths]
        size = -(-len(jobs) // a.pieces)
        out = []
        folder_s(jobs[:1], 1)  # the server of processes starts once
        print(f"{len(jobs)} logs, {a.command}; per piece: logs with 1 and {a.workers} processes, machine likewise [s]")
        for k in range(a.pieces):
            piece = jobs[k * size : (k + 1) * size]
            order = (1, a.workers) if k % 2 == 0 else (a.workers, 1)
            logs = {w: folder_s(piece, w) for w in order}
            machine = {w: machine_s(w) for w in order}
            out.append((logs[1][0], logs[a.workers][0], machine[1], machine[a.workers], logs[1][1]))
            print(
                f"  {len(piece)} logs: {out[-1][0]:.1f} {out[-1][1]:.1f}; {out[-1][2]:.2f} {out[-1][3]:.2f}", flush=True
            )
        one, many, m_one, m_many, bad = (sum(column) for column in zip(*out, strict=True))
        logs_up, machine_up = one / many, m_one / m_many
        answer = {
            "logs": len(jobs), "command": a.command, "workers": a.workers, "failed": bad,
            "s_one": round(one, 1), "s_many": round(many, 1), "logs_per_minute": round(60.0 * len(jobs) / many, 1),
            "speed_up_logs": round(logs_up, 2), "speed_up_machine": round(machine_up, 2),
            "efficiency": round(logs_up / a.workers, 2), "efficiency_of_the_machine": round(logs_up / machine_up, 2),
        }  # fmt: skip
        print(json.dumps(answer, indent=1))
        if a.json:
            a.json.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
