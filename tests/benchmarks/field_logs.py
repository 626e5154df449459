"""Take real logs out of a clone of their repository, with the vehicle file that their table holds.

``python tests/benchmarks/field_logs.py TABLE CLONE OUT``: TABLE is a table of what is known of flights (``measured/``)
with ``[origin]``: the repository, one of its commits, and under ``[origin.logs]`` the path of each log in it. Each log
is copied as it is; it stays its authors'. Every ``[origin.vehicle.NAME]`` is written as ``NAME.toml``. Then judge with

    python tests/benchmarks/measured_flights.py --table TABLE --data OUT
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

from field_motion import vehicle_toml
from snapshot import git


def main() -> int:
    if len(sys.argv) != 4:
        print(__doc__, file=sys.stderr)
        return 2
    table, clone, out = (Path(a) for a in sys.argv[1:])
    origin = tomllib.loads(table.read_text(encoding="utf-8")).get("origin")
    if origin is None or "logs" not in origin:
        print(
            f"{table}: no [origin.logs]; its logs are made by a converter of their own",
            file=sys.stderr,
        )
        return 2
    out.mkdir(parents=True, exist_ok=True)
    for name, path in origin["logs"].items():
        (out / name).write_bytes(git(clone, "show", f"{origin['commit']}:{path}"))
    for name, keys in origin["vehicle"].items():
        (out / f"{name}.toml").write_text(vehicle_toml(keys), encoding="utf-8")
    print(f"{len(origin['logs'])} logs and {len(origin['vehicle'])} vehicle files in {out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
