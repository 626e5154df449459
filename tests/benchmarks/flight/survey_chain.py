"""One command from a flight to a model: survey a box, diagnose with no model, fly what was found.

``python tests/benchmarks flight.survey_chain [--vehicle FILE.toml] [--air 11] [--seeds 2] [--box 0.3:1.1:0.2:0.9]``.
Everything is simulated, in lockstep. The survey flies one vehicle in one air; judged are corner approaches of the same
vehicle in the same air, with other turbulence and sensor errors.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import command_line
from flight_case import Case, CasePilot, surroundings
from lockstep_faults import FaultyLockstep
from result_file import add_option, figure, write_result
from simulated import simulated

import models
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.control.survey import Phase
from companion.sim.air import disturbed
from companion.sim.body import Body
from companion.sim.flight import SimulatedFlight
from companion.sim.flown import AXES, UNITS, Flown, Leg, fly_judged
from companion.sim.scenario import build
from companion.survey_box import read_box
from companion.vehicles import TANDEM
from models.common.errors import UserError
from models.surrogate.empty import empty_model
from models.vehicle import Vehicle, load_vehicle
from replay.cli import main as replay

WALL_M = 1.2
LIMIT_S = 400.0


def one_vehicle(vehicle: Vehicle, scenario: Any, seed: int, air: int) -> SimulatedFlight:
    """A flight of one vehicle in one air, both drawn by ``air``; ``seed`` draws turbulence and sensor errors."""
    flight = simulated(vehicle, scenario, seed, law=disturbed(air))
    body = Body(
        vehicle=vehicle,
        surroundings=scenario.surroundings,
        law=disturbed(air),
        seed=air,
        motor=flight.body.motor,
    )
    # The sensors hold the body that they were built with: it is given the build of the one vehicle.
    for name in ("_fans", "_vane_gains", "_rotor_gain", "_rpm_full"):
        setattr(flight.body, name, getattr(body, name))
    return flight


def surveying(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(1.0)
    yield from p.hand_over()
    p.judge()
    while p.flight.time_s < LIMIT_S:
        yield 1.0
        companion = p.world.companion
        if companion is not None and companion.incoming.state.requests.survey.phase in (
            Phase.DONE,
            Phase.ABORTED,
        ):
            return


def survey(vehicle: Vehicle, air: int, box: str, folder: Path) -> tuple[Path, dict[str, Any]]:
    """Fly the box with no model; the recording, and what became of the survey."""
    case = Case("survey", "", surveying, wall_m=WALL_M)
    flight = one_vehicle(vehicle, surroundings(case, vehicle), 1, air)
    pilots: list[CasePilot] = []

    def pilot(world: FaultyLockstep) -> CasePilot:
        pilots.append(CasePilot(world, surveying))
        return pilots[0]

    world = FaultyLockstep(flight, pilot)
    log = folder / "survey.tlog"
    world.fly(
        PipelineConfig(
            vehicle=vehicle,
            model=empty_model(vehicle),
            survey=read_box(box),
            adapt=Adapt.FULL,
        ),
        log,
    )
    assert world.companion is not None
    judged = pilots[0].judgement
    end = {"seconds": flight.time_s, "contact_s": judged.contact_s, "lowest_m": judged.lowest_m}
    return log, {**world.companion.incoming.state.requests.survey.as_json(), **end}


def approach(
    vehicle: Vehicle, air: int, seed: int, model: Any, *, offsets: bool = True, adapt: Adapt
) -> Flown:
    """The corner approach with a model."""
    flight = one_vehicle(vehicle, build("corner", vehicle), seed, air)
    return fly_judged(
        flight,
        PipelineConfig(vehicle=vehicle, model=model, offsets=offsets, adapt=adapt),
        Leg.ON if offsets else Leg.OFF,
    )


def measure(path: Path, air: int, box: str, seeds: int, folder: Path) -> dict[str, Any]:
    """The whole chain."""
    vehicle = load_vehicle(path)
    log, became = survey(vehicle, air, box, folder)
    print(f"survey: {became}", file=sys.stderr, flush=True)
    found = folder / "model"
    answer = folder / "answer.json"
    command = ["diagnose", str(log), "--vehicle", str(path), "--model", "none", "--quiet"]
    replay([*command, "--save-model", str(found), "--json", str(answer)])
    diagnosis = json.loads(answer.read_text(encoding="utf-8"))
    named = {e["name"]: round(e["explains"], 3) for e in diagnosis["effects"]}
    print(f"{diagnosis['verdict']}: {named}", file=sys.stderr, flush=True)
    rms: dict[str, dict[str, list[float]]] = {}
    for seed in range(21, 21 + seeds):
        none = empty_model(vehicle)
        surveyed = models.load(str(found))
        for name, model, offsets, adapt in (
            ("offsets_off", none, False, Adapt.FULL),
            ("no_model", none, True, Adapt.FULL),
            ("surveyed", surveyed, True, Adapt.FULL),
            ("surveyed, adapt off", surveyed, True, Adapt.OFF),
        ):
            result = approach(vehicle, air, seed, model, offsets=offsets, adapt=adapt)
            legs = rms.setdefault(name, {axis: [] for axis in (*AXES, "touched_s")})
            legs["touched_s"].append(result.touched_s)
            for axis in AXES:
                legs[axis].append(result.rms(axis))
    mean = {name: {axis: sum(v) / len(v) for axis, v in axes.items()} for name, axes in rms.items()}
    return {
        "simulated": True,
        "survey": became,
        "verdict": diagnosis["verdict"],
        "effects": named,
        "rms": mean,
    }


def main() -> int:
    """Fly and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--vehicle", type=Path, default=TANDEM)
    p.add_argument("--air", type=int, default=11, help="draws the air and the vehicle")
    p.add_argument("--box", default="0.3:1.1:0.2:0.9")
    p.add_argument("--seeds", type=int, default=2)
    p.add_argument("--keep", type=Path, metavar="DIR")
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    add_option(p)
    a = p.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = a.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        try:
            result = measure(a.vehicle, a.air, a.box, a.seeds, folder)
        except UserError as error:
            print(f"survey_chain: {error}", file=sys.stderr)
            return error.exit_code
    if a.json is not None:
        text = json.dumps(result, indent=1)
        print(text) if a.json == "-" else Path(a.json).write_text(text + "\n", encoding="utf-8")
    rows = []
    for name, axes in result["rms"].items():
        wall = f"height {axes['height']:.1f} mm, wall touched {axes['touched_s']:.1f} s"
        what = f"{a.vehicle.stem}, air {a.air}, {name}: sideways"
        rows.append(figure(what, f"{axes['lateral']:.1f} mm", wall))
        print(
            f"{name:20}" + "".join(f"{axis} {axes[axis]:7.2f} {UNITS[axis]}   " for axis in AXES),
            end="",
        )
        print(f"touched {axes['touched_s']:.1f} s")
    write_result(a, rows, seeds=f"judged 21 to {20 + a.seeds}", simulated=True, repeatable=True)
    return 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
