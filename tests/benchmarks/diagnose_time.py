"""How long ``replay diagnose`` takes on every flight of the tables of ``measured/``, each in a process of its own.

    python tests/benchmarks/diagnose_time.py [--data DIR...] [--flight NAME...] [--json FILE] [--answers DIR]

Processor time of the whole command, start of Python included, beside the time on the wall, which a busy machine
stretches. Goal: 10 s. A flight is looked for in every DIR and left out where it is in none, or where its
declared model has to be trained first. ``--answers DIR`` keeps every answer; ``--against DIR`` compares them with those that another version kept there: every number that differs by
more than 1e-6 of itself is listed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from measured.answers import DATA
from measured.known import TABLE, Flight, read

GOAL_S = 10.0
SAME = 1e-6


@dataclass(frozen=True)
class Row:
    """One flight: size of the log, time that was judged, and what the command took."""

    flight: str
    mb: float
    judged_s: float
    cpu_s: float
    wall_s: float
    peak_mib: float
    exit: int


def measure(flight: Flight, data: Path, answer: Path) -> Row:
    """Diagnose one flight and look at what the process used."""
    log = data / flight.log
    declared = ["--vehicle", str(data / flight.vehicle), "--model", flight.model]
    arguments = [str(log), *declared, "--json", str(answer), "--quiet"]
    begun = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "replay", "diagnose", *arguments],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - begun
    code = process.returncode = os.waitstatus_to_exitcode(status)
    judged = json.loads(answer.read_text())["duration_s"] if code == 0 else 0.0
    cpu = used.ru_utime + used.ru_stime
    mb = log.stat().st_size / 1e6
    return Row(f"{flight.source}: {flight.name}", mb, judged, cpu, wall, used.ru_maxrss / 1024.0, code)


def differences(old: Any, new: Any, where: str = "") -> Iterator[str]:
    """Places in which two answers differ: numbers by more than ``SAME`` of themselves, all else at all."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() | new.keys()):
            yield from differences(old.get(key), new.get(key), f"{where}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from differences(a, b, f"{where}[{i}]")
    elif isinstance(old, float) and isinstance(new, float):
        if abs(old - new) > SAME * max(abs(old), abs(new)):
            yield f"{where}: {old!r} {new!r}"
    elif old != new:
        yield f"{where}: {old!r} {new!r}"


def main() -> int:
    """Measure every flight; the slowest first in the table."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--data", nargs="+", type=Path, default=[DATA], metavar="DIR", help=f"default: {DATA}")
    p.add_argument("--flight", nargs="*", default=[], metavar="NAME", help="only these flights (the log's name)")
    p.add_argument("--json", type=Path, metavar="FILE")
    p.add_argument("--answers", type=Path, metavar="DIR")
    p.add_argument("--against", type=Path, metavar="DIR")
    a = p.parse_args()
    rows, different = [], 0
    with tempfile.TemporaryDirectory() as scratch:
        answers = a.answers or Path(scratch)
        answers.mkdir(parents=True, exist_ok=True)
        for flight in (f for table in sorted(TABLE.parent.glob("*.toml")) for f in read(table).flights):
            data = next((d for d in a.data if not flight.missing(d)), None)
            if data is None or flight.table or (a.flight and Path(flight.log).stem not in a.flight):
                continue
            answer = answers / f"{flight.source}.{flight.name.replace(' ', '_')}.json"
            row = measure(flight, data, answer)
            rows.append(row)
            print(f"{row.cpu_s:7.1f} s of {row.flight}", file=sys.stderr)
            before = None if a.against is None else a.against / answer.name
            if row.exit == 0 and before is not None and before.is_file():
                places = list(differences(json.loads(before.read_text()), json.loads(answer.read_text())))
                different += bool(places)
                print(*(f"{row.flight}{place}" for place in places), sep="\n", end="\n" if places else "")
    rows.sort(key=lambda row: -row.cpu_s)
    print(f"{'CPU s':>7}{'wall s':>8}{'judged s':>10}{'MB':>7}{'MiB':>7}{'exit':>6}  flight")
    for r in rows:
        print(f"{r.cpu_s:7.1f}{r.wall_s:8.1f}{r.judged_s:10.1f}{r.mb:7.1f}{r.peak_mib:7.0f}{r.exit:6}  {r.flight}")
    slow = sum(r.cpu_s > GOAL_S for r in rows)
    print(f"{slow} of {len(rows)} take more than {GOAL_S:g} s of a processor")
    if a.against is not None:
        print(f"{different} answers differ")
    if a.json is not None:
        a.json.write_text(json.dumps([asdict(r) for r in rows], indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
