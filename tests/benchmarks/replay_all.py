"""``replay run`` on every recorded flight in a folder: exit code, seconds, how much faster than the flight.

    python tests/benchmarks/replay_all.py FOLDER [--vehicle FILE.toml]

A vehicle file NAME.toml beside NAME.tlog is used where there is one.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import time
from pathlib import Path

from replay.cli import main as replay
from replay.logs.formats import READERS


def main() -> int:
    """Run all, print a row each, return how many failed."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=Path)
    p.add_argument("--vehicle", type=Path)
    a = p.parse_args()
    failed = 0
    print(f"{'log':<52}{'rc':>3}{'samples':>9}{'decisions':>10}{'comp %':>8}{'s':>8}{'x real time':>12}")
    for path in sorted(q for q in a.folder.rglob("*") if q.suffix.lower() in READERS):
        beside = path.with_suffix(".toml")
        vehicle = beside if beside.exists() else a.vehicle
        arguments = ["run", str(path), "--json", "-", "--param", "GUID_OPTIONS=8"]
        arguments += ["--vehicle", str(vehicle)] if vehicle is not None else []
        out = io.StringIO()
        start = time.perf_counter()
        with contextlib.redirect_stdout(out):
            code = replay(arguments)
        seconds = time.perf_counter() - start
        failed += code != 0
        if code:
            print(f"{path.name:<52}{code:>3}")
            continue
        r = json.loads(out.getvalue())
        share, speed = 100.0 * r["share_compensated"], r["duration_s"] / seconds
        print(
            f"{path.name:<52}{code:>3}{r['samples']:>9}{r['decisions']:>10}{share:>8.1f}{seconds:>8.1f}{speed:>12.1f}"
        )
    return failed


if __name__ == "__main__":
    raise SystemExit(main())
