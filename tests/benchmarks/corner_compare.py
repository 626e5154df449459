"""The corner approach over several seeds: mean ± sd, and how much of the air-caused error the offsets remove.

Run it as a command: ``python tests/benchmarks/corner_compare.py --seeds 10 [--json FILE]``. Everything is simulated.
Each seed draws another air (the model's law is wrong by 10 to 30 % about it), turbulence and sensor errors.
The flights run in lockstep: the same seed gives the same numbers on every machine.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from companion.sim.compare import Flown, Leg, Settings, run_compare, write
from models.errors import UserError


def main() -> int:
    """Fly and print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--seeds", type=int, default=10, help="how many, from --first on")
    p.add_argument("--first", type=int, default=1)
    p.add_argument("--scenario", default="corner")
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--model")
    p.add_argument("--workers", type=int, help="flights at a time (default: one a core)")
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    p.add_argument("--plot", type=Path, metavar="FILE.svg", help="errors over the flight of the first seed")
    p.add_argument("--quiet", action="store_true")
    a = p.parse_args()
    settings = Settings(a.scenario, a.vehicle, a.model)
    try:
        flights = run_compare(range(a.first, a.first + a.seeds), settings, workers=a.workers, quiet=a.quiet)
        if a.plot is not None:
            plot(flights, a.first, a.plot)
        return write(flights, settings, a.json)
    except UserError as error:
        print(f"corner_compare: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


def plot(flights: Sequence[Flown], seed: int, path: Path) -> None:
    """Height and lateral error of one seed's legs over the script, as a picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4.2), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    styles = {Leg.AUTOPILOT: ("0.6", 1.0), Leg.OFF: ("tab:orange", 1.2), Leg.ON: ("tab:blue", 1.6)}
    for flight in (f for f in flights if f.seed == seed and f.leg in styles):
        colour, width = styles[flight.leg]
        for axis, name in zip(axes, ("height", "lateral"), strict=True):
            axis.plot(flight.time_s, flight.size(name), color=colour, lw=width, label=flight.leg.value)
            axis.set_ylabel(f"{name} error [mm]")
            axis.grid(alpha=0.3)
    axes[0].legend(ncols=3, loc="upper right", frameon=False)
    axes[1].set_xlabel(f"time [s]: to the ground, up, to the wall, down into the corner, back (simulated, seed {seed})")
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    sys.exit(main())
