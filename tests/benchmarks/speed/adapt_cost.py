"""What adaptation and adopted effects cost a decision: one recorded flight through ``step``, side by side.

``python tests/benchmarks speed.adapt_cost [LOG.tlog] [--rounds N]``: without a log, a simulated corner is flown first.
The three are run in turns, and of every few samples the quickest round counts, so that a busy machine disturbs little;
the ratio is what to compare between machines. The amended model has four effects, as one diagnosed flight gives.
"""

from __future__ import annotations

import gc
import tempfile
import time
import tracemalloc
from pathlib import Path

import command_line
import numpy as np
from adapt_flights import fly
from simulated import simulated

import models
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Sample
from companion.mavlink.wire_frames import cut
from companion.pipeline import initial_state, step
from companion.sim.scenario import build
from companion.vehicles import default_vehicle
from models.common.frames import Array
from models.effects.adopted_effect import AdoptedEffect
from replay.logs.tlog import read_tlog

CHUNK = 10
ADOPTED = (
    AdoptedEffect("thrust_scale", {"scale": 0.02}),
    AdoptedEffect(
        "vertical_inflow",
        {"slope": 4.8, "turning": 15.0, "north": 0.0, "east": 0.0, "level": 0.15},
    ),
    AdoptedEffect("ground_effect", {"gain": 0.05, "length_radii": 2.0}),
    AdoptedEffect("wall_effect", {"pull": 0.12, "tilt": 0.05, "lift": 0.0, "length_radii": 1.1}),
)


def samples_of(log: Path) -> list[Sample]:
    """Everything that the pipeline hears."""
    intake = Intake(None)
    out = []
    for arrival_us, raw in read_tlog(log).frames():
        frame = cut(raw, 0)
        sample = intake.sample(frame, arrival_us) if frame.id in LAYOUTS else None
        if sample is not None:
            out.append(sample)
    return out


def timed(samples: list[Sample], config: PipelineConfig) -> tuple[Array, int]:
    """Seconds of every ``CHUNK`` samples, and decisions."""
    state = initial_state(config)
    decisions = 0
    spent = []
    gc.collect()
    gc.disable()
    for first in range(0, len(samples), CHUNK):
        start = time.perf_counter()
        for sample in samples[first : first + CHUNK]:
            state, decision = step(state, sample, config)
            decisions += decision is not None
        spent.append(time.perf_counter() - start)
    gc.enable()
    return np.array(spent), decisions


def grown_bytes(samples: list[Sample], config: PipelineConfig) -> int:
    """What memory the second half of the last minute keeps beyond the first."""
    samples = samples[-8000:]
    half = len(samples) // 2
    state = initial_state(config)
    tracemalloc.start()
    for sample in samples[:half]:
        state, _ = step(state, sample, config)
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    for sample in samples[half:]:
        state, _ = step(state, sample, config)
    gc.collect()
    after = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    return after - before


def main() -> int:
    """Measure and print."""
    p = command_line.parser(__doc__)
    p.add_argument("log", nargs="?", type=Path)
    p.add_argument("--rounds", type=int, default=5)
    p.add_argument(
        "--samples", type=int, default=10**9, metavar="N", help="only the last N of the flight"
    )
    a = p.parse_args()
    vehicle = default_vehicle()
    plain = models.load()
    amended = plain.with_effects(ADOPTED)
    off = PipelineConfig(vehicle=vehicle, model=plain, adapt=Adapt.OFF)
    full = PipelineConfig(vehicle=vehicle, model=plain, adapt=Adapt.FULL)
    with_effects = PipelineConfig(vehicle=vehicle, model=amended, adapt=Adapt.FULL)
    configs = (off, full, with_effects)
    with tempfile.TemporaryDirectory() as folder:
        log = a.log
        if log is None:
            log = Path(folder) / "corner.tlog"
            fly(simulated(vehicle, build("corner", vehicle), 1), off, 75.0, record=log)
        samples = samples_of(log)[-a.samples :]
    best = [np.full(-(-len(samples) // CHUNK), np.inf)] * len(configs)
    decisions = 1
    for _ in range(a.rounds):
        for k, config in enumerate(configs):
            spent, decisions = timed(samples, config)
            best[k] = np.minimum(best[k], spent)
    without, with_it, with_more = (1e6 * float(b.sum()) / decisions for b in best)
    print(
        f"{len(samples)} samples, {decisions} decisions, the best of {a.rounds} rounds for every {CHUNK} "
        f"samples: {without:.0f} us a decision without, {with_it:.0f} us with: {with_it - without:.0f} us more, "
        f"ratio {with_it / without:.2f}"
    )
    print(
        f"with {len(ADOPTED)} adopted effects too: {with_more:.0f} us, ratio {with_more / without:.2f}"
    )
    print(
        f"memory kept over the second half: {grown_bytes(samples, off)} B without, {grown_bytes(samples, full)} B with"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
