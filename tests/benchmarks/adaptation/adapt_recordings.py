"""What would have been learned from recorded flights, and how well it predicts the next ten seconds.

``python tests/benchmarks adaptation.adapt_recordings [--data DIR] [--diagnose]``. The flights are not part of the
project: they are looked for in ``../shared/data`` (or ``$CORNER_SHARED/data``, or ``--data``) and left out where they
are not there. For every flight the sizes at its end, and the RMS of measured minus modelled force and moment over the
ten seconds after each block, as modelled and with the sizes as they were known at that block. ``--diagnose`` adds what
``replay diagnose`` says of the whole flight.
"""

from __future__ import annotations

import json
import os
import sys
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from tqdm import tqdm

from companion.adapt_options import Adapt
from companion.adaptation import learn as learning
from companion.adaptation.adaptation import Adaptation
from companion.adaptation.residual import BlockResidual
from companion.config import PipelineConfig
from companion.state.decision import Decision
from models.choice import NONE, choose
from models.common.errors import UserError
from models.vehicle import load_vehicle
from replay.rerun.report import play

ROOT = Path(__file__).resolve().parents[3]
DATA = Path(os.environ.get("CORNER_SHARED", ROOT.parent / "shared")) / "data"
AHEAD_S = 10.0
SHOWN = ("thrust_scale", "wind_north", "wind_east", "rotor_drag", "vertical_inflow")
FLIGHTS = (
    ("firmware/ardupilot/quad3.toml", "firmware/ardupilot/approach_offsets_off.tlog"),
    ("firmware/ardupilot/quad3.toml", "firmware/ardupilot/approach_amended_model.tlog"),
    ("firmware/px4/quad.toml", "firmware/px4/corner_offsets_off.tlog"),
    ("ardupilot/s1_quad3_ground_wall_corner.toml", "ardupilot/s1_quad3_ground_wall_corner.tlog"),
    (
        "ardupilot/s4_quad3_attitude_target_corner.toml",
        "ardupilot/s4_quad3_attitude_target_corner.tlog",
    ),
    ("measured/neural-fly.toml", "measured/nf_baseline_nowind.tlog"),
    ("measured/neural-fly.toml", "measured/nf_baseline_35wind.tlog"),
    ("measured/neural-fly.toml", "measured/nf_baseline_70p20sint.tlog"),
    ("measured/crazyflie-large.toml", "measured/ns_2019L_ground_cf101_01.tlog"),
    ("measured/crazyflie-large.toml", "measured/ns_2020L_ground_cf102_01.tlog"),
    ("measured/crazyflie-small.toml", "measured/ns_2020S_ground_cf50_00.tlog"),
    ("measured/crazyflie-small.toml", "measured/ns_2020S_ground_cf50_05.tlog"),
)
"""Vehicle file and recording. All are flown with ``--model none``: no surrogate of these fans is shipped."""


@dataclass(frozen=True)
class Learned:
    """One flight: sizes at its end, and the prediction, each RMS (5,) by axis in N and N m."""

    log: str
    known: Adaptation
    as_modelled: Any
    with_sizes: Any
    duration_s: float

    @property
    def gained(self) -> tuple[float, float]:
        """Share of the RMS that the sizes take away: of forces, of moments; NaN where they are not judged."""
        left = self.with_sizes**2, self.as_modelled**2
        forces, moments = (
            1.0 - float(np.sqrt(left[0][a].sum() / left[1][a].sum()))
            for a in (slice(3), slice(3, 5))
        )
        return forces, moments


def learn(vehicle_file: Path, log: Path, model: str = NONE) -> Learned:
    """Replay one log with adaptation, and look at what it saw. Raises UserError where it cannot be read."""
    vehicle = load_vehicle(vehicle_file)
    config = PipelineConfig(
        vehicle=vehicle, model=choose(vehicle, model).model, dry_run=True, adapt=Adapt.FULL
    )
    seen: deque[BlockResidual] = deque(maxlen=1)
    inner = learning.residual_of.block_residual

    def block_residual(*args: Any) -> BlockResidual:
        seen.append(inner(*args))
        return seen[-1]

    learning.residual_of.block_residual = block_residual  # type: ignore[assignment]
    blocks: list[tuple[float, BlockResidual, Any]] = []
    known: Adaptation | None = None
    try:
        for decision in decisions(log, config):
            fresh = decision.adaptation
            if fresh is not None and (known is None or fresh.learned_s != known.learned_s) and seen:
                blocks.append((decision.t_s, seen[-1], fresh.sizes.offset))
            known = fresh or known
    finally:
        learning.residual_of.block_residual = inner
    assert known is not None
    as_modelled, with_sizes = predicted(blocks)
    return Learned(log.name, known, as_modelled, with_sizes, known.learned_s)


def decisions(log: Path, config: PipelineConfig) -> Iterator[Decision]:
    """As ``replay run``."""
    return play(log, config, None, {"GUID_OPTIONS": 8.0}, quiet=True).decisions


def predicted(blocks: list[tuple[float, BlockResidual, Any]]) -> tuple[Any, Any]:
    """RMS (5,) of the residual over the ten seconds after each block, without and with its sizes."""
    plain = []
    better = []
    for k, (t, _, offset) in enumerate(blocks):
        for later_s, seen, _ in blocks[k + 1 :]:
            if later_s > t + AHEAD_S:
                break
            plain.append(seen.residual**2)
            better.append((seen.residual - seen.regressors @ offset) ** 2)
    if not plain:
        return np.full(5, np.nan), np.full(5, np.nan)
    return np.sqrt(np.mean(plain, axis=0)), np.sqrt(np.mean(better, axis=0))


def diagnosed(vehicle_file: Path, log: Path) -> dict[str, Any]:
    """Effects of the whole flight by ``replay diagnose --model none``."""
    from replay.diagnosis.diagnose import diagnose

    answer = diagnose([log], load_vehicle(vehicle_file), None).as_json(None)
    return {
        e["name"]: {name: round(p["value"], 3) for name, p in e["parameters"].items()} for e in answer["effects"]
    }  # fmt: skip


def main() -> int:
    """Learn and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--data", type=Path, default=DATA, metavar="DIR")
    p.add_argument("--only", default="", metavar="TEXT", help="only logs whose path holds this")
    p.add_argument("--diagnose", action="store_true")
    p.add_argument("--json", type=Path, metavar="FILE")
    a = p.parse_args()
    told = []
    flights = [f for f in FLIGHTS if a.only in f[1]]
    for vehicle, log in tqdm(flights, file=sys.stderr, disable=not sys.stderr.isatty()):
        if not (a.data / log).exists():
            print(f"left out: {log}: not there", file=sys.stderr)
            continue
        try:
            one = learn(a.data / vehicle, a.data / log)
        except UserError as error:
            print(f"{log}: {error}")
            continue
        sizes = one.known.estimates()
        forces, moments = one.gained
        print(
            f"{Path(log).stem:34} {one.duration_s:5.0f} s  "
            + "  ".join(f"{n} {sizes[n].value:+.3f} ± {sizes[n].sd:.3f}" for n in SHOWN)
            + f"  next 10 s: forces {100 * forces:+.0f} %, moments {100 * moments:+.0f} %",
            flush=True,
        )
        whole = diagnosed(a.data / vehicle, a.data / log) if a.diagnose else {}
        if a.diagnose:
            print(f"  whole flight: {json.dumps(whole)}", flush=True)
        told.append(
            {
                "log": log,
                "sizes": one.known.as_json(),
                "forces": forces,
                "moments": moments,
                "whole": whole,
            }
        )
    if a.json is not None:
        a.json.write_text(json.dumps(told, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
