"""One flight makes a model: fly without offsets, diagnose, fly the amended model on other seeds, from any first model.

``python tests/benchmarks flight.corner_loop [--world corner corner_cfd] [--vehicle FILE] [--px4] [--keep DIR] [--json
F]``

Everything is simulated. Energy of the air-caused error that is removed, (E_off^2 - E^2) / (E_off^2 - E_free^2), in
height, sideways, and of both in the corner phase; RMS over the flights. ``declared``: the model as it was; ``one``,
``two``: amended by so many recorded flights; ``adapted``: declared, with ``--adapt full``, approaches 1 to 3. Flights
are kept in ``--keep`` and not flown again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import command_line
import numpy as np
from simulated import Px4Pilot, simulated
from tqdm import tqdm

from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.sim.flown import PHASES, Flown, Leg, fly_judged
from companion.sim.pilot import ScriptedPilot
from companion.sim.scenario import build
from companion.vehicles import default_vehicle
from flight.corner_models import KINDS, declared
from models.choice import choose
from models.common.frames import Array
from models.surrogate.store import save_model
from models.vehicle import Vehicle, load_vehicle
from replay.diagnosis.amended_model import amended
from replay.diagnosis.diagnose import diagnose

AXES = ("height", "sideways", "corner height", "corner sideways")
GOALS = {"one": (0.85, 0.75, 0.60, 0.60), "two": (0.92, 0.85, 0.75, 0.75)}
STAGES = ("declared", "one", "two", "one adapted", "adapted 1", "adapted 2", "adapted 3")
LEAST_AIR = 1.1
"""Energy of the error without offsets over that in free air, below which a share of it says nothing."""
WORSE = 1.03
"""RMS over that without offsets that is still not worse."""


@dataclass(frozen=True)
class World:
    """A scenario, a vehicle, an autopilot's manner, and the folder that keeps what was flown."""

    scenario: str
    vehicle: Vehicle
    px4: bool
    keep: Path

    def flight(
        self, leg: Leg, seed: int, model: str, *, adapt: bool = False, approaches: int = 1
    ) -> Array:
        """Mean squares (approaches, axes) [mm^2] and, in a last column, seconds of contact."""
        name = f"{leg.name}_{seed}_{Path(model).name}_{adapt}_{approaches}.npy"
        path = self.keep / name.lower()
        if not path.exists():
            np.save(path, self._fly(leg, seed, model, adapt, approaches, None))
        return np.asarray(np.load(path))

    def bare(self, leg: Leg, seeds: Sequence[int], approach: int = 0) -> Array:
        """Mean squares without offsets, in an approach of several (from 1) or in a single one."""
        several = 3 if approach else 1
        return np.asarray(
            np.mean(
                [
                    self.flight(leg, s, "none", approaches=several)[max(approach - 1, 0)]
                    for s in seeds
                ],
                axis=0,
            )
        )

    def recorded(self, seed: int) -> Path:
        """The recording of a flight without offsets."""
        path = self.keep / f"recorded_{seed}.tlog"
        if not path.exists():
            self._fly(Leg.OFF, seed, "none", False, 1, path)
        return path

    def amended(self, kind: str, model: str, seeds: Sequence[int]) -> str:
        """The model directory that diagnosis makes of a declared model and some recorded flights."""
        path = self.keep / f"{kind}_amended_{'_'.join(map(str, seeds))}"
        if not (path / "model.json").exists():
            base = None if model == "none" else choose(self.vehicle, model).model
            answer = diagnose([self.recorded(s) for s in seeds], self.vehicle, base)
            save_model(path, amended(base, self.vehicle, answer.adopted))
        return str(path)

    def _fly(
        self, leg: Leg, seed: int, model: str, adapt: bool, approaches: int, record: Path | None
    ) -> Array:
        once = build(self.scenario, self.vehicle, air=leg is not Leg.FREE)
        config = PipelineConfig(
            vehicle=self.vehicle, model=choose(self.vehicle, model).model, offsets=leg in (Leg.ON, Leg.ADAPTED),
            adapt=Adapt.FULL if adapt else Adapt.OFF,
        )  # fmt: skip
        flight = simulated(self.vehicle, once.repeated(approaches), seed, px4=self.px4)
        pilot = Px4Pilot if self.px4 else ScriptedPilot
        seen = fly_judged(
            flight, config, leg, approach_s=once.duration_s, record=record, pilot=pilot
        )
        return np.array([[*_squares(seen, k + 1), seen.touched_s] for k in range(approaches)])


def _squares(seen: Flown, approach: int) -> list[float]:
    out = []
    for phase in (None, PHASES[2]):
        rows = seen.during(approach, phase)
        out += [seen.rms("height", rows) ** 2, seen.rms("lateral", rows) ** 2]
    return out


def judged(
    world: World, kind: str, learn: Sequence[int], judge: Sequence[int], stages: Sequence[str]
) -> dict[str, Array]:
    """Mean squares (axes and contact) of every stage, over all flights."""
    model = declared(kind, world.vehicle, world.keep)
    out: dict[str, Array] = {}
    for stage in stages:
        if stage == "declared":
            rows = [world.flight(Leg.ON, s, model)[0] for s in judge]
        elif stage.startswith("adapted"):
            approach = int(stage[-1]) - 1
            rows = [
                world.flight(Leg.ADAPTED, s, model, adapt=True, approaches=3)[approach]
                for s in judge
            ]
        else:
            count = 2 if stage == "two" else 1
            sets = [[*learn, *learn][i : i + count] for i in range(len(learn))]
            adapt = stage == "one adapted"
            leg = Leg.ADAPTED if adapt else Leg.ON
            rows = [
                world.flight(leg, s, world.amended(kind, model, seeds), adapt=adapt)[0]
                for seeds in sets
                for s in judge
            ]
        out[stage] = np.mean(rows, axis=0)
    return out


def main() -> int:
    """Fly what is not kept, and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--world", nargs="+", default=["corner"], choices=("corner", "corner_cfd"))
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--px4", action="store_true", help="the manner of PX4 in place of ArduPilot's")
    p.add_argument("--declared", nargs="+", default=list(KINDS), choices=KINDS)
    p.add_argument("--stages", nargs="+", default=list(STAGES), choices=STAGES)
    p.add_argument(
        "--learn",
        nargs="+",
        type=int,
        default=[303, 304, 305],
        help="seeds of the recorded flights",
    )
    p.add_argument("--judge", nargs="+", type=int, default=[301, 302, 306], help="seeds that judge")
    p.add_argument("--keep", type=Path, default=Path("corner_loop"))
    p.add_argument("--json", type=Path)
    a = p.parse_args()
    vehicle = default_vehicle() if a.vehicle is None else load_vehicle(a.vehicle)
    found: dict[str, dict[str, dict[str, list[float]]]] = {}
    for scenario in a.world:
        folder = a.keep / f"{scenario}_{vehicle.name.replace(' ', '_')}{'_px4' if a.px4 else ''}"
        folder.mkdir(parents=True, exist_ok=True)
        world = World(scenario, vehicle, a.px4, folder)
        off, free = (world.bare(leg, a.judge) for leg in (Leg.OFF, Leg.FREE))
        print(
            f"sim:{scenario}, {vehicle.name}, {'PX4' if a.px4 else 'ArduPilot'} manner, simulated, RMS [mm]"
        )
        print(f"{'':22}" + "".join(f"{axis:>18}" for axis in AXES) + "  touched")
        for name, e in (("offsets off", off), ("free air", free)):
            print(
                f"{name:22}" + "".join(f"{np.sqrt(v):>18.1f}" for v in e[:-1]) + f"{e[-1]:>8.2f} s"
            )
        found[scenario] = {}
        for kind in tqdm(a.declared, file=sys.stderr, disable=not sys.stderr.isatty()):
            results = judged(world, kind, a.learn, a.judge, a.stages)
            found[scenario][kind] = {stage: e.tolist() for stage, e in results.items()}
            for stage, e in results.items():
                approach = int(stage[-1]) if stage.startswith("adapted") else 0
                beside = [world.bare(leg, a.judge, approach) for leg in (Leg.OFF, Leg.FREE)]
                cells = "".join(
                    _cell(*v) for v in zip(e[:-1], *(x[:-1] for x in beside), strict=True)
                )
                print(f"{kind:10} {stage:11}{cells}{e[-1]:>8.2f} s", flush=True)
    if a.json is not None:
        a.json.write_text(
            json.dumps(
                {"simulated": True, "learn": a.learn, "judge": a.judge, "squares_mm2": found}
            )
        )
    return 0


def _cell(e: float, off: float, free: float) -> str:
    worse = " !" if e > WORSE**2 * off else "  "
    share = f"{(off - e) / (off - free):+.2f}" if off > LEAST_AIR * free else "-"
    return f"{np.sqrt(e):>9.1f} {share:>6}{worse}"


if __name__ == "__main__":
    sys.exit(main())
