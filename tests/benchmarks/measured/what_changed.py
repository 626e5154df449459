"""Does ``replay diagnose TODAY --since GOOD...`` name what changed, and nothing where nothing did? Real flights.

``python tests/benchmarks measured.what_changed [--data ../shared/data] [--table FILE.toml] [--cache DIR] [--json
FILE]``. The flights and what is known of them are those of ``measured_flights.py``. Good flights of a vehicle are those
of which no weak fan, load or shifted centre of gravity is known; of each vehicle the first three are the good ones.
Every other flight is TODAY once, and each good one is TODAY with the others of them as good ones. Answers stay in the
cache.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import command_line
from result_file import add_option, counted, write_result
from shares import share
from tqdm import tqdm

from measured.answers import DATA, REPO
from measured.known import TABLE, Flight, read

CHANGES = frozenset({"fan_imbalance", "cg_offset", "payload", "slung_load"})
"""Effects that somebody did to a vehicle between two flights."""
GOOD = 3


@dataclass(frozen=True)
class Case:
    """One question: a flight, the good ones, and what changed (empty: nothing)."""

    today: Flight
    good: tuple[Flight, ...]
    changed: frozenset[str]

    @property
    def name(self) -> str:
        """Of the answer in the cache."""
        return "__".join(f.name for f in (self.today, *self.good)).replace("/", "_")


@dataclass(frozen=True)
class Named:
    """What was named, the likeliest first, each with what it cannot be told apart from."""

    changed: frozenset[str]
    names: tuple[str, ...]
    stands_for: tuple[frozenset[str], ...]

    @property
    def first(self) -> bool:
        """Whether the true change, or an effect that is said to be no other, comes first."""
        return bool(self.names and self.stands_for[0] & self.changed)

    @property
    def alone(self) -> bool:
        """Whether nothing else is named."""
        return all(stands & self.changed for stands in self.stands_for)


def cases(flights: list[Flight]) -> Iterator[Case]:
    """Of every vehicle."""
    by_vehicle: dict[tuple[str, str], list[Flight]] = {}
    for flight in flights:
        by_vehicle.setdefault((flight.source, flight.vehicle), []).append(flight)
    for group in by_vehicle.values():
        done = {f.name: frozenset(n for must in f.must for n in must) & CHANGES for f in group}
        good = [f for f in group if not done[f.name]]
        if len(good) < 2:
            continue
        for today in group:
            others = tuple(f for f in good[:GOOD] if f is not today)
            if len(others) >= 2 or (done[today.name] and others):
                yield Case(today, others, done[today.name])


def ask(case: Case, data: Path, cache: Path) -> Named | None:
    """The command's answer; None where a flight is refused."""
    path = cache / f"{case.name}.json"
    if not path.exists():
        command = [
            sys.executable, "-m", "replay", "diagnose", str((data / case.today.log).resolve()), "--since",
            *(str((data / f.log).resolve()) for f in case.good), "--vehicle",
            str((data / case.today.vehicle).resolve()), "--model", "none", "--json", str(path.resolve()), "--quiet",
        ]  # fmt: skip
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        if subprocess.run(
            command, cwd=REPO, env=environment, capture_output=True, check=False
        ).returncode:
            return None
    answer = json.loads(path.read_text(encoding="utf-8"))
    names = tuple(str(one["name"]) for one in answer["changed"])
    classes = [frozenset(map(str, a)) for a in answer.get("aliases", [])]
    stands_for = tuple(frozenset({n}).union(*(c for c in classes if n in c)) for n in names)
    return Named(case.changed, names, stands_for)


def main() -> int:
    """Ask, and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--data", type=Path, default=DATA)
    p.add_argument("--table", type=Path, default=TABLE)
    p.add_argument("--cache", type=Path, default=Path("what_changed"))
    p.add_argument("--json", type=Path)
    add_option(p)
    a = p.parse_args()
    known = read(a.table)
    flights = [
        f for f in known.flights if f.kind == "measured" and not f.again and not f.other_logs
    ]
    here = [f for f in flights if not f.missing(a.data)]
    if not here:
        print(
            f"none of the flights is in {a.data} (they are not part of the project)",
            file=sys.stderr,
        )
        return 0
    a.cache.mkdir(parents=True, exist_ok=True)
    found: list[tuple[Case, Named]] = []
    for case in tqdm(list(cases(here)), file=sys.stderr, disable=not sys.stderr.isatty()):
        answer = ask(case, a.data, a.cache)
        if answer is None:
            print(f"refused      {case.today.source}: {case.today.name}", flush=True)
            continue
        found.append((case, answer))
        right = answer.first and answer.alone if case.changed else not answer.names
        truth = "/".join(sorted(case.changed)) or "nothing"
        names = ", ".join(answer.names) or "nothing"
        print(
            f"{'ok' if right else '--'} {case.today.source}: {case.today.name}: {truth}; named: {names}",
            flush=True,
        )
    changed = [n for c, n in found if c.changed]
    same = [n for c, n in found if not c.changed]
    sums = {
        "true change first": (sum(n.first for n in changed), len(changed)),
        "nothing else named": (sum(n.alone for n in changed), len(changed)),
        "nothing changed, and nothing named": (sum(not n.names for n in same), len(same)),
    }
    for what, (count, of) in sums.items():
        print(f"{what:36}{share([True] * count + [False] * (of - count))}")
    goals = {
        "true change first": 0.9,
        "nothing else named": 0.85,
        "nothing changed, and nothing named": 0.95,
    }
    figures = [
        counted(what, [True] * n + [False] * (of - n), least=goals[what])
        for what, (n, of) in sums.items()
    ]
    write_result(a, figures, seeds=f"{len(found)} questions", simulated=False)
    if a.json is not None:
        a.json.write_text(
            json.dumps({k: {"count": c, "of": n} for k, (c, n) in sums.items()}, indent=1) + "\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
