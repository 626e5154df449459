"""The corner approach over several seeds: mean ± sd, and how much of the air-caused error the offsets remove.

Run it as a command: ``python tests/benchmarks/corner_compare.py --seeds 10 [--json FILE]``. Everything is simulated.
Each seed draws another air (the model's law is wrong by 10 to 30 % about it), turbulence and sensor errors.
The flights run in lockstep: the same seed gives the same numbers on every machine.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from companion.adapt_options import Adapt, read_adapt
from companion.sim.compare import Settings, compare, write
from models.errors import UserError


def main() -> int:
    """Fly and print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--seeds", type=int, default=10, help="how many, from --first on")
    p.add_argument("--first", type=int, default=1)
    p.add_argument("--scenario", default="corner")
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--model")
    p.add_argument("--adapt", type=read_adapt, default=Adapt.OFF, help="full: three approaches in each flight")
    p.add_argument("--workers", type=int, help="flights at a time (default: one a core)")
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    p.add_argument("--plot", type=Path, metavar="FILE.svg", help="errors over the flight of the first seed")
    p.add_argument("--quiet", action="store_true")
    a = p.parse_args()
    settings = Settings(a.scenario, a.vehicle, a.model, a.adapt)
    try:
        seeds = range(a.first, a.first + a.seeds)
        write(compare(seeds, settings, workers=a.workers, quiet=a.quiet), json_path=a.json, plot=a.plot)
        return 0
    except UserError as error:
        print(f"corner_compare: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
