"""How often ``replay diagnose`` names an effect where there is only noise, and beside a true effect.

``python tests/benchmarks/diagnose_noise.py [--records 400] [--seconds 180] [--jobs N]``. Seeded. **Everything here is
simulated**: a made-up trajectory through free air, ground and wall with all channels, and a residual of coloured noise
(correlation times 0.3, 1 and 3 s in turn, own draw for each of the six axes) in place of the measured one. With
``--effect``, one effect of the catalogue, twice to six times the smallest size worth a name, is added to every one;
it shares the catalogue's formula, so this measures false discoveries, not power (docs/lab/diagnose-suite.md does that).
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import models
from companion.vehicles import default_vehicle
from models.air_state import blank_state
from models.common.frames import Array, quaternion_from_euler, rotation_from_quaternion
from models.effects import Coefficient, Context, Effect, catalogue
from replay.diagnosis.diagnose import conclude
from replay.residual.grid import RATE_HZ
from replay.residual.log_state import named_channels
from replay.residual.record import Record

TAUS_S = (0.3, 1.0, 3.0)
LEVEL = (0.30, 0.30, 0.45, 0.022, 0.14, 0.013)
"""RMS per axis [N, N m]: what a quiet flight of the default vehicle shows below 2 Hz."""


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


def coloured(rng: np.random.Generator, n: int, tau_s: float, step_s: float) -> Array:
    """First-order autoregressive noise (n,) of unit variance and correlation time ``tau_s``."""
    a = math.exp(-step_s / tau_s)
    out = np.empty(n)
    value = rng.standard_normal()
    kicks = rng.standard_normal(n) * math.sqrt(1.0 - a * a)
    for i in range(n):
        value = a * value + kicks[i]
        out[i] = value
    return out


def path(rng: np.random.Generator, t: Array, places: Sequence[float], speed: float) -> Array:
    """Hold a place for some seconds, move smoothly to the next: (n,)."""
    at, now, times, values = 0.0, float(rng.choice(places)), [0.0], [0.0]
    values[0] = now
    while at < t[-1]:
        at += rng.uniform(4.0, 12.0)
        times.append(at)
        values.append(now)
        then = float(rng.choice(places))
        at += max(abs(then - now) / speed, 0.5)
        times.append(at)
        values.append(then)
        now = then
    line = np.interp(t, times, values)
    width = max(int(0.8 / (t[1] - t[0])), 1)
    padded = np.pad(line, width, mode="edge")
    kernel = np.hanning(2 * width + 1)
    return np.convolve(padded, kernel / kernel.sum(), "valid")[: len(t)]


def noise_record(seed: int, seconds: float, tau_s: float) -> Record:
    """A flight whose residual is noise."""
    rng = np.random.default_rng(seed)
    vehicle, model = default_vehicle(), models.load()
    step = 1.0 / RATE_HZ
    t = 10.0 + np.arange(int(seconds / step)) * step
    n = len(t)
    height = path(rng, t, (0.25, 0.35, 0.5, 0.9, 1.4), 0.3)
    gap = path(rng, t, (0.15, 0.25, 0.4, 0.8, 1.5), 0.3)
    side = path(rng, t, (-0.5, 0.0, 0.5), 0.5)
    yaw = path(rng, t, (0.0, 0.0, 1.5, 3.0), 0.4)
    position = np.stack([-gap, side, -height], axis=1)
    velocity = np.gradient(position, step, axis=0)
    accel = np.gradient(velocity, step, axis=0)
    pitch = -accel[:, 0] / 9.8 + np.radians(0.3) * coloured(rng, n, 1.0, step)
    roll = accel[:, 1] / 9.8 + np.radians(0.3) * coloured(rng, n, 1.0, step)
    euler = zip(roll, pitch, yaw, strict=True)
    rotation = np.stack(
        [rotation_from_quaternion(quaternion_from_euler(*angles)) for angles in euler]
    )
    force = np.einsum("nji,nj->ni", rotation, accel - np.array([0.0, 0.0, 9.80665]))
    hover = 4000.0 * np.sqrt(np.linalg.norm(force, axis=1) / 9.80665)
    rotors = len(vehicle.rotors)
    rpm = hover[:, None] * (
        1.0 + 0.004 * np.stack([coloured(rng, n, 0.5, step) for _ in range(rotors)], axis=1)
    )
    servo = np.full((n, 16), np.nan)
    for channel in range(8):
        servo[:, channel] = 1500.0 + 20.0 * coloured(rng, n, 0.7, step)
    bearing = -yaw
    seen = np.abs(bearing) < 0.5
    blank = blank_state((n,), len(vehicle.fans), rotors)
    ranges = np.full((n, 6), np.inf)
    ranges[:, 0] = height
    ranges[:, 2] = np.where(seen, gap + 0.5, np.inf)
    drain = np.linspace(0.0, 1.0, n)
    state = replace(
        blank,
        time_s=t, position_ned=position, velocity_ned=velocity, rotation=rotation,
        rates=np.stack([np.gradient(a, step) for a in (roll, pitch, yaw)], axis=1),
        specific_force=force, ranges_m=ranges,
        h_m=np.stack([height - rotation[:, 2] @ np.asarray(f.position_m) for f in vehicle.fans], axis=1),
        d_m=np.where(seen[:, None], np.stack([gap] * len(vehicle.fans), axis=1), np.inf),
        wall_bearing_rad=np.where(seen, bearing, 0.0),
        rpm=rpm, servo_us=servo, thrust_command=0.5 * (hover / 4000.0) ** 2,
        battery_voltage_v=24.5 - 2.0 * drain + 0.05 * coloured(rng, n, 1.0, step),
        battery_current_a=60.0 * (hover / 4000.0) ** 3, esc_temperature_c=30.0 + 30.0 * (1.0 - np.exp(-3.0 * drain)),
        pressure_pa=np.full(n, 101325.0) + 20.0 * coloured(rng, n, 20.0, step), air_temperature_c=np.full(n, 15.0),
    )  # fmt: skip
    residual = np.stack([s * coloured(rng, n, tau_s, step) for s in LEVEL], axis=1)
    return Record(
        name=f"noise-{seed}", path=Path(f"noise-{seed}"), context=Context(state=state, vehicle=vehicle, model=model),
        residual=residual, measured=residual,
        valid=np.ones(n, bool), axes=tuple(range(6)), step_s=step, kinematic_bias=np.zeros((n, 3)),
        channels=named_channels(vehicle, state), delays=(), excluded=(),
    )  # fmt: skip


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
    low, high = coefficient.least(record.context), coefficient.most(record.context)
    if low > 0.0:
        return low
    wide = high if high > -low else low
    return 0.5 * wide * (float(rng.choice((-1.0, 1.0))) if low < 0.0 < high else 1.0)


def one(job: tuple[int, float, bool]) -> Outcome:
    """Diagnose one record."""
    seed, seconds, add = job
    tau = TAUS_S[seed % len(TAUS_S)]
    record, true = noise_record(seed, seconds, tau), None
    if add:
        record, true = with_effect(record, seed)
    answer = conclude([record])
    named = tuple(n.effect.name for n in answer.found)
    return Outcome(seed, tau, answer.verdict, named, true, tuple(tuple(a) for a in answer.aliases))


def interval(hits: int, trials: int) -> str:
    """A share with its 95 % interval (Wilson)."""
    z, p = 1.96, hits / max(trials, 1)
    middle = (p + z * z / (2 * trials)) / (1 + z * z / trials)
    half = (
        z * math.sqrt(p * (1 - p) / trials + z * z / (4 * trials * trials)) / (1 + z * z / trials)
    )
    return f"{hits}/{trials} = {p:.3f} [{max(middle - half, 0.0):.3f}, {middle + half:.3f}]"


def main() -> int:
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
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
        rows = [o for o in outcomes if tau is None or o.tau_s == tau]
        label = "all" if tau is None else f"tau {tau:g} s"
        wrong = sum(bool(o.false) for o in rows)
        print(f"{label:10s} flights with a false effect {interval(wrong, len(rows))}")
        if a.effect:
            named = sum(len(o.named) for o in rows)
            false = sum(len(o.false) for o in rows)
            beyond = sum(len(o.beyond_aliases) for o in rows)
            print(f"{'':10s} false among the named {interval(false, max(named, 1))}")
            print(f"{'':10s} of them, not an alias that was said {interval(beyond, max(named, 1))}")
            print(
                f"{'':10s} true effect named {interval(sum(o.true in o.named for o in rows), len(rows))}"
            )
        else:
            silent = sum(o.verdict != "nothing_missing" for o in rows)
            print(f"{'':10s} not answered nothing_missing {interval(silent, len(rows))}")
    if a.json:
        a.json.write_text(json.dumps([o.__dict__ for o in outcomes], indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
