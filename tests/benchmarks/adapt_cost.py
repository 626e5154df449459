"""What adaptation costs a decision: one recorded flight through ``step``, with and without, side by side.

``python tests/benchmarks/adapt_cost.py [LOG.tlog] [--rounds N]``: without a log, a simulated corner is flown first. The
two are run in turns, so that a busy machine slows both; the ratio is what to compare between machines.
"""

from __future__ import annotations

import argparse
import gc
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np
from adapt_flights import fly

import models
from companion.adaptation.options import Adapt
from companion.config import PipelineConfig
from companion.mavlink.frames import cut
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Sample
from companion.pipeline import initial_state, step
from companion.sim.flight import Flight
from companion.sim.scenario import build
from companion.vehicles import default_vehicle
from replay.logs.tlog import read_tlog


def samples_of(log: Path) -> list[Sample]:
    """Everything that the pipeline hears."""
    intake, out = Intake(None), []
    for arrival_us, raw in read_tlog(log).frames():
        frame = cut(raw, 0)
        sample = intake.sample(frame, arrival_us) if frame.id in LAYOUTS else None
        if sample is not None:
            out.append(sample)
    return out


def timed(samples: list[Sample], config: PipelineConfig) -> tuple[float, int]:
    """CPU seconds, and decisions."""
    state, decisions = initial_state(config), 0
    gc.collect()
    gc.disable()
    start = time.process_time()
    for sample in samples:
        state, decision = step(state, sample, config)
        decisions += decision is not None
    spent = time.process_time() - start
    gc.enable()
    return spent, decisions


def grown_bytes(samples: list[Sample], config: PipelineConfig) -> int:
    """What memory the second half of a flight keeps beyond the first."""
    half, state = len(samples) // 2, initial_state(config)
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
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("log", nargs="?", type=Path)
    p.add_argument("--rounds", type=int, default=5)
    a = p.parse_args()
    vehicle = default_vehicle()
    off, full = (PipelineConfig(vehicle, models.load(), adapt=mode) for mode in (Adapt.OFF, Adapt.FULL))
    with tempfile.TemporaryDirectory() as folder:
        log = a.log
        if log is None:
            log = Path(folder) / "corner.tlog"
            fly(Flight(vehicle, build("corner", vehicle), 1), off, 75.0, record=log)
        samples = samples_of(log)
    pairs = []
    for _ in range(a.rounds):
        (without, decisions), (with_it, _) = timed(samples, off), timed(samples, full)
        pairs.append((without / decisions, with_it / decisions))
    best = np.array(pairs).min(axis=0) * 1e6
    print(
        f"{len(samples)} samples, {decisions} decisions, {a.rounds} rounds in turns, CPU time: "
        f"{best[0]:.0f} us a decision without, {best[1]:.0f} us with: {best[1] - best[0]:.0f} us more, "
        f"ratio {best[1] / best[0]:.2f} (median of rounds {np.median([b / x for x, b in pairs]):.2f})"
    )
    print(
        f"memory kept over the second half: {grown_bytes(samples, off)} B without, {grown_bytes(samples, full)} B with"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
