"""Commands that measure: ``python tests/benchmarks TOPIC.NAME [options]`` from the root of the repository.

The README beside says what each is for.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
SHARED = (HERE.parent / "lib", HERE.parent / "simulators")
"""What commands and tests have in common."""


def main() -> int:
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        print(__doc__)
        return 2
    name = sys.argv.pop(1)
    file = HERE.joinpath(*name.split("."))
    if not (file.with_suffix(".py").exists() or (file / "__main__.py").exists()):
        print(f"{name}: no such command in {HERE / 'README.md'}", file=sys.stderr)
        return 2
    sys.path[1:1] = map(str, SHARED)
    runpy.run_module(name, run_name="__main__", alter_sys=True)
    return 0


sys.exit(main())
