"""The guide followed word by word in an empty environment: what fails, and how long it takes to the first plot.

    python tests/benchmarks documents.guide_fresh [--guide docs/guide.md]

Copies the tracked files and runs every line of the guide's ``sh`` blocks in order, the installation in the copy, all
others in an empty folder, except those marked "on the vehicle". What a reader would have
by then (a log of a hover, of a flight, a folder of logs, a fan's data) is written by the tests' own simulation.
Needs a package index.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import command_line
from result_file import add_option, figure, write_result

ROOT = Path(__file__).resolve().parents[3]
WRITE = """
import sys; sys.path[:0] = [{lib!r}, {root!r}]
from pathlib import Path
from log_writers import quad_flight, write_data_set, write_tlog
from models.corner_law import ClosedForm
here = Path("."); (here / "logs").mkdir()
write_tlog(here / "hover.tlog", quad_flight(60.0))
write_tlog(here / "flight.tlog", quad_flight(40.0, mass_kg=3.4, seed=2))
write_tlog(here / "logs" / "monday.tlog", quad_flight(25.0, seed=3))
write_data_set(here / "fan.csv", ClosedForm().data_set())
"""


def blocks(document: Path) -> list[str]:
    """Every line of the ``sh`` blocks."""
    found = re.findall(r"```sh\n(.*?)```", document.read_text(encoding="utf-8"), re.S)
    return [
        line.strip()
        for block in found
        for line in block.replace("\\\n", " ").splitlines()
        if line.strip()
    ]


def main() -> int:
    """Run and print one line a command."""
    p = command_line.parser(__doc__)
    p.add_argument(
        "--guide", type=Path, default=ROOT / "docs" / "guide.md", help="another document"
    )
    add_option(p)
    a = p.parse_args()
    with tempfile.TemporaryDirectory(prefix="fresh") as made:
        copy = Path(made) / "checkout"
        here = Path(made) / "empty"
        copy.mkdir()
        here.mkdir()
        files = subprocess.run(
            ["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True
        ).stdout
        subprocess.run(["tar", "x"], cwd=copy, input=files, check=True)
        start = time.perf_counter()
        script = WRITE.format(lib=str(copy / "tests" / "lib"), root=str(copy))
        subprocess.run([sys.executable, "-c", script], cwd=here, check=True)
        environment = {**os.environ, "PATH": f"{copy / '.venv' / 'bin'}:{os.environ['PATH']}"}
        environment.pop("PYTHONPATH", None)
        failed = 0
        plotted = None
        for line in blocks(a.guide):
            if "# on the vehicle" in line:
                continue
            began = time.perf_counter()
            place = copy if "pip install" in line else here
            done = subprocess.run(
                line, shell=True, cwd=place, env=environment, capture_output=True, text=True
            )
            wall = time.perf_counter() - began
            failed += done.returncode != 0
            print(f"{done.returncode:3d} {wall:6.1f} s  {line}", flush=True)
            if done.returncode:
                print(f"      {done.stderr.strip()[-300:]}", flush=True)
            if plotted is None and list(here.rglob("report.html")):
                plotted = time.perf_counter() - start
                print(f"first plot after {plotted:.0f} s", flush=True)
        print(f"{failed} commands failed")
    if plotted is not None:
        write_result(
            a,
            [figure("from an empty environment to the first plot [s]", f"{plotted:.0f}")],
            seeds="none",
        )
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
