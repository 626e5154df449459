"""Three corner approaches in one flight, with models that are right and wrong: does adaptation help, and ever hurt?

Run it as a command: ``python tests/benchmarks adaptation.adapt_campaign --seeds 10 --first 101 [--json FILE]``.
Everything is simulated, in lockstep: the same seed gives the same numbers on every machine. Legs of one seed share air,
turbulence and sensor errors. ``worse``: RMS of the height error over that with offsets off, minus 1; ``gone``: the
share of the air-caused error that is removed, 1 - sum |e - e_free|^2 / sum |e_off - e_free|^2. Both with 90 % intervals
of a bootstrap over the seeds.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import command_line
import numpy as np
from adapt_models import KINDS, model_of
from tqdm import tqdm

from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.sim.flight import SimulatedFlight
from companion.sim.flown import Flown, Leg, fly_judged
from companion.sim.scenario import NAMES, build
from companion.sim.world import law_of
from companion.vehicles import default_vehicle
from models.common.frames import Array
from models.vehicle import Vehicle, load_vehicle

APPROACHES = 3
MODES = ("on", "full")
AXES = ("height", "lateral")
LEGS = {"off": Leg.OFF, "free": Leg.FREE, "on": Leg.ON, "full": Leg.ADAPTED}


@dataclass(frozen=True)
class Case:
    """What is flown; ``mode`` off, free (off, in air without ground and wall), on or full."""

    scenario: str
    approaches: int
    kind: str
    mode: str
    seed: int

    def fly(self, vehicle: Vehicle) -> Flown:
        """Fly it."""
        once, law = (
            build(self.scenario, vehicle, air=self.mode != "free"),
            law_of(self.scenario, self.seed),
        )
        config = PipelineConfig(
            vehicle=vehicle,
            model=model_of(self.kind, vehicle, law),
            offsets=self.mode in MODES,
            adapt=Adapt.FULL if self.mode == "full" else Adapt.OFF,
        )
        flight = SimulatedFlight(vehicle, once.repeated(self.approaches), self.seed)
        return fly_judged(flight, config, LEGS[self.mode], approach_s=once.duration_s)


@dataclass(frozen=True)
class Cell:
    """One flight in one approach (0: all of them) on one axis: RMS with and without [mm], squares left and of all."""

    case: Case
    axis: str
    approach: int
    rms: float
    rms_off: float
    left: float
    air: float


def cells(case: Case, ours: Flown, off: Flown, free: Flown) -> list[Cell]:
    """Everything that the tables need of one flight."""
    n = min(len(f.time_s) for f in (ours, off, free))
    out = []
    for axis in AXES:
        for k in range(case.approaches + 1):
            here = ours.during(k or None)[:n]
            a, b, c = (getattr(f, axis)[:n][here] for f in (ours, off, free))
            left = float(np.sum((a - c) ** 2))
            air = float(np.sum((b - c) ** 2))
            rms, rms_off = (f.rms(axis, f.during(k or None)) for f in (ours, off))
            out.append(Cell(case, axis, k, rms, rms_off, left, air))
    return out


def interval(values: Array, of: Callable[[Array], float]) -> tuple[float, float, float]:
    """``of`` all seeds, and its 90 % interval over bootstrap draws of them."""
    draw = np.random.default_rng(1).integers(0, len(values), (2000, len(values)))
    drawn = np.array([of(values[d]) for d in draw])
    return float(of(values)), float(np.percentile(drawn, 5)), float(np.percentile(drawn, 95))


def report(found: Sequence[Cell]) -> str:
    """The tables."""
    seeds = sorted({c.case.seed for c in found})
    lines = [
        f"simulated, {len(seeds)} seeds ({seeds[0]} to {seeds[-1]}); value [90 % interval]",
        f"{'model':11} {'mode':5} {'axis':8} {'no.':4} {'RMS mm':>20} {'off mm':>7} {'worse than off %':>22} "
        f"{'worst seed %':>12} {'air part gone %':>22}",
    ]
    for axis in AXES:
        for kind in KINDS:
            for mode in MODES:
                for k in sorted({c.approach for c in found}, key=lambda n: (n == 0, n)):
                    here = [
                        c
                        for c in found
                        if (c.case.kind, c.case.mode, c.axis, c.approach) == (kind, mode, axis, k)
                    ]
                    if here:
                        lines.append(_line(here))
    return "\n".join(lines)


def _line(here: Sequence[Cell]) -> str:
    first = here[0]
    v = np.array([(c.rms, c.rms_off, c.left, c.air) for c in here])
    rms = interval(v, lambda x: float(np.sqrt(np.mean(x[:, 0] ** 2))))
    worse = interval(
        v, lambda x: 100.0 * float(np.sqrt(np.sum(x[:, 0] ** 2) / np.sum(x[:, 1] ** 2)) - 1.0)
    )
    gone = interval(v, lambda x: 100.0 * float(1.0 - x[:, 2].sum() / x[:, 3].sum()))
    off = float(np.sqrt(np.mean(v[:, 1] ** 2)))
    number = str(first.approach) if first.approach else "all"
    return (
        f"{first.case.kind:11} {first.case.mode:5} {first.axis:8} {number:4} {_shown(rms):>20} {off:7.1f} "
        f"{_shown(worse):>22} "
        f"{100.0 * float(np.max(v[:, 0] / v[:, 1]) - 1.0):>+12.1f} {_shown(gone):>22}"
    )


def kept(folder: Path | None, vehicle: Vehicle, case: Case) -> Flown:
    """A flight from ``folder``, flown and kept there where it is not."""
    if folder is None:
        return case.fly(vehicle)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / ("_".join(map(str, vars(case).values())) + ".pickle")
    if not path.exists():
        path.write_bytes(pickle.dumps(case.fly(vehicle)))
    found: Flown = pickle.loads(path.read_bytes())
    return found


def main() -> int:
    """Fly what is not kept yet, and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--seeds", type=int, default=10, help="how many, from --first on")
    p.add_argument("--first", type=int, default=101)
    p.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    p.add_argument("--modes", nargs="+", choices=MODES, default=list(MODES))
    p.add_argument("--scenario", choices=NAMES, default="corner")
    p.add_argument("--approaches", type=int, default=APPROACHES)
    p.add_argument("--vehicle", type=Path)
    p.add_argument(
        "--legs", type=Path, metavar="DIR", help="keep flown legs here, and do not fly them again"
    )
    a = p.parse_args()
    vehicle = default_vehicle() if a.vehicle is None else load_vehicle(a.vehicle)
    found: list[Cell] = []
    for seed in tqdm(
        range(a.first, a.first + a.seeds),
        unit="seed",
        file=sys.stderr,
        disable=not sys.stderr.isatty(),
    ):
        of_seed = {
            (kind, mode): Case(a.scenario, a.approaches, kind, mode, seed)
            for kind, mode in (("none", "off"), ("none", "free"), *product(a.kinds, a.modes))
        }
        off, free = (kept(a.legs, vehicle, of_seed["none", mode]) for mode in ("off", "free"))
        for case in of_seed.values():
            if case.kind != "none":
                found += cells(case, kept(a.legs, vehicle, case), off, free)
    print(report(found))
    return 0


def _shown(value: tuple[float, float, float]) -> str:
    middle, low, high = value
    return f"{middle:.1f} [{low:.1f}, {high:.1f}]"


if __name__ == "__main__":
    sys.exit(main())
