"""How fast a .tlog is read: columnar decode against pymavlink's ``recv_match`` on the same file in the same run.

    python tests/benchmarks speed.tlog_speed [FILE.tlog] [--json FILE]

Without a file: some 200 000 synthetic frames (10 minutes of flight). Prints frames per second, the ratio (goal >= 40)
and the peak memory of our reader as a multiple of the file (goal <= 8; in a process of its own, what the imports need
taken off; Linux only).
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import command_line
from log_writers import flight, write_tlog
from result_file import add_option, figure, write_result

GOAL_RATIO = 40.0
GOAL_MEMORY = 8.0
FRAMES = 200_000


def ours(path: Path) -> int:
    """Walk, CRC of every frame, stamps, and all known messages into SI columns."""
    from companion.mavlink.message_table import LAYOUTS, columns
    from replay.logs.tlog import read_tlog

    log = read_tlog(path)
    for number, layout in LAYOUTS.items():
        index = log.indices(number)
        if index.size:
            columns(layout, log.records(number, index))
    return len(log)


def flightlog(path: Path) -> int:
    """All of the above onto the boot axis, as FlightLogs."""
    from replay.logs.formats import load

    return sum(log.summary.frames for log in load(path))


def theirs(path: Path) -> int:
    """The baseline: every message through recv_match."""
    from pymavlink import mavutil

    reader = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    count = 0
    while reader.recv_match() is not None:
        count += 1
    return count


def best_of(work: Callable[[Path], int], path: Path, times: int = 3) -> tuple[int, float]:
    """(frames, fewest seconds of this process's own CPU time: on a shared machine a wall clock measures the others)."""
    seconds = []
    for _ in range(times):
        start = time.process_time()
        count = work(path)
        seconds.append(time.process_time() - start)
    return count, min(seconds)


def peak_memory(path: Path) -> float:
    """Peak resident memory that reading adds, over the size of the file."""
    code = (
        "import sys; sys.path[:0] = sys.argv[2:]\n"
        "from pathlib import Path; from speed import tlog_speed; import numpy\n"
        "import companion.mavlink.message_table, replay.logs.tlog\n"
        "def peak(): return int(Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0]) * 1024\n"
        "before = peak(); tlog_speed.ours(Path(sys.argv[1])); print(peak() - before)"
    )
    # The folders of benchmarks, of what they share with tests, and of the project.
    _, benchmarks, tests, project = Path(__file__).resolve().parents[:4]
    done = subprocess.run(
        [sys.executable, "-c", code, str(path), str(benchmarks), str(tests / "lib"), str(project)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return float(done.stdout) / path.stat().st_size


def synthetic(path: Path) -> None:
    """A flight of FRAMES frames by the writer of the tests."""
    messages = flight(FRAMES / 325.0)
    write_tlog(path, messages)


def measure(path: Path) -> dict[str, float]:
    """All figures for one file."""
    frames, fast = best_of(ours, path)
    columns, with_columns = best_of(flightlog, path)
    count, slow = best_of(theirs, path, 2)
    return {
        "frames": frames,
        "megabytes": path.stat().st_size / 1e6,
        "ours_per_s": frames / fast,
        "flightlog_per_s": columns / with_columns,
        "pymavlink_per_s": count / slow,
        "ratio": slow / fast,
        "ratio_flightlog": slow / with_columns,
        "memory_of_file": peak_memory(path),
    }


def main() -> int:
    """Measure and print."""
    p = command_line.parser(__doc__)
    p.add_argument("log", nargs="?", type=Path)
    p.add_argument("--json", type=Path)
    add_option(p)
    a = p.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = a.log
        if path is None:
            path = Path(folder) / "synthetic.tlog"
            synthetic(path)
        figures = measure(path)
    print(f"{figures['frames']:.0f} frames, {figures['megabytes']:.1f} MB, best of 3")
    print(f"{'way':<44}{'frames/s':>12}{'x pymavlink':>14}")
    print(f"{'pymavlink recv_match':<44}{figures['pymavlink_per_s']:>12,.0f}{1.0:>14.1f}")
    print(
        f"{'CRC, stamps, all columns (replay.tlog)':<44}{figures['ours_per_s']:>12,.0f}{figures['ratio']:>14.1f}"
    )
    print(
        f"{'FlightLog on the boot axis':<44}{figures['flightlog_per_s']:>12,.0f}{figures['ratio_flightlog']:>14.1f}"
    )
    print(f"peak memory: {figures['memory_of_file']:.1f} x file size")
    if a.json is not None:
        a.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    ratio = figures["ratio"]
    decoded = figure("tlog decoded, over recv_match in the same run", f"{ratio:.0f} ×", goal=f"{GOAL_RATIO:g} ×",
                     met=ratio >= GOAL_RATIO)  # fmt: skip
    write_result(a, [decoded], seeds="none")
    return 0 if ratio >= GOAL_RATIO and figures["memory_of_file"] <= GOAL_MEMORY else 1


if __name__ == "__main__":
    raise SystemExit(main())
