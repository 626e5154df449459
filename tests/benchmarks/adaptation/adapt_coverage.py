"""Sizes measured in flight against the truth: how many of the 90 % intervals hold it?

Run it as a command: ``python tests/benchmarks adaptation.adapt_coverage --seeds 20 --first 201``. Everything is
simulated, in lockstep. Each seed draws what changes (a load, a wind, a ceiling's strength, a battery), the air and the
sensors' errors. Every fifth second from five seconds after a change on is one interval; those of one flight are not
independent.
"""

from __future__ import annotations

import json
import math
import random
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from adapt_flights import Watch, add_ceiling, fly, payload, wind, with_ceiling_sensor
from adapt_models import TrueModel
from result_file import add_option, figure, write_result
from simulated import simulated
from tqdm import tqdm

import companion
import models
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.sim.air import REYNOLDS_EXPONENT, RPM_HOVER, disturbed
from companion.sim.flight import SimulatedFlight
from companion.sim.scenario import Waypoint, build
from companion.vehicles import default_vehicle
from models.effects import adopted
from models.surrogate.empty import empty_model
from models.vehicle import Throttle, Vehicle, load_vehicle

Z90 = 1.6449
EVERY_S = 5.0
AFTER_S = 5.0
START_S = 12.0
QUAD = Path(companion.__file__).parent / "vehicles" / "quad.toml"


@dataclass(frozen=True)
class Truth:
    """What is true of one size from a boot time on."""

    size: str
    from_s: float
    value: Callable[[float], float]


def thrust_ratio(flight: SimulatedFlight, model: Any) -> float:
    """True thrust over what the model has at the same speeds, in hover."""
    body = flight.body
    vehicle = flight.vehicle
    each = vehicle.mass_kg * 9.80665 / len(vehicle.fans)
    rpm = math.sqrt(each / (body._per_rpm2 * body._fans[0].ct))
    true = [
        f.ct * body._per_rpm2 * rpm**2 * (rpm / RPM_HOVER) ** REYNOLDS_EXPONENT for f in body._fans
    ]
    return float(np.mean(true)) / float(model.query(math.inf, math.inf, rpm).wrench[2])


def carrying(seed: int) -> tuple[Watch, list[Truth]]:
    """A load of 0.2 to 0.8 kg is picked up in hover."""
    kg, vehicle, model = (
        random.Random(f"load {seed}").uniform(0.2, 0.8),
        default_vehicle(),
        models.load(),
    )
    flight = simulated(vehicle, build("hover", vehicle), seed)
    ratio = thrust_ratio(flight, model)
    at_s = 25.0
    watch = fly(
        flight,
        PipelineConfig(vehicle=vehicle, model=model, adapt=Adapt.FULL),
        50.0,
        payload(at_s, kg),
    )
    loaded = ratio * vehicle.mass_kg / (vehicle.mass_kg + kg)
    return watch, [
        Truth(
            "thrust_scale",
            START_S,
            lambda t: ratio if t < at_s else loaded if t > at_s + AFTER_S else math.nan,
        )
    ]


def blown(seed: int) -> tuple[Watch, list[Truth]]:
    """A wind of 0.5 to 3.5 m/s rises: as much as the hold's tilt stands against."""
    rng = random.Random(f"wind {seed}")
    vehicle = default_vehicle()
    model = models.load()
    speed = rng.uniform(0.5, 3.5)
    towards = rng.uniform(-math.pi, math.pi)
    at_s = 20.0
    north = speed * math.cos(towards)
    east = speed * math.sin(towards)
    watch = fly(
        simulated(vehicle, build("hover", vehicle), seed),
        PipelineConfig(vehicle=vehicle, model=model, adapt=Adapt.FULL), 50.0, wind(at_s, north, east),
    )  # fmt: skip
    from_s = at_s + 3.0 + AFTER_S
    return watch, [
        Truth("wind_north", from_s, lambda _: north),
        Truth("wind_east", from_s, lambda _: east),
    ]


def ceilinged(seed: int) -> tuple[Watch, list[Truth]]:
    """Twice up to a ceiling whose pull is 0.5 to 1.5 of the model's."""
    gain = random.Random(f"ceiling {seed}").uniform(0.5, 1.5)
    vehicle = with_ceiling_sensor(default_vehicle())
    model = models.load()
    known = model.with_effects((adopted("ceiling", {"gain": 1.0, "scale": 1.0}),))
    heights = (
        (0, 1.2),
        (6, 1.2),
        (12, 1.66),
        (22, 1.66),
        (28, 1.2),
        (32, 1.2),
        (38, 1.66),
        (48, 1.66),
        (50, 1.6),
    )
    waypoints = tuple(Waypoint(float(t), 0.0, h, name="c") for t, h in heights)
    script = replace(build("hover", vehicle), waypoints=waypoints, rounding_s=0.6)
    flight = simulated(vehicle, script, seed)
    ratio = thrust_ratio(flight, model)
    add_ceiling(flight, 1.8, gain)
    watch = fly(flight, PipelineConfig(vehicle=vehicle, model=known, adapt=Adapt.FULL), 90.0)
    return watch, [Truth("ceiling", START_S + 17.0, lambda _: gain * ratio)]


def sagging(seed: int) -> tuple[Watch, list[Truth]]:
    """A quadrotor without telemetered speeds empties its battery within a minute."""
    vehicle = declared_by_servo(load_vehicle(QUAD))
    flight = simulated(vehicle, build("hover", vehicle), seed)
    body = flight.body
    body.pack.capacity_ah = random.Random(f"battery {seed}").uniform(0.4, 1.0)
    ratios: list[tuple[float, float]] = []

    def note(_: SimulatedFlight, t: float) -> None:
        if not ratios or t - ratios[-1][0] >= 0.2:
            sag = body.pack.voltage_v / body._hover_v
            each = [
                fan.ct
                / body._fans[0].ct
                * (sag * gain) ** 2
                * (max(rpm, 1.0) / RPM_HOVER) ** REYNOLDS_EXPONENT
                for fan, gain, rpm in zip(body._fans, body._rotor_gain, body.rpm, strict=True)
            ]
            ratios.append((t, float(np.mean(each))))

    watch = fly(
        flight,
        PipelineConfig(vehicle=vehicle, model=empty_model(vehicle), adapt=Adapt.FULL),
        60.0,
        note,
    )

    def truth(t: float) -> float:
        return float(np.interp(t, [r[0] for r in ratios], [r[1] for r in ratios]))

    return watch, [Truth("thrust_scale", START_S, truth)]


def declared_by_servo(vehicle: Vehicle) -> Vehicle:
    """The same with thrust by servo outputs instead of telemetered speeds."""
    curve = Throttle(
        max_thrust_n=14.5, expo=0.65, pwm_min_us=1000.0, pwm_max_us=2000.0, voltage_v=25.0
    )
    fans = tuple(
        replace(f, rotors=tuple(replace(r, esc=None, servo=r.esc) for r in f.rotors)) for f in vehicle.fans
    )  # fmt: skip
    return replace(vehicle, fans=fans, throttle=curve)


def cornered(seed: int) -> tuple[Watch, list[Truth]]:
    """The corner with a model that is right."""
    vehicle = default_vehicle()
    law = disturbed(seed)
    model = TrueModel(vehicle, law)
    flight = simulated(vehicle, build("corner", vehicle), seed, law=law)
    ratio = thrust_ratio(flight, model)
    config = PipelineConfig(vehicle=vehicle, model=model, adapt=Adapt.FULL)  # type: ignore[arg-type]
    watch = fly(flight, config, 120.0)
    return watch, [
        Truth(name, START_S + 17.0, lambda _: ratio)
        for name in ("ground_lift", "wall_tilt", "wall_pull")
    ]


CASES = {
    "payload": carrying,
    "wind": blown,
    "ceiling": ceilinged,
    "battery": sagging,
    "corner": cornered,
}


def scores(watch: Watch, truths: list[Truth]) -> dict[str, list[float]]:
    """Errors in standard deviations, by size."""
    out: dict[str, list[float]] = {}
    for truth in truths:
        due = truth.from_s
        for t, value, sd in watch.size(truth.size, truth.from_s):
            if t >= due and math.isfinite(truth.value(t)):
                due = t + EVERY_S
                out.setdefault(truth.size, []).append((value - truth.value(t)) / sd)
    return out


def main() -> int:
    """Fly and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--seeds", type=int, default=20)
    p.add_argument("--first", type=int, default=201)
    p.add_argument("--cases", nargs="+", choices=sorted(CASES), default=list(CASES))
    p.add_argument("--json", type=Path, metavar="FILE")
    add_option(p)
    a = p.parse_args()
    answer = {}
    print(
        f"simulated, seeds {a.first} to {a.first + a.seeds - 1}; share of 90 % intervals that hold the truth"
    )
    for case in a.cases:
        found: dict[str, list[list[float]]] = {}
        for seed in tqdm(
            range(a.first, a.first + a.seeds),
            desc=case,
            file=sys.stderr,
            disable=not sys.stderr.isatty(),
        ):
            for size, values in scores(*CASES[case](seed)).items():
                found.setdefault(size, []).append(values)
        for size, flights in found.items():
            every = np.concatenate([np.array(f) for f in flights])
            held = np.array([np.mean(np.abs(f) < Z90) for f in flights])
            draw = np.random.default_rng(1).integers(0, len(held), (2000, len(held)))
            low, high = np.percentile(held[draw].mean(axis=1), [5, 95])
            share = float(np.mean(np.abs(every) < Z90))
            rms = float(np.sqrt(np.mean(every**2)))
            print(
                f"{case:9} {size:14} {100 * share:5.1f} % [{100 * low:.0f}, {100 * high:.0f}]  of {len(every):4} in "
                f"{len(flights)} flights; error {np.mean(every):+.2f} sd in the mean, {rms:.2f} RMS",
                flush=True,
            )
            answer[f"{case}.{size}"] = {
                "share": share,
                "interval": [low, high],
                "n": len(every),
                "rms_sd": rms,
            }
    if a.json is not None:
        a.json.write_text(json.dumps(answer, indent=1))
    figures = [
        figure(
            f"90 % intervals that hold the truth: {name.replace('.', ', ').replace('_', ' ')}",
            f"{100 * found['share']:.0f} %",
            f"[{100 * found['interval'][0]:.0f}, {100 * found['interval'][1]:.0f}]",
            "85 to 95 %",
            0.85 <= found["share"] <= 0.95,
        )
        for name, found in answer.items()
    ]
    write_result(
        a, figures, seeds=f"{a.first} to {a.first + a.seeds - 1}", simulated=True, repeatable=True
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
