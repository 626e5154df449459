"""Fly, diagnose, fly again: hover under a ceiling that the shipped model does not know, before and after adopting it.

``python tests/benchmarks flight.amended_hover [--seeds 5] [--keep DIR] [--json FILE]``. Everything is simulated: the
built-in vehicle with a ceiling added here (the image of the rotor's sink disc relieves its inflow; the catalogue's
ceiling follows another law), the flight program's loop, its recording, ``replay diagnose --save-model``, and the loop
again with the amended model. The flights that are learnt from are not those that are judged; all are of one vehicle,
slightly other than its file says.
"""

from __future__ import annotations

import json
import math
import os
import random
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import command_line
import numpy as np
from result_file import add_option, figure, write_result

import models
from companion.config import Base, PipelineConfig
from companion.sim.air import Unsteadiness
from companion.sim.body import Body, Surroundings
from companion.sim.fan_wrench import Vec
from companion.sim.flight import SimulatedFlight
from companion.sim.flown import AXES, UNITS, Flown, Leg, fly_judged
from companion.sim.scenario import ROUNDING_S, Scenario, Waypoint
from companion.sim.sensors import true_range
from companion.vehicles import TANDEM
from models.common.errors import ModelError, UserError
from models.vehicle import load_vehicle
from replay.cli import main as replay

CEILING_M = 2.6
UNDER_M = 0.36
"""Closer than this to the ceiling counts as under it: 2.2 rotor radii."""
STRENGTH = (1.0, 1.5)
LEARNT_FROM = (101, 102)
BUILD = 7
SENSOR = '[[rangefinder]]\norientation = 24 # up\ntarget = "ceiling"\nposition_m = [0.0, 0.0, -0.05]\n\n[limits]'


class CeilingBody(Body):
    """The built-in vehicle under a ceiling, which draws up every fan: its image relieves the inflow.

    One vehicle and one ceiling, drawn by ``BUILD``; the flight's seed draws the air's unsteadiness (and the sensors).
    """

    def __post_init__(self) -> None:
        flight, self.seed = self.seed, BUILD
        super().__post_init__()
        self._unsteady = Unsteadiness(f"unsteady {flight}", 6 * len(self.vehicle.fans), self.dt)

    def _air(self, pwm: Sequence[float], rot: tuple[float, ...]) -> None:
        super()._air(pwm, rot)
        strength = random.Random(f"ceiling {self.seed}").uniform(*STRENGTH)
        lift = -self.causes.free[2] / len(self.vehicle.fans)
        fx, fy, fz, mx, my, mz = self.causes.corner
        for fan in self.vehicle.fans:
            x, y, z = fan.position_m
            gap = max(CEILING_M + self.position[2] + rot[6] * x + rot[7] * y + rot[8] * z, 0.04)
            zeta = 2.0 * gap / self.radius
            extra = strength * 0.5 * (1.0 - zeta / math.hypot(1.0, zeta)) * lift
            fz, mx, my = fz - extra, mx - y * extra, my + x * extra
        self.causes.corner = (fx, fy, fz, mx, my, mz)


def ranged(body: Body, position: Vec, direction: Vec) -> float:
    """What a rangefinder measures: the simulator's ground and wall, and the ceiling."""
    rot = body.rotation()
    down = sum(rot[6 + i] * direction[i] for i in range(3))
    if down > -1e-6:
        return true_range(body, position, direction)
    above = CEILING_M + body.position[2] + sum(rot[6 + i] * position[i] for i in range(3))
    return min(true_range(body, position, direction), max(above, 0.0) / -down)


def vehicle_file(folder: Path) -> Path:
    """The shipped tandem with a rangefinder that looks up."""
    path = folder / "tandem_with_up_ranger.toml"
    path.write_text(
        TANDEM.read_text(encoding="utf-8").replace("[limits]", SENSOR), encoding="utf-8"
    )
    return path


def script() -> Scenario:
    """Slowly up to three gaps, to and fro under the ceiling, down; then fast up, down again."""
    stops = [
        # seconds, gap to the ceiling [m], along [m], name
        (6.0, 1.4, 0.0, "free"), (5.0, 1.4, 0.0, "climb"), (5.0, 0.32, 0.0, "2 R"), (1.0, 0.32, 0.0, "climb"),
        (5.0, 0.22, 0.0, "1.3 R"), (1.0, 0.22, 0.0, "climb"), (5.0, 0.16, 0.0, "1 R"), (3.0, 0.16, 0.0, "along"),
        (2.0, 0.16, 0.6, "beside"), (3.0, 0.16, 0.6, "back"), (2.0, 0.16, 0.0, "1 R"), (4.0, 0.16, 0.0, "descend"),
        (3.0, 1.4, 0.0, "free"), (2.4, 1.4, 0.0, "fast climb"), (5.0, 0.2, 0.0, "1.2 R"), (2.4, 0.2, 0.0, "descend"),
        (4.0, 1.4, 0.0, "free"), (0.0, 1.4, 0.0, "end"),
    ]  # fmt: skip
    waypoints = []
    at = 0.0
    for seconds, gap, along, name in stops:
        waypoints.append(Waypoint(at, 0.0, CEILING_M - gap, along, name))
        at += seconds
    return Scenario("ceiling", Surroundings(), tuple(waypoints), rounding_s=ROUNDING_S)


def fly(
    seed: int,
    model: Path | None,
    vehicle: Path,
    record: Path | None = None,
    scenario: Scenario | None = None,
) -> Flown:
    """One flight under the ceiling with the shipped model or another, judged by the truth."""
    declared = load_vehicle(vehicle)
    config = PipelineConfig(vehicle=declared, model=models.load(model), base=Base.HOLD)
    with (
        patch("companion.sim.flight.Body", CeilingBody),
        patch("companion.sim.sensors.true_range", ranged),
    ):
        return fly_judged(
            SimulatedFlight(declared, scenario or script(), seed), config, Leg.ON, record=record
        )


@dataclass(frozen=True)
class Change:
    """RMS of one axis with the old and the amended model, mean over seeds; the paired change with its 95 % interval."""

    old: float
    new: float
    change: float
    ci95: tuple[float, float]


def changes(old: Sequence[Flown], new: Sequence[Flown], *, under: bool) -> dict[str, Change]:
    """By axis; ``under`` looks only at the time under the ceiling."""
    from scipy.stats import t as student

    flight = script()

    def rms(f: Flown, axis: str) -> float:
        near = np.array(
            [CEILING_M + flight.reference(float(s)).position[2] < UNDER_M for s in f.time_s]
        )
        return float(np.sqrt(np.mean(f.size(axis)[near if under else slice(None)] ** 2)))

    out = {}
    for axis in AXES:
        a = np.array([rms(f, axis) for f in old])
        b = np.array([rms(f, axis) for f in new])
        difference = b - a
        half = math.nan
        if len(a) > 1:
            half = float(
                student.ppf(0.975, len(a) - 1) * difference.std(ddof=1) / math.sqrt(len(a))
            )
        mean = float(difference.mean())
        out[axis] = Change(float(a.mean()), float(b.mean()), mean, (mean - half, mean + half))
    return out


def diagnose(logs: Sequence[Path], vehicle: Path, folder: Path) -> tuple[Path, dict[str, Any]]:
    """``replay diagnose --save-model`` on the learning flights: the amended model and the answer."""
    model = folder / "amended"
    answer = folder / "answer.json"
    command = ["diagnose", *map(str, logs), "--vehicle", str(vehicle), "--quiet"]
    if (
        replay(
            [*command, "--save-model", str(model), "--json", str(answer), "--report", str(folder)]
        )
        != 0
    ):
        raise ModelError("the recorded flights could not be diagnosed")
    return model, json.loads(answer.read_text())


def measure(seeds: Sequence[int], folder: Path, *, quiet: bool = False) -> dict[str, Any]:
    """The whole chain."""
    vehicle = vehicle_file(folder)

    def say(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr, flush=True)

    logs = [folder / f"learn-{seed}.tlog" for seed in LEARNT_FROM]
    for seed, log in zip(LEARNT_FROM, logs, strict=True):
        fly(seed, None, vehicle, log)
        say(f"recorded {log.name}")
    model, answer = diagnose(logs, vehicle, folder)
    say(
        f"{answer['verdict']}: "
        + ", ".join(f"{e['name']} ({e['status']})" for e in answer["effects"])
    )
    old = []
    new = []
    for seed in seeds:
        old.append(fly(seed, None, vehicle))
        new.append(fly(seed, model, vehicle))
        say(
            f"seed {seed}: height RMS {old[-1].rms('height'):.1f} -> {new[-1].rms('height'):.1f} mm"
        )
    return {
        "simulated": True,
        "seeds": list(seeds),
        "learnt_from": list(LEARNT_FROM),
        "verdict": answer["verdict"],
        "effects": {
            e["name"]: {"status": e["status"], "parameters": e["parameters"]}
            for e in answer["effects"]
        },
        "axes": answer["axes"],
        **{
            where: {axis: vars(c) for axis, c in changes(old, new, under=under).items()}
            for where, under in (("under_the_ceiling", True), ("whole_flight", False))
        },
        "touched_s": [float(np.mean([f.touched_s for f in flights])) for flights in (old, new)],
    }


def as_text(result: dict[str, Any]) -> str:
    """The table for a person."""
    named = ", ".join(f"{name} ({e['status']})" for name, e in result["effects"].items())
    lines = [f"simulated, {len(result['seeds'])} seeds; {result['verdict']}: {named}"]
    for where in ("under_the_ceiling", "whole_flight"):
        for axis, c in result[where].items():
            lines.append(
                f"{where.replace('_', ' '):18s} {axis:8s} RMS {c['old']:7.2f} -> {c['new']:7.2f} {UNITS[axis]}"
                f"   change {c['change']:+.2f} [{c['ci95'][0]:+.2f}, {c['ci95'][1]:+.2f}]"
            )
    return "\n".join(lines)


def main() -> int:
    """Fly and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--seeds", type=int, default=5, help="how many flights with each model")
    p.add_argument("--first", type=int, default=1)
    p.add_argument(
        "--keep",
        type=Path,
        metavar="DIR",
        help="keep flights and model here (default: a temporary folder)",
    )
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    add_option(p)
    a = p.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = a.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        try:
            result = measure(range(a.first, a.first + a.seeds), folder)
        except UserError as error:
            print(f"amended_hover: {error}", file=sys.stderr)
            return error.exit_code
    if a.json is not None:
        text = json.dumps(result, indent=1)
        print(text) if a.json == "-" else Path(a.json).write_text(text + "\n", encoding="utf-8")
    if a.json != "-":
        print(as_text(result))
    height = result["under_the_ceiling"]["height"]
    aside = result["whole_flight"]["lateral"]
    figures = [
        figure("height error under the ceiling [mm], shipped model", f"{height['old']:.1f}"),
        figure("the same, amended model", f"{height['new']:.1f}"),
        figure(
            "change [mm]", f"{height['change']:.1f}", "[{:.1f}, {:.1f}]".format(*height["ci95"])
        ),
        figure(
            "lateral error, whole flight [mm], shipped, amended",
            f"{aside['old']:.1f}, {aside['new']:.1f}",
        ),
    ]
    write_result(
        a, figures, seeds=f"{a.first} to {a.first + a.seeds - 1}", simulated=True, repeatable=True
    )
    return 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
