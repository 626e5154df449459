"""The same approach flown several ways, judged against the truth: is the offset worth having?

Legs of one seed share air, turbulence and sensor errors. Everything here is simulated.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import repeat
from pathlib import Path

from tqdm import tqdm

from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.sim.compare_plot import write_plot
from companion.sim.compare_report import LegComparison, as_json, as_text
from companion.sim.flight import SimulatedFlight
from companion.sim.flown import Flown, Leg, fly_judged
from companion.sim.model_error import model_error
from companion.sim.scenario import build
from companion.sim.sensors import Estimator
from companion.sim.world import default_model, law_of
from companion.vehicles import chosen_vehicle
from models.choice import Choice, choose_to_fly
from models.common.text_file import write_json
from models.vehicle import Vehicle

APPROACHES = 3
"""In one flight with adaptation: so that it shows what was learned in the one before."""


@dataclass(frozen=True, kw_only=True)
class CompareSettings:
    """What every leg of a comparison shares."""

    scenario: str = "corner"
    vehicle: Path | None = None
    model: str | None = None
    adapt: Adapt = Adapt.OFF
    record: Path | None = None
    """Where the leg with offsets off is recorded."""
    estimator: type[Estimator] = Estimator
    """Where the autopilot's belief of itself comes from."""
    turned_deg: float = 0.0
    """From the beam of the wall's rangefinder to the wall's normal: 0 where the vehicle faces the wall."""

    @property
    def legs(self) -> tuple[Leg, ...]:
        """What is flown."""
        return tuple(leg for leg in Leg if leg is not Leg.ADAPTED or self.adapt is Adapt.FULL)

    @property
    def approaches(self) -> int:
        """In each flight."""
        if self.adapt is Adapt.FULL:
            return APPROACHES
        return 1

    @cached_property
    def flown_vehicle(self) -> Vehicle:
        """The vehicle of ``vehicle``."""
        return chosen_vehicle(self.vehicle)

    @cached_property
    def choice(self) -> Choice:
        """The model that flies."""
        return choose_to_fly(self.flown_vehicle, self.model, default_model(self.scenario))


def fly(settings: CompareSettings, leg: Leg, seed: int) -> Flown:
    """Fly one leg in lockstep and judge it: the same numbers on every machine, however busy."""
    vehicle = settings.flown_vehicle
    several = settings.approaches > 1
    once = build(
        settings.scenario,
        vehicle,
        air=leg is not Leg.FREE,
        turned_rad=math.radians(settings.turned_deg),
    )
    config = None
    if leg is not Leg.AUTOPILOT:
        if leg is Leg.ADAPTED:
            adapt = Adapt.FULL
        else:
            adapt = Adapt.OFF
        offsets = leg in (Leg.ON, Leg.ADAPTED)
        config = PipelineConfig(
            vehicle=vehicle, model=settings.choice.model, offsets=offsets, adapt=adapt
        )
    return fly_judged(
        SimulatedFlight(
            vehicle, once.repeated(settings.approaches), seed, estimator=settings.estimator
        ),
        config,
        leg,
        approach_s=once.duration_s if several else math.inf,
        record=settings.record if leg is Leg.OFF else None,
    )


def run_compare(
    seeds: Sequence[int],
    settings: CompareSettings,
    *,
    legs: Sequence[Leg] | None = None,
    workers: int | None = None,
    quiet: bool = True,
) -> list[Flown]:
    """Fly every leg with every seed; ``workers`` of them at a time (default: one a core). Ordered by seed, then leg."""
    workers = workers or os.cpu_count() or 1
    jobs = []
    for seed in seeds:
        for leg in legs or settings.legs:
            jobs.append((leg, seed))
    hidden = quiet or not sys.stderr.isatty()
    watched = partial(tqdm, total=len(jobs), desc="flights", file=sys.stderr, disable=hidden)
    if workers == 1 or len(jobs) == 1:
        return list(watched(fly(settings, *job) for job in jobs))
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(
        min(workers, len(jobs)), mp_context=fresh, initializer=_leave_quietly
    ) as pool:
        pending = pool.map(fly, repeat(settings), *zip(*jobs, strict=True))
        try:
            return list(watched(pending))
        except KeyboardInterrupt:
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise


def _leave_quietly() -> None:
    """Ctrl-C reaches every process of the terminal: a worker ends without a word, the command says what there is."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def compare(
    seeds: Sequence[int],
    settings: CompareSettings,
    *,
    workers: int | None = None,
    quiet: bool = True,
) -> LegComparison:
    """Fly all legs with every seed."""
    model = settings.choice.model
    vehicle = settings.flown_vehicle
    scenario = settings.scenario
    errors = tuple(model_error(model, vehicle, law_of(scenario, seed)) for seed in seeds)
    flights = run_compare(seeds, settings, workers=workers, quiet=quiet)
    return LegComparison(scenario, settings.choice.name, errors, tuple(flights))


def write(found: LegComparison, *, json_path: str | None = None, plot: Path | None = None) -> None:
    """Print the table, or the JSON (``-`` for stdout); draw the picture."""
    if plot is not None:
        write_plot(plot, found)
    if json_path != "-":
        print(as_text(found))
    if json_path is not None:
        write_json(as_json(found), json_path)
