"""How often ``replay diagnose`` names an effect where there is only noise, and beside a true effect.

``python tests/benchmarks diagnosis.diagnose_noise [--records 400] [--seconds 180] [--jobs N]``. Seeded. **Everything
here is simulated**: a made-up trajectory through free air, ground and wall with all channels, and a residual of
coloured noise (correlation times 0.3, 1 and 3 s in turn, own draw for each of the six axes) in place of the measured
one. With ``--effect``, one effect of the catalogue, twice to six times the smallest size worth a name, is added to
every one; it shares the catalogue's formula, so this measures false discoveries, not power (docs/lab/diagnose-suite.md
does that).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import command_line
import numpy as np
from noise_records import noise_record
from shares import share_of

from models.common.frames import Array
from models.effects import Coefficient, Effect, catalogue
from replay.diagnosis.diagnose import conclude
from replay.residual.log_state import named_channels
from replay.residual.record import Record

TAUS_S = (0.3, 1.0, 3.0)


@dataclass(frozen=True)
class Outcome:
    """One record's answer."""

    seed: int
    tau_s: float
    verdict: str
    named: tuple[str, ...]
    true: str | None
    aliases: tuple[tuple[str, ...], ...] = ()

    @property
    def false(self) -> list[str]:
        """Names that are not the true effect."""
        return [n for n in self.named if n != self.true]

    @property
    def beyond_aliases(self) -> list[str]:
        """Those of them that do not even stand in for it: one that no single flight separates, and said so."""
        return [n for n in self.false if not any({n, self.true} <= set(a) for a in self.aliases)]


def with_effect(record: Record, seed: int) -> tuple[Record, str]:
    """The record with one effect, drawn from those that it can show in a size that they may have."""
    rng = np.random.default_rng(seed + 77)
    effects = catalogue()
    while True:
        effect = effects[int(rng.integers(len(effects)))]
        share = float(rng.uniform(0.012, 0.036))
        if effect.name == "air_density":
            # The weather tells its size: air is as thin as pressure and temperature say.
            record = _thinner(record, share)
            return replace(
                record, residual=record.residual + effect.wrench(record.context, {"gain": 1.0})
            ), effect.name
        grid = effect.shape_grid(record.context)
        if effect.lacking(record.context) is not None or not grid:
            continue
        shape = grid[int(rng.integers(len(grid)))]
        x = np.nan_to_num(effect.regressors(record.context, shape))
        coefficients = _coefficients(effect, x, share, record, rng)
        if coefficients is None:
            continue
        # An error of the accelerometer is one that velocity and attitude contradict.
        bias = record.kinematic_bias
        if effect.kinematic_bias is not None:
            bias = bias + effect.kinematic_bias(record.context, shape) @ coefficients
        return replace(
            record, residual=record.residual + x @ coefficients, kinematic_bias=bias
        ), effect.name


def _coefficients(
    effect: Effect, x: Array, share: float, record: Record, rng: np.random.Generator
) -> Array | None:
    """Coefficients with which an effect is a share of the weight; None where it may not have them."""
    centre = np.array([_centre(effect, c, record, rng) for c in effect.coefficients])
    vehicle = record.context.vehicle
    lever = max(float(np.linalg.norm(f.position_m)) for f in vehicle.fans)
    limits = vehicle.mass_kg * 9.80665 * np.array([1.0, 1.0, 1.0, lever, lever, lever])
    size = float((np.percentile(np.abs(x @ centre), 95, axis=0) / limits).max())
    if size < 1e-9:
        return None
    out: Array = share / size * centre
    return (
        out
        if all(
            c.least(record.context) <= v <= c.most(record.context)
            for c, v in zip(effect.coefficients, out, strict=True)
        )
        else None
    )


def _thinner(record: Record, share: float) -> Record:
    """The same flight in air that is thinner by a share."""
    context = record.context
    state = replace(context.state, pressure_pa=context.state.pressure_pa * (1.0 - share))
    channels = named_channels(context.vehicle, state)
    return replace(record, context=replace(context, state=state), channels=channels)


def _centre(
    effect: Effect, coefficient: Coefficient, record: Record, rng: np.random.Generator
) -> float:
    """A coefficient before scaling: what makes the effect what it is, by a sign it may have; no side terms."""
    if effect.main and coefficient.name not in effect.main:
        return 0.0
    low = coefficient.least(record.context)
    high = coefficient.most(record.context)
    if low > 0.0:
        return low
    wide = high if high > -low else low
    return 0.5 * wide * (float(rng.choice((-1.0, 1.0))) if low < 0.0 < high else 1.0)


def one(job: tuple[int, float, bool]) -> Outcome:
    """Diagnose one record."""
    seed, seconds, add = job
    tau = TAUS_S[seed % len(TAUS_S)]
    record = noise_record(seed, seconds, tau)
    true = None
    if add:
        record, true = with_effect(record, seed)
    answer = conclude([record])
    named = tuple(n.effect.name for n in answer.found)
    return Outcome(seed, tau, answer.verdict, named, true, tuple(tuple(a) for a in answer.aliases))


def said(rows: Sequence[Outcome], *, effect: bool) -> Iterator[str]:
    """Shares of some records."""

    def share(hits: int, of: int) -> str:
        return share_of(hits, of, digits=1)

    wrong = sum(bool(o.false) for o in rows)
    yield f"flights with a false effect {share(wrong, len(rows))}"
    if not effect:
        silent = sum(o.verdict != "nothing_missing" for o in rows)
        yield f"not answered nothing_missing {share(silent, len(rows))}"
        return
    named = sum(len(o.named) for o in rows)
    false = sum(len(o.false) for o in rows)
    beyond = sum(len(o.beyond_aliases) for o in rows)
    true = sum(o.true in o.named for o in rows)
    yield f"false among the named {share(false, named)}"
    yield f"of them, not an alias that was said {share(beyond, named)}"
    yield f"true effect named {share(true, len(rows))}"


def main() -> int:
    p = command_line.parser(__doc__)
    p.add_argument("--records", type=int, default=400)
    p.add_argument("--seconds", type=float, default=180.0)
    p.add_argument("--first-seed", type=int, default=0)
    p.add_argument("--jobs", type=int, default=1)
    p.add_argument("--effect", action="store_true", help="add one true effect to every record")
    p.add_argument("--json", type=Path)
    a = p.parse_args()
    jobs = [(a.first_seed + i, a.seconds, a.effect) for i in range(a.records)]
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(a.jobs) as pool:
        for outcome in pool.map(one, jobs):
            outcomes.append(outcome)
            if outcome.named or outcome.verdict != "nothing_missing":
                print(outcome, flush=True)
    for tau in (*TAUS_S, None):
        label = "all" if tau is None else f"tau {tau:g} s"
        rows = [o for o in outcomes if tau in (None, o.tau_s)]
        for text in said(rows, effect=a.effect):
            print(f"{label:10s} {text}")
            label = ""
    if a.json:
        a.json.write_text(json.dumps([o.__dict__ for o in outcomes], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
