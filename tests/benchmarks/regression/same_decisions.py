"""Whether the pipeline still decides the same on every recorded flight of a folder.

    python tests/benchmarks regression.same_decisions FOLDER --out BEFORE.npz    # every number of every decision
    python tests/benchmarks regression.same_decisions FOLDER --against BEFORE.npz    # exit code 1 where one differs

Run the first in one checkout and the second in another. Every log is flown by the hold with setpoints switched on; with
sizes measured on the way; with an upstream controller where the log holds one's setpoints; and with adopted effects
where its name tells of a ceiling.
Prints for each log whether all decisions are equal to the last bit, else the largest difference as a share of the
number (of 1 where the number is smaller; bytes of an encoded setpoint are numbers too), and that of the offsets.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import command_line
import numpy as np
from tqdm import tqdm

import models
from companion.adapt_options import Adapt
from companion.config import Base, PipelineConfig
from companion.control.reasons import Reason
from companion.mavlink.samples import Sample
from companion.mavlink.setpoints import encode
from companion.state.decision import Decision
from companion.vehicles import default_vehicle
from models.common.errors import UserError
from models.effects.adopted_effect import AdoptedEffect
from models.vehicle import load_vehicle
from regression.same_answers import vehicle_of
from replay.logs.formats import READERS, load, suffix_of
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay
from replay.rerun.log_samples import samples

_CLOSE = 1e-9
_THRUST = 3
_TILTS = (4, 5)
"""Places of the offset in ``numbers``."""
_GAINS = (
    "position_1_s", "velocity_1_s", "integral_1_s2", "height_1_s", "climb_1_s", "climb_integral_1_s2", "tilt_lead_s",
)  # fmt: skip
"""Of the hold."""
_CEILING = (
    AdoptedEffect("ceiling", {"gain": 1.0, "scale": 1.0}),
    AdoptedEffect("thrust_scale", {"scale": 0.05}),
)


def numbers(decision: Decision) -> list[float]:
    """Everything that a decision says, as numbers; NaN where it says nothing."""
    out = [decision.t_s, decision.authority, decision.late_s, *_flat(decision.offset)]
    out += [float(list(Reason).index(reason)) for reason in decision.reasons]
    out += list(encode(decision.command, 1)[1]) if decision.command is not None else [-1.0]
    for part in (decision.command, decision.base):
        out += [np.nan] if part is None else _flat(part)
    tuned = decision.tuned
    if tuned is not None:
        out += [*_flat(tuned.margin), tuned.share, tuned.climb_share, *_flat(tuned.loop)]
        out += [getattr(tuned.gains, name) for name in _GAINS]
    known = decision.adaptation
    if known is not None:
        near = known.applied.near
        out += [
            *known.applied.shares,
            near.ground,
            *near.lift,
            *near.pull,
            *near.tilt,
            *known.sizes.offset.tolist(),
        ]
    d = decision.disturbance
    if d is None:
        return [*out, np.nan]
    surfaces = [
        v
        for s in (d.ground, d.wall, d.ceiling)
        for v in (s.distance_m, s.rate_m_s, s.sigma_m, s.stepped_s)
    ]
    values = [d.wrench, d.free_lift_n, d.trust, d.gain, d.h_m, d.d_m, *surfaces]
    return [*out, *np.concatenate([np.ravel(v) for v in values]).tolist()]


def _flat(record: object) -> list[float]:
    """All numbers in a dataclass or a named tuple, depth first."""
    out: list[float] = []
    for name in _names(record):
        value = getattr(record, name)
        if dataclasses.is_dataclass(value) or hasattr(value, "_fields"):
            out += _flat(value)
        elif not isinstance(value, bool | str) and np.asarray(value).dtype.kind in "fiu":
            out += np.ravel(value).astype(float).tolist()
    return out


def _names(record: object) -> tuple[str, ...]:
    if dataclasses.is_dataclass(record):
        return tuple(field.name for field in dataclasses.fields(record))
    return record._fields  # type: ignore[attr-defined]


def flown(log: Path, way: str) -> list[list[float]]:
    """The decisions on one log."""
    file = vehicle_of(log)
    vehicle = default_vehicle() if file is None else load_vehicle(file)
    model = models.load().with_effects(_CEILING) if way == "effects" else models.load()
    base, adapt = (
        Base.UPSTREAM if way == "upstream" else Base.HOLD,
        Adapt.FULL if way == "adapt" else Adapt.OFF,
    )
    config = PipelineConfig(vehicle=vehicle, model=model, base=base, adapt=adapt)
    replay = Replay(config, None, {"GUID_OPTIONS": 8.0})
    if suffix_of(log) == ".tlog":
        decisions: Iterable[Decision] = replay.decisions(read_tlog(log).frames())
    else:
        decisions = replay.decisions_on(_samples(log))
    return [numbers(decision) for decision in decisions]


def _samples(log: Path) -> Iterator[Sample]:
    for one in load(log, None):
        yield from samples(one)


def job(work: tuple[Path, str]) -> tuple[np.ndarray, np.ndarray] | None:
    """(all numbers in a row, how many each decision has), or None where a log cannot be flown that way."""
    try:
        rows = flown(*work)
    except UserError:
        return None
    return np.array([v for row in rows for v in row]), np.array([len(row) for row in rows])


def ways(log: Path) -> list[str]:
    """How a log is flown."""
    upstream = log.suffix == ".tlog" and read_tlog(log).indices(82).size > 0
    return [
        "hold",
        "adapt",
        *(["upstream"] if upstream else []),
        *(["effects"] if "ceiling" in log.stem else []),
    ]


def difference(new: np.ndarray, old: np.ndarray) -> float:
    """Largest difference of two rows of numbers as a share of the larger number, or of 1; inf where one is missing."""
    if new.shape != old.shape:
        return np.inf
    with np.errstate(invalid="ignore"):
        apart = np.abs(new - old) / np.maximum(1.0, np.abs(old))
    return float(
        np.max(np.where((new == old) | (np.isnan(new) & np.isnan(old)), 0.0, apart), initial=0.0)
    )


def offsets_apart(new: np.ndarray, old: np.ndarray, lengths: np.ndarray) -> tuple[float, float]:
    """Largest difference of the offsets applied: thrust as a share of full throttle, tilt [deg]."""
    first = np.cumsum(lengths) - lengths
    apart = np.abs(new - old)
    tilt = max(apart[first + place].max(initial=0.0) for place in _TILTS)
    return float(apart[first + _THRUST].max(initial=0.0)), float(np.degrees(tilt))


def main() -> int:
    p = command_line.parser(__doc__)
    p.add_argument("folder", type=Path)
    p.add_argument("--out", type=Path)
    p.add_argument("--against", type=Path)
    p.add_argument("--only", default="", help="logs with this in their path")
    p.add_argument("--jobs", type=int, default=1)
    a = p.parse_args()
    logs = sorted(
        q for q in a.folder.rglob("*") if q.suffix.lower() in READERS and a.only in str(q)
    )
    work = [(log, way) for log in logs for way in ways(log)]
    stored: dict[str, np.ndarray] = {}
    before = {} if a.against is None else np.load(a.against)
    worst = 0.0
    decisions = 0
    with ProcessPoolExecutor(a.jobs) as pool:
        for (log, way), done in zip(
            work, tqdm(pool.map(job, work), total=len(work), disable=None), strict=True
        ):
            if done is None:
                continue
            name = f"{log.relative_to(a.folder)}:{way}".replace("/", "|")
            stored[name], stored[f"{name}:rows"] = done
            decisions += len(done[1])
            if a.against is not None:
                same_rows = np.array_equal(done[1], before.get(f"{name}:rows"))
                apart = difference(done[0], before[name]) if same_rows else np.inf
                worst = max(worst, apart)
                said = "equal" if apart == 0.0 else f"{apart:.1e}"
                if 0.0 < apart < np.inf:
                    thrust, tilt = offsets_apart(done[0], before[name], done[1])
                    said += f", offsets: thrust {thrust:.1e}, tilt {tilt:.1e} deg"
                print(f"{name:<70}{len(done[1]):>7} decisions  {said}")
    if a.out is not None:
        np.savez_compressed(a.out, **stored)
    print(f"{len(stored) // 2} flights, {decisions} decisions, largest difference {worst:.1e}")
    return int(worst > _CLOSE)


if __name__ == "__main__":
    sys.exit(main())
