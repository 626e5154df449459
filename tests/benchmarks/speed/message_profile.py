"""What one message costs in flight: microseconds of decoding and of ``step``, by kind, on a recorded flight.

    python tests/benchmarks speed.message_profile LOG.tlog [--vehicle FILE.toml] [--rounds 3] [--asleep 0.01] [--adapt]

What follows a setpoint (``settle``) is a row of its own, and so is a message that asks the model. ``--asleep`` sleeps
for so long [s] before every attitude, as flight does: the processor's caches are then filled anew, which costs more
than the work itself.
No socket, no system call: the part of the work that is this program's. The rounds do the same work message by message:
of every message the least of them counts, so that a busy machine counts little. A mean by kind, so that the lines add
up. ``per second`` is what the log's own rates add up to.
"""

from __future__ import annotations

import gc
import json
import time
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import command_line
import numpy as np

import models
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.mavlink.dialect import MESSAGES
from companion.mavlink.message_filter import UNREAD, Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Parameter
from companion.mavlink.setpoints import encode
from companion.mavlink.wire_frames import cut
from companion.pipeline import answer, initial_state, step
from companion.settle import settle
from companion.vehicles import default_vehicle
from models.vehicle import load_vehicle
from replay.logs.tlog import read_tlog

Times = dict[str, list[int]]


class Round(NamedTuple):
    """One flight of the log: its length, and what every message took [ns], by kind and in order."""

    seconds: float
    decoding: Times
    stepping: Times


_ATTITUDE = (31).to_bytes(3, "little")
"""ATTITUDE_QUATERNION's id in a frame of MAVLink 2."""


def one_round(log: Path, config: PipelineConfig, asleep_s: float) -> Round:
    """Fly the log once."""
    decoding: Times = defaultdict(list)
    stepping: Times = defaultdict(list)
    intake = Intake(None, UNREAD)
    state = initial_state(config)
    clock = time.perf_counter_ns
    first = last = None
    for arrival, raw in read_tlog(log).frames():
        first, last = arrival if first is None else first, arrival
        if asleep_s and raw[7:10] == _ATTITUDE:
            time.sleep(asleep_s)
        start = clock()
        frame = cut(raw, 0)
        sample = intake.sample(frame, arrival) if frame.id in LAYOUTS else None
        decoded = clock()
        name = MESSAGES[frame.id].msgname
        decoding[name].append(decoded - start)
        if sample is None:
            continue
        start = clock()
        known = state.air.disturbance
        state, decision = answer(state, sample, config)
        if state.air.disturbance is not known:
            name += ", asking the model"
        if decision is not None and decision.command is not None:
            encode(decision.command, 1)
            name += ", with a setpoint"
        answered = clock()
        state = settle(state, sample, decision, config)
        stepping[name].append(answered - start)
        if sample is state.estimates.attitude:
            stepping[f"{name.split(',')[0]}, once answered"].append(clock() - answered)
        if name == "HEARTBEAT" and "GUID_OPTIONS" not in state.heard.parameters:
            told = Parameter(sample.t_s, sample.system, sample.component, "GUID_OPTIONS", 8.0)
            state, _ = step(state, told, config)
    seconds = 0.0 if first is None or last is None else (last - first) / 1e6
    return Round(seconds, decoding, stepping)


def profile(
    log: Path, config: PipelineConfig, rounds: int = 3, asleep_s: float = 0.0
) -> dict[str, dict[str, float]]:
    """Messages a second and microseconds by kind, the most costly first."""
    # As flight does: what was loaded stays, and the collector need not look at it.
    gc.collect()
    gc.freeze()
    flown = [one_round(log, config, asleep_s) for _ in range(rounds)]
    decoding = _least_us([one.decoding for one in flown])
    stepping = _least_us([one.stepping for one in flown])
    counts = {**flown[0].decoding, **flown[0].stepping}
    rows = {}
    for name, times in counts.items():
        of_kind = 0.0 if name.endswith("answered") else decoding.get(name.split(",")[0], 0.0)
        rows[name] = {
            "per_second": len(times) / flown[0].seconds,
            "decode_us": of_kind,
            "step_us": stepping.get(name, 0.0),
        }
    return dict(sorted(rows.items(), key=lambda row: -_ms(row[1])))


def _least_us(rounds: list[Times]) -> dict[str, float]:
    """By kind the mean over its messages [us], of every message the least of the rounds."""
    least = {}
    for name in rounds[0]:
        of_messages = np.min([one[name] for one in rounds], axis=0)
        least[name] = float(of_messages.mean()) / 1e3
    return least


def _ms(row: dict[str, float]) -> float:
    """Milliseconds a second."""
    return row["per_second"] * (row["decode_us"] + row["step_us"]) / 1e3


def print_profile(rows: dict[str, dict[str, float]]) -> None:
    """A line a kind, without those that cost nothing."""
    print(f"{'message':<44}{'per second':>11}{'decode us':>11}{'step us':>9}{'ms/s':>7}")
    for name, row in rows.items():
        ms = _ms(row)
        if ms >= 0.01:
            numbers = f"{row['per_second']:>11.1f}{row['decode_us']:>11.1f}{row['step_us']:>9.1f}"
            print(f"{name:<44}{numbers}{ms:>7.2f}")
    total = sum(map(_ms, rows.values()))
    print(f"{'all':<44}{'':>31}{total:>7.2f}")
    print(f"decoding and step: {1e3 / total:.0f} x real time")


def main() -> None:
    p = command_line.parser(__doc__)
    p.add_argument("log", type=Path)
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--asleep", type=float, default=0.0, metavar="SECONDS")
    p.add_argument("--adapt", action="store_true", help="with adaptation")
    p.add_argument("--json", type=Path, metavar="FILE")
    a = p.parse_args()
    vehicle = default_vehicle() if a.vehicle is None else load_vehicle(a.vehicle)
    adapt = Adapt.FULL if a.adapt else Adapt.OFF
    config = PipelineConfig(vehicle=vehicle, model=models.load(), adapt=adapt)
    rows = profile(a.log, config, a.rounds, a.asleep)
    print_profile(rows)
    if a.json is not None:
        a.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
