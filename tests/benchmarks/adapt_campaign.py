"""Three corner approaches in one flight, with models that are right and wrong: does adaptation help, and ever hurt?

Run it as a command: ``python tests/benchmarks/adapt_campaign.py --seeds 10 --first 101 [--json FILE]``. Everything is
simulated, in lockstep: the same seed gives the same numbers on every machine. Legs of one seed share air, turbulence
and sensor errors. ``worse``: RMS of the height error over that with offsets off, minus 1; ``gone``: the share of the
air-caused error that is removed, 1 - sum |e - e_free|^2 / sum |e_off - e_free|^2. Both with 90 % intervals of a
bootstrap over the seeds.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from adapt_models import KINDS, FlowAir, model_of
from tqdm import tqdm

from companion.adaptation.options import Adapt
from companion.config import PipelineConfig
from companion.sim.air import disturbed, surrogate_error
from companion.sim.compare import Flown, Leg, flown, read_truth
from companion.sim.flight import Flight
from companion.sim.lockstep import Lockstep
from companion.sim.pilot import Hand, ScriptedPilot
from companion.sim.scenario import Scenario, build
from companion.vehicles import default_vehicle
from models.frames import Array
from models.vehicle import Vehicle, load_vehicle

APPROACHES = 3
MODES = ("on", "full")
AXES = ("height", "lateral")


def repeated(scenario: Scenario, times: int) -> Scenario:
    """The same script so many times in one flight."""
    long, first = scenario.duration_s, scenario.knots[:-1]
    knots = [replace(k, time_s=k.time_s + i * long) for i in range(times) for k in first]
    return replace(scenario, knots=(*knots, replace(scenario.knots[-1], time_s=times * long)))


@dataclass(frozen=True)
class Leg3:
    """One flight: error RMS by approach, and instant by instant against others of the seed."""

    kind: str
    mode: str
    seed: int
    flown: Flown
    sizes: dict[str, Any]
    approach_s: float

    def window(self, approach: int) -> Any:
        """Rows of one approach, 0 ... 2; of all for -1."""
        t = self.flown.time_s
        if approach < 0:
            return np.ones(len(t), bool)
        return (t >= approach * self.approach_s) & (t < (approach + 1) * self.approach_s)

    def rms(self, axis: str, approach: int) -> float:
        """In mm."""
        return float(np.sqrt(np.mean(self.flown.size(axis)[self.window(approach)] ** 2)))


def fly(
    vehicle: Vehicle, kind: str, mode: str, seed: int, scenario: str, approaches: int, air: str = "law"
) -> Leg3:  # fmt: skip
    """Fly one leg; ``mode`` off, free (off, in air without ground and wall), on or full; ``air`` law or flow."""
    once = build(scenario, vehicle, air=mode != "free")
    law = disturbed(seed)
    flight = Flight(vehicle, repeated(once, approaches), seed, law=law)
    if air == "flow":
        flight.body._increments = FlowAir(vehicle).increments  # type: ignore[method-assign]
    config = PipelineConfig(
        vehicle,
        model_of(kind, vehicle, law),
        offsets=mode not in ("off", "free"),
        adapt=Adapt.FULL if mode == "full" else Adapt.OFF,
    )
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.csv"
        world = Lockstep(flight, lambda w: ScriptedPilot(w.flight, w.link, Hand.COMPANION, endless=False), truth)
        world.fly(config)
        leg = Leg.FREE if mode == "free" else Leg.OFF if mode == "off" else Leg.ON
        result = flown(leg, seed, read_truth(truth), vars(surrogate_error(law)))
    assert world.companion is not None
    known = world.companion.summary.adaptation
    return Leg3(kind, mode, seed, result, {} if known is None else known.as_json(), once.duration_s)


@dataclass(frozen=True)
class Cell:
    """One flight in one approach (0: all of them) on one axis: RMS with and without [mm], squares left and of all."""

    kind: str
    mode: str
    seed: int
    axis: str
    approach: int
    rms: float
    rms_off: float
    left: float
    air: float


def cells(ours: Leg3, off: Leg3, free: Leg3, approaches: int) -> list[Cell]:
    """Everything that the tables need of one flight."""
    n = min(len(f.flown.time_s) for f in (ours, off, free))
    out = []
    for axis in AXES:
        for k in range(-1, approaches):
            here = ours.window(k)[:n]
            a, b, c = (getattr(f.flown, axis)[:n][here] for f in (ours, off, free))
            left, air = float(np.sum((a - c) ** 2)), float(np.sum((b - c) ** 2))
            out.append(
                Cell(ours.kind, ours.mode, ours.seed, axis, k + 1, ours.rms(axis, k), off.rms(axis, k), left, air)
            )
    return out


def interval(values: Array, of: Callable[[Array], float]) -> tuple[float, float, float]:
    """``of`` all seeds, and its 90 % interval over bootstrap draws of them."""
    draw = np.random.default_rng(1).integers(0, len(values), (2000, len(values)))
    drawn = np.array([of(values[d]) for d in draw])
    return float(of(values)), float(np.percentile(drawn, 5)), float(np.percentile(drawn, 95))


def report(found: Sequence[Cell]) -> str:
    """The tables."""
    seeds = sorted({c.seed for c in found})
    lines = [
        f"simulated, {len(seeds)} seeds ({seeds[0]} to {seeds[-1]}); value [90 % interval]",
        f"{'model':11} {'mode':5} {'axis':8} {'no.':4} {'RMS mm':>20} {'off mm':>7} {'worse than off %':>22} "
        f"{'worst seed %':>12} {'air part gone %':>22}",
    ]
    for axis in AXES:
        for kind in KINDS:
            for mode in MODES:
                for k in sorted({c.approach for c in found}, key=lambda n: (n == 0, n)):
                    here = [c for c in found if (c.kind, c.mode, c.axis, c.approach) == (kind, mode, axis, k)]
                    if here:
                        lines.append(_line(here))
    return "\n".join(lines)


def _line(here: Sequence[Cell]) -> str:
    first, v = here[0], np.array([(c.rms, c.rms_off, c.left, c.air) for c in here])
    rms = interval(v, lambda x: float(np.sqrt(np.mean(x[:, 0] ** 2))))
    worse = interval(v, lambda x: 100.0 * float(np.sqrt(np.sum(x[:, 0] ** 2) / np.sum(x[:, 1] ** 2)) - 1.0))
    gone = interval(v, lambda x: 100.0 * float(1.0 - x[:, 2].sum() / x[:, 3].sum()))
    off = float(np.sqrt(np.mean(v[:, 1] ** 2)))
    number = str(first.approach) if first.approach else "all"
    return (
        f"{first.kind:11} {first.mode:5} {first.axis:8} {number:4} {_shown(rms):>20} {off:7.1f} {_shown(worse):>22} "
        f"{100.0 * float(np.max(v[:, 0] / v[:, 1]) - 1.0):>+12.1f} {_shown(gone):>22}"
    )


def kept(folder: Path | None, vehicle: Vehicle, kind: str, mode: str, seed: int, a: argparse.Namespace) -> Leg3:
    """A leg from ``folder``, flown and kept there where it is not."""
    if folder is None:
        return fly(vehicle, kind, mode, seed, a.scenario, a.approaches, a.air)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{a.scenario}_{a.approaches}_{a.air}_{kind or 'none'}_{mode}_{seed}.npz"
    if not path.exists():
        leg = fly(vehicle, kind, mode, seed, a.scenario, a.approaches, a.air)
        f = leg.flown
        np.savez_compressed(
            path, time_s=f.time_s, height=f.height, lateral=f.lateral, tilt=f.tilt, touched_s=f.touched_s,
            sizes=json.dumps(leg.sizes), approach_s=leg.approach_s,
        )  # fmt: skip
        return leg
    with np.load(path) as found:
        axes = (found["height"], found["lateral"], found["tilt"])
        result = Flown(Leg.ON, seed, found["time_s"], *axes, float(found["touched_s"]), {})
        return Leg3(kind, mode, seed, result, json.loads(str(found["sizes"])), float(found["approach_s"]))


def main() -> int:
    """Fly what is not kept yet, and print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--seeds", type=int, default=10, help="how many, from --first on")
    p.add_argument("--first", type=int, default=101)
    p.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    p.add_argument("--modes", nargs="+", choices=MODES, default=list(MODES))
    p.add_argument("--scenario", default="corner")
    p.add_argument("--approaches", type=int, default=APPROACHES)
    p.add_argument("--vehicle", type=Path)
    p.add_argument(
        "--air", choices=("law", "flow"), default="law", help="the simulator's own law, or flow simulation's"
    )
    p.add_argument("--legs", type=Path, metavar="DIR", help="keep flown legs here, and do not fly them again")
    a = p.parse_args()
    vehicle = default_vehicle() if a.vehicle is None else load_vehicle(a.vehicle)
    found: list[Cell] = []
    for seed in tqdm(range(a.first, a.first + a.seeds), unit="seed", file=sys.stderr, disable=not sys.stderr.isatty()):
        off, free = (kept(a.legs, vehicle, "", mode, seed, a) for mode in ("off", "free"))
        for kind in a.kinds:
            for mode in a.modes:
                found += cells(kept(a.legs, vehicle, kind, mode, seed, a), off, free, a.approaches)
    print(report(found))
    return 0


def _shown(value: tuple[float, float, float]) -> str:
    middle, low, high = value
    return f"{middle:.1f} [{low:.1f}, {high:.1f}]"


if __name__ == "__main__":
    sys.exit(main())
