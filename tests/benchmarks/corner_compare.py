"""The corner approach over several seeds: mean ± sd, and how much of the air-caused error the offsets remove.

Run it as a command: ``python tests/benchmarks/corner_compare.py --seeds 10 [--json FILE]``. Everything is simulated.
Each seed draws another air (the model's law is wrong by 10 to 30 % about it), turbulence and sensor errors.
The flights run in lockstep: the same seed gives the same numbers on every machine.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from companion.sim.compare import Flown, Leg, Settings, run_compare, write
from companion.sim.scenario import build
from companion.vehicles import default_vehicle
from models.errors import UserError
from models.vehicle import load_vehicle


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
            plot(flights, a.first, a.plot, places(settings))
        return write(flights, settings, a.json)
    except UserError as error:
        print(f"corner_compare: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


def places(settings: Settings) -> list[tuple[float, float, str]]:
    """Start [s], end [s] and name of the phases in which the vehicle stays at ground, wall or corner."""
    vehicle = default_vehicle() if settings.vehicle is None else load_vehicle(settings.vehicle)
    knots = build(settings.scenario, vehicle).knots
    named = ("ground", "wall", "corner")
    return [(k.time_s, after.time_s, k.name) for k, after in pairwise(knots) if k.name in named]


def plot(flights: Sequence[Flown], seed: int, path: Path, phases: Sequence[tuple[float, float, str]]) -> None:
    """Height and lateral error of one seed's legs over the script, its phases shaded, as a picture."""
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    behind = [withStroke(linewidth=3.0, foreground="white")]  # a name stays readable where a line crosses it
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    styles = {Leg.AUTOPILOT: ("0.6", 1.0), Leg.OFF: ("tab:orange", 1.2), Leg.ON: ("tab:blue", 1.6)}
    for flight in (f for f in flights if f.seed == seed and f.leg in styles):
        colour, width = styles[flight.leg]
        for axis, name in zip(axes, ("height", "lateral"), strict=True):
            size = flight.size(name)
            axis.plot(flight.time_s, size, color=colour, lw=width)
            axis.set_ylabel(f"{name} error [mm]")
            axis.grid(alpha=0.3)
            if name == "height":
                continue  # the lines lie apart in the lower panel only: their names stand there
            at = int(size.argmax())
            place = (float(flight.time_s[at]), float(size[at]))
            late = flight.time_s[at] > 0.75 * flight.time_s[-1]
            axis.annotate(
                flight.leg.value, place, (-4 if late else 4, 2), textcoords="offset points", color=colour, fontsize=9,
                ha="right" if late else "left", path_effects=behind, zorder=5,
            )  # fmt: skip
    for axis in axes:
        axis.margins(y=0.12)
    for start, end, phase in phases:
        for axis in axes:
            axis.axvspan(start, end, color="0.5", alpha=0.12, lw=0)
        axes[0].text(0.5 * (start + end), 1.02, phase, ha="center", transform=axes[0].get_xaxis_transform(), fontsize=9)
    axes[1].set_xlabel(f"time since the start of the approach [s] (simulated, seed {seed})")
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    sys.exit(main())
