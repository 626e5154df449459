"""The same approach flown several ways, judged against the truth: is the offset worth having?

Legs of one seed share air, turbulence and sensor errors. Everything here is simulated.
"""

from __future__ import annotations

import csv
import json
import math
import multiprocessing
import os
import signal
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from enum import Enum
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from companion.config import PipelineConfig
from companion.sim.air import surrogate_error
from companion.sim.flight import Flight
from companion.sim.lockstep import Lockstep
from companion.sim.pilot import Hand, ScriptedPilot
from companion.sim.scenario import NAMES, build
from companion.vehicles import default_vehicle
from models.choice import choose_to_fly
from models.errors import ConfigError, LinkError
from models.vehicle import load_vehicle

Array = NDArray[np.float64]
SETTLE_S = (2.0, 5.5)
"""Script time over which each flight's own position error is taken out: the EKF's offset is nobody's merit."""
STEP_S = 0.02
"""Grid on which the flights of one seed are compared: the period of the truth file."""


class Leg(Enum):
    """Who flies, and in which air."""

    AUTOPILOT = "autopilot's own hold"
    OFF = "our hold, offsets off"
    ON = "our hold, offsets on"
    FREE = "our hold, in free air"


AXES = ("height", "lateral", "tilt")
UNITS = {"height": "mm", "lateral": "mm", "tilt": "deg"}


@dataclass(frozen=True)
class Flown:
    """One leg: errors on a grid of script time, height [m], lateral (north, east) [m], tilt (roll, pitch) [rad].

    Tilt error is the true tilt minus the tilt that balances the true air at that instant, vanes included.
    """

    leg: Leg
    seed: int
    time_s: Array
    height: Array
    lateral: Array
    tilt: Array
    touched_s: float
    surrogate_error: dict[str, float]

    def size(self, axis: str) -> Array:
        """Magnitude of the error of ``axis`` in its printed unit, shape (n,)."""
        if axis == "height":
            return np.asarray(1e3 * np.abs(self.height))
        if axis == "lateral":
            return np.asarray(1e3 * np.hypot(self.lateral[:, 0], self.lateral[:, 1]))
        return np.asarray(np.degrees(np.hypot(self.tilt[:, 0], self.tilt[:, 1])))

    def rms(self, axis: str) -> float:
        """Root mean square of ``axis``."""
        return float(np.sqrt(np.mean(self.size(axis) ** 2)))

    def peak(self, axis: str) -> float:
        """Largest error of ``axis``."""
        return float(np.max(self.size(axis)))


def read_truth(path: Path) -> dict[str, Array]:
    """The numeric columns of a truth file from the moment its script begins; ``streamed``: 1 where a companion flew."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file)
        names = next(rows)
        keep = [i for i, name in enumerate(names) if name not in ("phase", "hand")]
        started = names.index("script_s")
        flown_rows = [row for row in rows if len(row) == len(names) and float(row[started]) >= 0.0]
    values = [[float(row[i]) for i in keep] for row in flown_rows]
    streamed = [float(row[names.index("hand")] == "stream") for row in flown_rows]
    table = np.array(values).reshape(len(values), len(keep))
    columns = {names[i]: table[:, k] for k, i in enumerate(keep)}
    columns["streamed"] = np.array(streamed)
    return columns


def flown(leg: Leg, seed: int, truth: dict[str, Array], surrogate_error: dict[str, float]) -> Flown:
    """Errors of one flight from its truth."""
    script = truth["script_s"]
    if len(script) < 10 or script[-1] < SETTLE_S[1]:
        raise LinkError(f"simulated flight '{leg.value}', seed {seed}: the script did not run")
    if leg is not Leg.AUTOPILOT and (share := float(np.mean(truth["streamed"]))) < 0.98:
        raise LinkError(
            f"simulated flight '{leg.value}', seed {seed}: the companion flew only {100 * share:.0f} % of it"
        )
    grid = np.arange(0.0, script[-1], STEP_S)

    def on_grid(values: Array) -> Array:
        return np.interp(grid, script, values)

    settled = (grid >= SETTLE_S[0]) & (grid <= SETTLE_S[1])

    def position(axis: str) -> Array:
        error = on_grid(truth[axis] - truth[f"ref_{axis}"])
        return np.asarray(error - np.mean(error[settled]))

    return Flown(
        leg=leg,
        seed=seed,
        time_s=grid,
        height=-position("d"),
        lateral=np.column_stack([position("n"), position("e")]),
        tilt=np.column_stack([on_grid(truth[a] - truth[f"need_{a}"]) for a in ("roll", "pitch")]),
        touched_s=float(np.sum(truth["contact"]) * STEP_S),
        surrogate_error=surrogate_error,
    )


@dataclass(frozen=True)
class Settings:
    """What every leg of a comparison shares."""

    scenario: str = "corner"
    vehicle: Path | None = None
    model: str | None = None


def fly(settings: Settings, leg: Leg, seed: int) -> Flown:
    """Fly one leg in lockstep and judge it: the same numbers on every machine, however busy."""
    vehicle = default_vehicle() if settings.vehicle is None else load_vehicle(settings.vehicle)
    scenario = build(settings.scenario, vehicle, air=leg is not Leg.FREE)
    flight = Flight(vehicle, scenario, seed)
    hand = Hand.AUTOPILOT if leg is Leg.AUTOPILOT else Hand.COMPANION
    config = None
    if leg is not Leg.AUTOPILOT:
        config = PipelineConfig(vehicle, choose_to_fly(vehicle, settings.model).model, offsets=leg is Leg.ON)
    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.csv"
        Lockstep(flight, lambda world: ScriptedPilot(world.flight, world.link, hand, endless=False), truth).fly(config)
        return flown(leg, seed, read_truth(truth), vars(surrogate_error(flight.body.law)))


def run_compare(
    seeds: Sequence[int],
    settings: Settings | None = None,
    *,
    legs: Sequence[Leg] = (Leg.AUTOPILOT, Leg.OFF, Leg.ON, Leg.FREE),
    workers: int | None = None,
    quiet: bool = True,
) -> list[Flown]:
    """Fly every leg with every seed; ``workers`` of them at a time (default: one a core). Ordered by seed, then leg."""
    settings = settings or Settings()
    workers = workers or os.cpu_count() or 1
    jobs = [(leg, seed) for seed in seeds for leg in legs]
    if workers == 1 or len(jobs) == 1:
        results = (fly(settings, *job) for job in jobs)
        return list(_watched(results, len(jobs), quiet))
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(jobs)), mp_context=fresh, initializer=_leave_quietly) as pool:
        pending = pool.map(fly, repeat(settings), *zip(*jobs, strict=True))
        try:
            return list(_watched(pending, len(jobs), quiet))
        except KeyboardInterrupt:
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise


def _leave_quietly() -> None:
    """Ctrl-C reaches every process of the terminal: a worker ends without a word, the command says what there is."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _watched(flights: Iterable[Flown], total: int, quiet: bool) -> Iterator[Flown]:
    hidden = quiet or not sys.stderr.isatty()
    yield from tqdm(flights, total=total, desc="flights", file=sys.stderr, disable=hidden)


# -- tables ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation over the seeds."""

    mean: float
    sd: float

    @staticmethod
    def of(values: Sequence[float]) -> Spread:
        """From one value per seed."""
        finite = [v for v in values if math.isfinite(v)]
        if not finite:
            return Spread(math.nan, math.nan)
        return Spread(float(np.mean(finite)), float(np.std(finite, ddof=1)) if len(finite) > 1 else 0.0)


@dataclass(frozen=True)
class AirPart:
    """How much of the air-caused error the offsets remove, per axis.

    ``energy`` = 1 - (E2_on - E2_free) / (E2_off - E2_free), with E2 summed over the seeds: the trajectory's own error
    cancels on average only, so that it scatters where the air adds little. ``paired`` = 1 - sum |e_on - e_free|^2 /
    sum |e_off - e_free|^2, instant by instant on flights that share their noise: the same question, less scatter.
    """

    energy: dict[str, float]
    paired: dict[str, float]


def air_part(flights: Sequence[Flown]) -> AirPart | None:
    """Over all seeds that flew OFF, ON and FREE; None where none did."""
    seeds = sorted({f.seed for f in flights})
    energy = {axis: np.zeros(3) for axis in AXES}
    paired = {axis: np.zeros(2) for axis in AXES}
    used = 0
    for seed in seeds:
        by = {f.leg: f for f in flights if f.seed == seed}
        if not {Leg.OFF, Leg.ON, Leg.FREE} <= set(by):
            continue
        used += 1
        off, on, free = by[Leg.OFF], by[Leg.ON], by[Leg.FREE]
        n = min(len(off.time_s), len(on.time_s), len(free.time_s))
        for axis in AXES:
            energy[axis] += [f.rms(axis) ** 2 for f in (off, on, free)]
            a, b, c = (getattr(f, axis)[:n] for f in (off, on, free))
            paired[axis] += [float(np.sum((a - c) ** 2)), float(np.sum((b - c) ** 2))]
    if not used:
        return None
    return AirPart(
        energy={a: float(1.0 - (e[1] - e[2]) / (e[0] - e[2])) if e[0] > e[2] else math.nan for a, e in energy.items()},
        paired={a: float(1.0 - p[1] / p[0]) if p[0] > 0.0 else math.nan for a, p in paired.items()},
    )


def as_json(flights: Sequence[Flown], settings: Settings) -> dict[str, Any]:
    """Everything the tables show, as JSON: RMS and peak per leg and axis, mean and sd over the seeds."""
    part = air_part(flights)
    legs = [leg for leg in Leg if any(f.leg is leg for f in flights)]
    return {
        "scenario": settings.scenario,
        "simulated": True,
        "lockstep": True,
        "seeds": sorted({f.seed for f in flights}),
        "units": UNITS,
        "legs": {
            leg.name.lower(): {
                "who": leg.value,
                "touched_s": Spread.of([f.touched_s for f in flights if f.leg is leg]).mean,
                **{
                    axis: {
                        name: vars(Spread.of([getattr(f, name)(axis) for f in flights if f.leg is leg]))
                        for name in ("rms", "peak")
                    }
                    for axis in AXES
                },
            }
            for leg in legs
        },
        "air_caused_part_removed": None
        if part is None
        else {
            name: {a: None if math.isnan(v) else round(v, 4) for a, v in values.items()}
            for name, values in (("energy", part.energy), ("paired", part.paired))
        },
        "surrogate_error": _surrogate_error(flights),
        "flights": [
            {
                "seed": f.seed,
                "leg": f.leg.name.lower(),
                "touched_s": round(f.touched_s, 2),
                **{axis: {"rms": round(f.rms(axis), 3), "peak": round(f.peak(axis), 3)} for axis in AXES},
            }
            for f in flights
        ],
    }


def _surrogate_error(flights: Sequence[Flown]) -> dict[str, float]:
    by_seed = {f.seed: f.surrogate_error for f in flights}
    return {axis: float(np.mean([e[axis] for e in by_seed.values()])) for axis in ("lift", "pull", "tilt")}


def as_text(flights: Sequence[Flown], settings: Settings) -> str:
    """The table that a user reads."""
    seeds = sorted({f.seed for f in flights})
    wrong = _surrogate_error(flights)
    wide = len(seeds) > 1
    lines = [
        f"sim:{settings.scenario}, simulated, {flights[0].time_s[-1]:.0f} s approach, "
        + (f"{len(seeds)} seeds, mean ± sd" if wide else f"seed {seeds[0]}")
        + "; errors against the truth",
        f"the model's law is wrong about this air by {100 * wrong['lift']:.0f} % in lift, "
        f"{100 * wrong['pull']:.0f} % in pull, {100 * wrong['tilt']:.0f} % in tilt",
        "",
        f"{'':24}" + "".join(f"{axis + ' [' + UNITS[axis] + ']':>{26 if wide else 18}}" for axis in AXES),
        f"{'':24}" + "".join(f"{'RMS':>{13 if wide else 9}}{'peak':>{13 if wide else 9}}" for _ in AXES) + "  touched",
    ]
    for leg in Leg:
        of_leg = [f for f in flights if f.leg is leg]
        if of_leg:
            lines.append(_leg_line(leg, of_leg, wide))
    part = air_part(flights)
    if part is not None:
        lines += ["", "of the error that the air causes, the offsets remove"]
        lines += [_part_line("by energy", part.energy), _part_line("instant by instant", part.paired)]
    return "\n".join(lines)


def _leg_line(leg: Leg, flights: Sequence[Flown], wide: bool) -> str:
    cells = ""
    for axis in AXES:
        digits = 2 if axis == "tilt" else 0 if wide else 1
        for name in ("rms", "peak"):
            s = Spread.of([getattr(f, name)(axis) for f in flights])
            cell = f"{s.mean:.{digits}f} ± {s.sd:.{digits}f}" if wide else f"{s.mean:.{digits}f}"
            cells += f"{cell:>{13 if wide else 9}}"
    touched = Spread.of([f.touched_s for f in flights]).mean
    return f"{leg.value:24}{cells}{f'{touched:.1f} s' if touched > 0.05 else '-':>9}"


def _part_line(name: str, shares: Mapping[str, float]) -> str:
    cells = "".join(f"{axis} {100 * v:.0f} %   " if math.isfinite(v) else f"{axis} -   " for axis, v in shares.items())
    return f"  {name:20}{cells}".rstrip()


def main(
    scenario: str,
    *,
    seed: int = 0,
    vehicle: Path | None = None,
    model: str | None = None,
    json_path: str | None = None,
    quiet: bool = False,
) -> int:
    """``companion --connect sim:NAME --compare``: three flights and the table."""
    if scenario not in NAMES:
        raise ConfigError(f"sim:{scenario}: no such scenario; choose one of {', '.join(NAMES)}")
    settings = Settings(scenario=scenario, vehicle=vehicle, model=model)
    flights = run_compare([seed], settings, legs=(Leg.AUTOPILOT, Leg.OFF, Leg.ON), quiet=quiet)
    return write(flights, settings, json_path)


def write(flights: Sequence[Flown], settings: Settings, json_path: str | None) -> int:
    """Print the table, or the JSON (``-`` for stdout)."""
    text = json.dumps(as_json(flights, settings), indent=2)
    if json_path == "-":
        print(text)
        return 0
    print(as_text(flights, settings))
    if json_path is not None:
        try:
            Path(json_path).write_text(text + "\n", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"--json {json_path}: cannot be written ({error.strerror})") from None
    return 0
