"""Makes a recorded log long: the same flight again and again, with stamps that go on.

python tests/benchmarks speed.repeat_log LOG --size 200 --out FILE
"""

from __future__ import annotations

from pathlib import Path

import command_line
from repeat_log import write_repeated


def main() -> int:
    """Write one log."""
    p = command_line.parser(__doc__)
    p.add_argument("log", type=Path)
    p.add_argument("--size", type=float, default=200.0, metavar="MB")
    p.add_argument("--out", type=Path, required=True)
    a = p.parse_args()
    rounds = write_repeated(a.log, round(a.size * 1e6), a.out)
    print(f"{a.out}: {a.out.stat().st_size / 1e6:.0f} MB, the flight {rounds} times")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
