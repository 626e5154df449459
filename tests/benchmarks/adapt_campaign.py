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
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from adapt_models import KINDS, model_of
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
MODES = ("on", "gate", "full")
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


def fly(vehicle: Vehicle, kind: str, mode: str, seed: int, scenario: str, approaches: int) -> Leg3:
    """Fly one leg; ``mode`` off, free (off, in air without ground and wall), on, gate or full."""
    once = build(scenario, vehicle, air=mode != "free")
    law = disturbed(seed)
    flight = Flight(vehicle, repeated(once, approaches), seed, law=law)
    config = PipelineConfig(
        vehicle,
        model_of(kind, vehicle, law),
        offsets=mode not in ("off", "free"),
        adapt=Adapt(mode) if mode in ("gate", "full") else Adapt.OFF,
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
class Row:
    """One kind and mode over all seeds, in one approach: value and its 90 % interval."""

    kind: str
    mode: str
    axis: str
    approach: int
    rms: tuple[float, float, float]
    worse: tuple[float, float, float]
    gone: tuple[float, float, float]
    worst_seed: float
    """Largest ``worse`` of any seed."""


def gone(legs: Sequence[Leg3], off: Sequence[Leg3], free: Sequence[Leg3], axis: str, approach: int) -> Array:
    """(seeds, 2): squares of what is left of the air's error, and of all of it."""
    out = []
    for one, without, calm in zip(legs, off, free, strict=True):
        n = min(len(f.flown.time_s) for f in (one, without, calm))
        here = one.window(approach)[:n]
        a, b, c = (getattr(f.flown, axis)[:n][here] for f in (one, without, calm))
        out.append((float(np.sum((a - c) ** 2)), float(np.sum((b - c) ** 2))))
    return np.array(out)


def interval(values: Array, draw: Array, of: Any) -> tuple[float, float, float]:
    """``of`` all seeds, and the 90 % interval over bootstrap draws of them."""
    drawn = np.array([of(values[d]) for d in draw])
    return float(of(values)), float(np.percentile(drawn, 5)), float(np.percentile(drawn, 95))


def rows(legs: Sequence[Leg3], seeds: Sequence[int], approaches: int) -> list[Row]:
    """The table."""
    by = {(leg.kind, leg.mode, leg.seed): leg for leg in legs}
    draw = np.random.default_rng(1).integers(0, len(seeds), (2000, len(seeds)))
    off = [by["", "off", s] for s in seeds]
    free = [by["", "free", s] for s in seeds]
    out = []
    for kind in KINDS:
        for mode in MODES:
            if (kind, mode, seeds[0]) not in by:
                continue
            ours = [by[kind, mode, s] for s in seeds]
            for axis in AXES:
                for k in (*range(approaches), -1):
                    rms = np.array([(o.rms(axis, k), w.rms(axis, k)) for o, w in zip(ours, off, strict=True)])
                    left = gone(ours, off, free, axis, k)
                    out.append(
                        Row(
                            kind, mode, axis, k + 1,
                            interval(rms, draw, lambda v: np.sqrt(np.mean(v[:, 0] ** 2))),
                            interval(rms, draw, lambda v: np.sqrt(np.mean(v[:, 0] ** 2) / np.mean(v[:, 1] ** 2)) - 1),
                            interval(left, draw, lambda v: 1.0 - v[:, 0].sum() / v[:, 1].sum()),
                            float(np.max(rms[:, 0] / rms[:, 1]) - 1.0),
                        )
                    )  # fmt: skip
    return out


def main() -> int:
    """Fly and print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--seeds", type=int, default=10, help="how many, from --first on")
    p.add_argument("--first", type=int, default=101)
    p.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    p.add_argument("--modes", nargs="+", choices=MODES, default=list(MODES))
    p.add_argument("--scenario", default="corner")
    p.add_argument("--approaches", type=int, default=APPROACHES)
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--json", type=Path, metavar="FILE")
    a = p.parse_args()
    vehicle = default_vehicle() if a.vehicle is None else load_vehicle(a.vehicle)
    seeds = range(a.first, a.first + a.seeds)
    jobs = [("", mode, seed) for seed in seeds for mode in ("off", "free")]
    jobs += [(kind, mode, seed) for seed in seeds for kind in a.kinds for mode in a.modes]
    legs = [
        fly(vehicle, *job, a.scenario, a.approaches)
        for job in tqdm(jobs, unit="flight", file=sys.stderr, disable=not sys.stderr.isatty())
    ]
    table = rows(legs, seeds, a.approaches)
    print(f"sim:{a.scenario}, simulated, {a.approaches} approaches, seeds {seeds[0]} to {seeds[-1]}; [90 % interval]")
    head = f"{'RMS mm':>22} {'worse than off %':>22} {'worst seed':>10} {'air part gone %':>24}"
    print(f"{'model':11} {'mode':5} {'axis':8} {'no.':4} {head}")
    for r in table:
        number = "all" if r.approach == 0 else str(r.approach)
        print(
            f"{r.kind:11} {r.mode:5} {r.axis:8} {number:4} {_shown(r.rms):>22} {_shown(r.worse, 100.0):>22} "
            f"{100.0 * r.worst_seed:>+10.1f} {_shown(r.gone, 100.0):>24}"
        )
    if a.json is not None:
        told = [{"kind": x.kind, "mode": x.mode, "seed": x.seed, "sizes": x.sizes} for x in legs if x.sizes]
        a.json.write_text(json.dumps({"rows": [asdict(r) for r in table], "sizes": told}, indent=1))
    return 0


def _shown(value: tuple[float, float, float], scale: float = 1.0) -> str:
    middle, low, high = (scale * v for v in value)
    return f"{middle:.1f} [{low:.1f}, {high:.1f}]"


if __name__ == "__main__":
    sys.exit(main())
