"""How long ``replay diagnose`` takes, log by log, each in a process of its own.

    python tests/benchmarks speed.diagnose_time [LOG...] [--data DIR...] [--flight NAME...] [--answers DIR]

Without LOG: every flight of the tables of ``measured/``, with the vehicle file that belongs to it. With LOG (a file, or
a folder of logs): each by itself, its vehicle drafted, as a user without a vehicle file gets it.

Processor time of the whole command, start of Python included, beside the time on the wall, which a busy machine
stretches. An untimed diagnosis of one log of each format leaves compiled sources behind, as an installation does.
Goal: 10 s, median 2 s. A flight is looked for in every DIR and left out where it is in none, or where its declared
model has to be trained first. ``--answers DIR`` keeps every answer; ``--against DIR`` compares them with those
that another version kept there: every number that differs by more than 1e-6 of itself is listed, and names, verdicts
and sizes outside of the interval that the other version gave are counted.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import command_line
from measured.answers import DATA
from measured.known import TABLE, Flight, read

GOAL_S = 10.0
SAME = 1e-6
DIAGNOSE = (sys.executable, "-m", "replay", "diagnose")
LOGS = {".tlog", ".bin", ".ulg"}


@dataclass(frozen=True)
class Job:
    """One diagnosis: what it is called, where its answer is kept, the log, and what else the command is given."""

    name: str
    file: str
    log: Path
    options: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Row:
    """One diagnosis: size of the log, time that was judged, what the command took, and what it left out."""

    name: str
    mb: float
    judged_s: float
    cpu_s: float
    wall_s: float
    peak_mib: float
    exit: int
    left_out: tuple[str, ...] = ()


def flights(data: Sequence[Path], wanted: Sequence[str]) -> Iterator[Job]:
    """The flights of the tables that are there."""
    for table in sorted(TABLE.parent.glob("*.toml")):
        for flight in read(table).flights:
            job = _of_flight(flight, data)
            if job is not None and (not wanted or job.log.stem in wanted):
                yield job


def _of_flight(flight: Flight, data: Sequence[Path]) -> Job | None:
    folder = next((d for d in data if not flight.missing(d)), None)
    if folder is None or flight.table:
        return None
    vehicle = str(folder / flight.vehicle)
    return Job(
        name=f"{flight.source}: {flight.name}",
        file=f"{flight.source}.{flight.name.replace(' ', '_')}.json",
        log=folder / flight.log,
        options=("--vehicle", vehicle, "--model", flight.model),
    )


def drafted(paths: Sequence[Path]) -> Iterator[Job]:
    """The logs of some folders, and single logs."""
    for path in paths:
        inside = sorted(p for p in path.rglob("*") if p.suffix.lower() in LOGS)
        for log in inside if path.is_dir() else [path]:
            name = f"{log.parent.name}/{log.name}"
            yield Job(name=name, file=f"{name.replace('/', '.')}.json", log=log)


def installed(folder: Path) -> dict[str, str]:
    """The environment of a program whose sources are compiled once, here into ``folder``."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return environment | {"PYTHONPYCACHEPREFIX": str(folder)}


def measure(job: Job, answer: Path, environment: Mapping[str, str]) -> Row:
    """Diagnose one log and look at what the process used."""
    command = [*DIAGNOSE, str(job.log), *job.options, "--json", str(answer), "--quiet"]
    begun = time.perf_counter()
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    wall = time.perf_counter() - begun
    process.returncode = os.waitstatus_to_exitcode(status)
    content = json.loads(answer.read_text()) if process.returncode == 0 else {}
    return Row(
        name=job.name,
        mb=job.log.stat().st_size / 1e6,
        judged_s=content.get("duration_s", 0.0),
        cpu_s=used.ru_utime + used.ru_stime,
        wall_s=wall,
        peak_mib=used.ru_maxrss / 1024.0,
        exit=process.returncode,
        left_out=tuple(
            n for n in content.get("notes", ()) if n.startswith("left out of the search")
        ),
    )


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


def changed(old: Any, new: Any) -> Iterator[str]:
    """What a user would act on otherwise: names, the verdict, and sizes outside of the interval of before."""
    if old["verdict"] != new["verdict"]:
        yield f"verdict {old['verdict']} -> {new['verdict']}"
    before = {e["name"]: e for e in old["effects"]}
    after = {e["name"]: e for e in new["effects"]}
    if before.keys() != after.keys():
        yield f"effects {sorted(before)} -> {sorted(after)}"
    for name in sorted(before.keys() & after.keys()):
        for key, was in before[name]["parameters"].items():
            value = after[name]["parameters"][key]["value"]
            # Kinds are not estimated, and what is not determined has no value.
            if value is None or was["value"] is None or "ci95" not in was:
                continue
            low, high = was["ci95"]
            if not low - SAME <= value <= high + SAME:
                yield f"{name}.{key} {was['value']:.4g} ({low:.4g} to {high:.4g}) -> {value:.4g}"


def main() -> int:
    """Measure every log; the slowest first in the table."""
    p = command_line.parser(__doc__)
    p.add_argument("logs", nargs="*", type=Path, metavar="LOG")
    p.add_argument(
        "--data", nargs="+", type=Path, default=[DATA], metavar="DIR", help=f"default: {DATA}"
    )
    p.add_argument(
        "--flight",
        nargs="*",
        default=[],
        metavar="NAME",
        help="only these flights (the log's name)",
    )
    p.add_argument("--json", type=Path, metavar="FILE")
    p.add_argument("--answers", type=Path, metavar="DIR")
    p.add_argument("--against", type=Path, metavar="DIR")
    a = p.parse_args()
    jobs = list(drafted(a.logs) if a.logs else flights(a.data, a.flight))
    rows = []
    different = 0
    others = 0
    with tempfile.TemporaryDirectory() as scratch:
        environment = installed(Path(scratch) / "compiled")
        answers = a.answers or Path(scratch)
        answers.mkdir(parents=True, exist_ok=True)
        for job in {job.log.suffix: job for job in jobs}.values():
            measure(job, answers / job.file, environment)
        for job in jobs:
            answer = answers / job.file
            row = measure(job, answer, environment)
            rows.append(row)
            print(f"{row.cpu_s:7.1f} s of {row.name}", file=sys.stderr)
            before = None if a.against is None else a.against / job.file
            if before is None or not before.is_file() or row.exit:
                continue
            old = json.loads(before.read_text())
            new = json.loads(answer.read_text())
            places = list(differences(old, new))
            for place in places:
                print(f"{row.name}{place}")
            other = list(changed(old, new))
            for what in other:
                print(f"CHANGED {row.name}: {what}")
            different += bool(places)
            others += bool(other)
    rows.sort(key=lambda row: -row.cpu_s)
    print_table(rows)
    if a.against is not None:
        print(f"{different} answers differ, {others} of them in a name, the verdict or a size")
    if a.json is not None:
        a.json.write_text(json.dumps([asdict(r) for r in rows], indent=1) + "\n", encoding="utf-8")
    return 0


def print_table(rows: Sequence[Row]) -> None:
    """A line a log, and how many take too long."""
    print(f"{'CPU s':>7}{'wall s':>8}{'judged s':>10}{'MB':>7}{'MiB':>7}{'exit':>6}  log")
    for r in rows:
        numbers = (
            f"{r.cpu_s:7.1f}{r.wall_s:8.1f}{r.judged_s:10.1f}{r.mb:7.1f}{r.peak_mib:7.0f}{r.exit:6}"
        )
        print(f"{numbers}  {r.name}{'  left out: ' if r.left_out else ''}{'; '.join(r.left_out)}")
    if rows:
        slow = sum(r.cpu_s > GOAL_S for r in rows)
        median = statistics.median(r.cpu_s for r in rows)
        print(
            f"{slow} of {len(rows)} take more than {GOAL_S:g} s of a processor; median {median:.1f} s"
        )


if __name__ == "__main__":
    raise SystemExit(main())
