"""The corner approach over several seeds: mean ± sd, and how much of the air-caused error the offsets remove.

Run it as a command: ``python tests/benchmarks flight.corner_compare --seeds 10 [--json FILE]``. Everything is
simulated. Each seed draws another air (the model's law is wrong by 10 to 30 % about it), turbulence and sensor errors.
The flights run in lockstep: the same seed gives the same numbers on every machine.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import command_line
from result_file import add_option, figure, write_result
from vision import VisionEstimator

from companion.adapt_options import Adapt, read_adapt
from companion.sim.compare import CompareSettings, compare, write
from companion.sim.compare_report import as_json
from companion.sim.sensors import Estimator
from models.common.errors import UserError

GOAL = 0.7
"""Share of the air-caused error that the offsets are to remove."""
LEGS = {
    "autopilot": "the autopilot's own hold", "off": "this program's hold, no offsets",
    "on": "this program's hold with offsets", "free": "this program's hold in free air",
}  # fmt: skip


def figures(answer: dict[str, Any]) -> list[dict[str, Any]]:
    """Of the page of results: shares removed, errors of every leg, contact."""
    removed = answer["air_caused_part_removed"]["on"]["energy"]
    out = [
        figure(f"of the error that the air causes, the offsets remove: {axis}", f"{100 * share:.0f} %",
               goal=f"{100 * GOAL:.0f} %", met=share >= GOAL)
        for axis, share in removed.items()
    ]  # fmt: skip
    legs = [(words, answer["legs"][leg]) for leg, words in LEGS.items() if leg in answer["legs"]]
    for axis, unit in answer["units"].items():
        digits = 2 if axis == "tilt" else 0
        for words, leg in legs:
            rms = leg[axis]["rms"]
            value = f"{rms['mean']:.{digits}f} ± {rms['sd']:.{digits}f}"
            out.append(figure(f"{axis} error [{unit}], {words}", value))
    return out + [
        figure(f"wall touched [s], {words}", f"{leg['touched_s']:.1f}") for words, leg in legs
    ]


def main() -> int:
    """Fly and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--seeds", type=int, default=10, help="how many, from --first on")
    p.add_argument("--first", type=int, default=1)
    p.add_argument("--scenario", default="corner")
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--model")
    p.add_argument(
        "--adapt", type=read_adapt, default=Adapt.OFF, help="full: three approaches in each flight"
    )
    p.add_argument(
        "--vision", action="store_true", help="no GPS: a position from visual odometry that drifts"
    )
    p.add_argument(
        "--turned",
        type=float,
        default=0.0,
        metavar="DEG",
        help="the wall's normal is so far off the beam",
    )
    p.add_argument("--workers", type=int, help="flights at a time (default: one a core)")
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    p.add_argument(
        "--plot", type=Path, metavar="FILE.svg", help="errors over the flight of the first seed"
    )
    p.add_argument("--quiet", action="store_true")
    add_option(p)
    a = p.parse_args()
    settings = CompareSettings(
        scenario=a.scenario,
        vehicle=a.vehicle,
        model=a.model,
        adapt=a.adapt,
        estimator=VisionEstimator if a.vision else Estimator,
        turned_deg=a.turned,
    )
    try:
        seeds = range(a.first, a.first + a.seeds)
        found = compare(seeds, settings, workers=a.workers, quiet=a.quiet)
        write(found, json_path=a.json, plot=a.plot)
        write_result(a, figures(as_json(found)), seeds=f"{seeds[0]} to {seeds[-1]}", simulated=True,
                     repeatable=True)  # fmt: skip
        return 0
    except UserError as error:
        print(f"corner_compare: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
