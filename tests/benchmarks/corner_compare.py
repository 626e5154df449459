"""The corner approach over several seeds: mean ± sd, and how much of the air-caused error the offsets remove.

Run it as a command: ``python tests/benchmarks/corner_compare.py --seeds 10 [--json FILE]``. Everything is simulated.
Each seed draws another air (the undisturbed law is wrong by 10 to 30 % about it), turbulence and sensor errors.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from companion.sim.compare import SPEED, Settings, run_compare, write
from models.errors import UserError


def main() -> int:
    """Fly and print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--seeds", type=int, default=10, help="how many, from --first on")
    p.add_argument("--first", type=int, default=1)
    p.add_argument("--scenario", default="corner")
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--model")
    p.add_argument("--speed", type=float, default=SPEED)
    p.add_argument("--workers", type=int, help="flights at a time (default: one a core)")
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    p.add_argument("--quiet", action="store_true")
    a = p.parse_args()
    settings = Settings(a.scenario, a.vehicle, a.model, a.speed)
    try:
        flights = run_compare(range(a.first, a.first + a.seeds), settings, workers=a.workers, quiet=a.quiet)
        return write(flights, settings, a.json)
    except UserError as error:
        print(f"corner_compare: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
