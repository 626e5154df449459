"""How long ``replay diagnose`` takes, and how much memory, as flights grow: 3, 15 and 60 minutes, simulated.

``python tests/benchmarks speed.diagnose_length [--minutes 3 15 60] [--profile FILE]``. One flight of the shipped
quadrotor is written at each length with a payload undeclared (``quad_flight``, 25 Hz), and each is diagnosed in a
process of its own. Processor time is given beside the time on the wall, which a busy machine stretches.
"""

from __future__ import annotations

import cProfile
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import command_line
from log_writers import quad_flight, write_tlog

from companion.vehicles import QUAD


@dataclass(frozen=True)
class Row:
    """One length. ``wall_s`` and ``cpu_s`` of the whole command, peak memory, and the answer's verdict."""

    minutes: float
    file_mib: float
    wall_s: float
    cpu_s: float
    peak_mib: float
    verdict: str


def command(log: Path, answer: Path) -> list[str]:
    """The diagnosis as a user starts it."""
    arguments = [
        str(log),
        "--vehicle",
        str(QUAD),
        "--model",
        "none",
        "--json",
        str(answer),
        "--quiet",
    ]
    return [sys.executable, "-m", "replay", "diagnose", *arguments]


def measure(log: Path, minutes: float, answer: Path) -> Row:
    """Run it once and look at what the process used."""
    begun = time.perf_counter()
    process = subprocess.Popen(command(log, answer), env={**os.environ, "OMP_NUM_THREADS": "1"})
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - begun
    if status:
        raise SystemExit(
            f"{log.name}: the diagnosis ended with {os.waitstatus_to_exitcode(status)}"
        )
    return Row(
        minutes,
        log.stat().st_size / 2**20,
        wall,
        used.ru_utime + used.ru_stime,
        used.ru_maxrss / 1024,
        json.loads(answer.read_text())["verdict"],
    )


def main() -> int:
    """Write, diagnose, print."""
    p = command_line.parser(__doc__)
    p.add_argument("--minutes", type=float, nargs="+", default=[3.0, 15.0, 60.0])
    p.add_argument(
        "--mass", type=float, default=3.3, help="true mass [kg]; the vehicle file says 3.0"
    )
    p.add_argument(
        "--profile",
        type=Path,
        metavar="FILE",
        help="profile the longest in this process instead (pstats)",
    )
    p.add_argument(
        "--keep", type=Path, metavar="DIR", help="keep the logs here (default: a temporary folder)"
    )
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    a = p.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = a.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for minutes in sorted(a.minutes):
            log = folder / f"{minutes:g}min.tlog"
            if not log.exists():
                write_tlog(log, quad_flight(60.0 * minutes, mass_kg=a.mass))
            if a.profile is None:
                rows.append(measure(log, minutes, folder / "answer.json"))
                print(line(rows[-1], rows[0]), file=sys.stderr, flush=True)
        if a.profile is not None:
            from replay.cli import main as replay

            profile = cProfile.Profile()
            profile.runcall(replay, command(log, folder / "answer.json")[3:])
            profile.dump_stats(a.profile)
    if a.json is not None:
        text = json.dumps([asdict(r) for r in rows], indent=1)
        print(text) if a.json == "-" else Path(a.json).write_text(text + "\n", encoding="utf-8")
    return 0


def line(row: Row, first: Row) -> str:
    """One length, and its cost per minute of flight over that of the shortest."""
    ratio = (row.cpu_s / row.minutes) / (first.cpu_s / first.minutes)
    return (
        f"{row.minutes:5.0f} min  {row.file_mib:6.1f} MiB  wall {row.wall_s:6.1f} s  processor {row.cpu_s:6.1f} s  "
        f"peak {row.peak_mib:5.0f} MiB  per minute of flight x {ratio:.2f}  {row.verdict}"
    )


if __name__ == "__main__":
    sys.exit(main())
