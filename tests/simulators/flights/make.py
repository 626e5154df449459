"""Simulate a round and write it to a folder: tlogs, vehicle files, ``table.csv`` and ``truth.json``."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from . import near_wall
from .craft import GRAVITY, RHO0, TANDEM, Array, rangers, vehicle_toml
from .effects import CATALOGUE
from .oracle import residual, rms_table
from .recorder import Sensed, frames, sense, write_mixed, write_tlog
from .scenarios import Scenario, scenarios
from .unlisted import UNLISTED
from .world import Tape, World

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
VISIBLE = 0.97  # an axis carries the effect where the oracle is below this share of the RMS before, at 2 Hz
BATCH = 40


def make_round(
    folder: Path, round_number: int, names: Iterable[str] = (), *, progress: bool = False
) -> dict[str, Any]:
    """Write the flights of a round (all, or those named) and return their truth by name."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "table.csv").exists():
        near_wall.write_table(TANDEM, folder / "table.csv")
    wanted = [s for s in scenarios(round_number) if not names or s.name in set(names)]
    truth_file = folder / "truth.json"
    truth: dict[str, Any] = json.loads(truth_file.read_text()) if truth_file.exists() else {}
    missing = [s for s in wanted if s.name not in truth]
    for batch in _batches(missing):
        tape = World(
            batch[0].craft, [s.job(round_number) for s in batch], batch[0].duration_s
        ).fly()
        for k, scenario in enumerate(batch):
            truth[scenario.name] = _write(folder, scenario, round_number, tape, k)
            if progress:
                print(
                    f"{scenario.name}: {truth[scenario.name]['size_of_weight']:.3f} of weight",
                    flush=True,
                )
        truth_file.write_text(json.dumps(truth, indent=1))
    return {s.name: truth[s.name] for s in wanted}


def _batches(missing: Sequence[Scenario]) -> Iterable[list[Scenario]]:
    alike: dict[tuple[str, float], list[Scenario]] = {}
    for s in missing:
        alike.setdefault((s.craft.name, s.duration_s), []).append(s)
    for group in alike.values():
        for start in range(0, len(group), BATCH):
            yield group[start : start + BATCH]


def _write(
    folder: Path, scenario: Scenario, round_number: int, tape: Tape, k: int
) -> dict[str, Any]:
    craft, seed = scenario.craft, scenario.seed(round_number)
    sensors = rangers(craft, ceiling=scenario.ceiling, front=scenario.front)
    toml = vehicle_toml(
        craft, sensors, by_servo=scenario.by_servo, mass_factor=scenario.mass_factor
    )
    (folder / f"{scenario.name}.toml").write_text(toml)
    seen = sense(craft, tape, k, seed, sensors, scenario.log)
    path = folder / f"{scenario.name}.tlog"
    if scenario.second:
        other = _parked(sense(craft, tape, k, seed + 1, sensors, scenario.log))
        quiet = replace(scenario.log, system=7)
        streams = [
            frames(craft, seen, seed, sensors, scenario.log),
            frames(craft, other, seed, sensors, quiet),
        ]
        write_mixed(streams, path)
    else:
        write_tlog(craft, seen, seed, sensors, scenario.log, path)
    before = residual(
        craft, seen, sensors, by_servo=scenario.by_servo, mass_factor=scenario.mass_factor
    )
    effect = tape.effect[:, :, k].copy()
    effect[:, :3] += (scenario.mass_factor - 1.0) * craft.mass_kg * tape.specific_force[:, :, k]
    table = rms_table(before, effect)
    at2 = table["2"]
    carrying = [
        a for a, b, o in zip(AXES, at2["before"], at2["oracle"], strict=True) if o < VISIBLE * b
    ]
    parameters = scenario.job(round_number).effects
    return {
        "group": scenario.group,
        "verdict": scenario.verdict,
        "effects": list(scenario.truth),
        "outside": [e for e in scenario.effects if e in UNLISTED],
        "what": "; ".join(_sentence(e) for e in scenario.effects) or "nothing",
        "parameters": parameters,
        "axes_carrying_it": carrying or None,
        "channels": list(scenario.channels),
        "model": scenario.model,
        "seed": seed,
        "size_of_weight": float(_size(effect, craft.mass_kg * GRAVITY, craft.fan_position[0][0])),
        "range_m": [float(np.nanmin(tape.ranges[:, i, k])) for i in range(4)],
        "density": float(tape.pressure[0, k] / (287.05 * (273.15 + tape.air_c[0, k])) / RHO0),
        "rms_by_bandwidth_hz": table,
    }


def _sentence(name: str) -> str:
    doc = (CATALOGUE | UNLISTED)[name].__doc__ or ""
    return " ".join(doc.split())


def _parked(seen: Sensed) -> Sensed:
    """The same sensors on a vehicle that stands on the ground three metres away, rotors still."""
    rng = np.random.default_rng(5)
    count = len(seen.time)
    still = np.array([0.0, 0.0, -GRAVITY]) + 0.02 * rng.standard_normal((count, 3))
    place = np.array([3.0, 0.0, 0.0]) + 0.004 * rng.standard_normal((count, 3))
    ranges = np.where(np.isnan(seen.ranges), np.nan, 0.05)
    return replace(
        seen,
        accel=still,
        gyro=0.001 * rng.standard_normal((count, 3)),
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        position=place,
        velocity=0.005 * rng.standard_normal((count, 3)),
        rpm=0.0 * seen.rpm,
        pwm=np.full_like(seen.pwm, 1000.0),
        ranges=ranges,
    )


def _size(effect: Array, weight: float, arm: float) -> float:
    """95th percentile of the effect: force over weight, or moment over weight times the fan's lever arm."""
    force = np.percentile(np.linalg.norm(effect[:, :3], axis=1), 95) / weight
    moment = np.percentile(np.linalg.norm(effect[:, 3:], axis=1), 95) / (weight * arm)
    return float(max(force, moment))
