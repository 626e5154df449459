"""Take flights that others published out of a clone of their repository, as logs and vehicle files.

    python tests/benchmarks sources NAME CLONE OUT

NAME is a module of ``sources/``, which turns the format of its source into .tlog; or a table of what is known of
flights (``measured/rope.toml``) with ``[origin]``: the repository, one of its commits, under ``[origin.logs]`` the path
of each log in it, under ``[origin.vehicle.FILE]`` the keys of each vehicle file. Such logs are copied as they are. All
stay their authors'. Then judge with

    python tests/benchmarks measured.measured_flights --table tests/benchmarks/measured/NAME.toml --data OUT
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import command_line

from sources.clone import read
from sources.vehicle_file import vehicle_toml

CONVERTERS = (
    "ardrone",
    "course",
    "f550",
    "fpv",
    "hexacopter",
    "hexarotor",
    "loss",
    "mambo",
    "nanodrone",
    "nanodrone_training",
    "neurobem",
    "payload",
    "planar",
    "spring",
    "tailsitter",
    "thrown",
    "x8",
)
Logs = Iterator[tuple[str, bytes]]
Vehicles = Mapping[str, Mapping[str, Any]]


def parser() -> argparse.ArgumentParser:
    p = command_line.parser(__doc__, prog="sources")
    p.add_argument("name", metavar="NAME", help=f"{', '.join(CONVERTERS)}, or a table")
    p.add_argument("clone", metavar="CLONE", type=Path)
    p.add_argument("out", metavar="OUT", type=Path)
    return p


def main() -> int:
    p = parser()
    a = p.parse_args()
    if a.name in CONVERTERS:
        logs, vehicles = converted(a.name, a.clone)
    elif a.name.endswith(".toml"):
        origin = tomllib.loads(Path(a.name).read_text(encoding="utf-8")).get("origin", {})
        if "logs" not in origin:
            p.error(f"{a.name}: no [origin.logs]; its logs are made by a module of sources/")
        logs = copied(origin, a.clone)
        vehicles = origin["vehicle"]
    else:
        p.error(f"{a.name}: neither a table nor one of {', '.join(CONVERTERS)}")
    a.out.mkdir(parents=True, exist_ok=True)
    count = 0
    for name, data in logs:
        (a.out / name).write_bytes(data)
        count += 1
    for name, keys in vehicles.items():
        (a.out / f"{name}.toml").write_text(vehicle_toml(keys), encoding="utf-8")
    print(f"{count} logs and {len(vehicles)} vehicle files in {a.out}")
    return 0


def converted(name: str, clone: Path) -> tuple[Logs, Vehicles]:
    """Logs that a module makes, and its vehicle files."""
    source = import_module(f"sources.{name}")
    flights = source.flights(clone)
    logs = ((f"{flight}.tlog", b"".join(motion.records())) for flight, motion in flights)
    return logs, source.VEHICLES


def copied(origin: Mapping[str, Any], clone: Path) -> Logs:
    """Logs as they are."""
    for name, path in origin["logs"].items():
        yield name, read(clone, origin["commit"], path)


if __name__ == "__main__":
    sys.exit(main())
