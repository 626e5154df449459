"""Held-out regimes: what was learnt elsewhere, where the vehicle is low, fast, or at a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.frames import AXES, Array
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.evidence import Evidence, Fit

NEAR_GROUND, NEAR_WALL, FAST_M_S = 4.0, 3.8, 1.0
"""Reach of ground (h/r) and wall (d/r) in radii (Ai et al. 2020, Sensors 20, 5805); speed of a fast flight [m/s]."""
LEAST_S = 6.0
"""A regime and the rest of the flight have to last so long each [s]."""


@dataclass(frozen=True)
class Regime:
    """RMS of every judged axis in one regime, without the effects and with what was learnt outside it."""

    name: str
    seconds: float
    before: dict[str, float]
    after: dict[str, float]


def masks(record: Record) -> dict[str, Mask]:
    """Where a flight was low, at a wall, or fast, (n,) each."""
    state, radius = record.context.state, record.context.vehicle.rotor_radius_m
    with np.errstate(invalid="ignore"):
        low = np.nanmin(np.where(np.isnan(state.h_m), np.inf, state.h_m), axis=1) < NEAR_GROUND * radius
        wall = np.nanmin(np.where(np.isnan(state.d_m), np.inf, state.d_m), axis=1) < NEAR_WALL * radius
        fast = np.linalg.norm(state.velocity_ned, axis=1) > FAST_M_S
    return {"near the ground": low, "near a wall": wall, "fast": fast}


def held_out_regimes(evidence: Evidence, best: Fit, flight: int) -> tuple[Regime, ...]:
    """Every regime of one flight by coefficients that were fitted without it."""
    library = evidence.library
    record = library.records[flight]
    terms = [t for t in best.terms if t.effect is not None and flight in t.places]
    out = []
    for name, mask in masks(record).items():
        inside, outside = (float((record.valid & m).sum()) * record.step_s for m in (mask, ~mask))
        if not terms or min(inside, outside) < LEAST_S:
            continue
        fit = evidence.refit(best.terms, best.noise, {flight: mask[:: library.every[flight]]})
        rest: Array = np.nan_to_num(record.residual).copy()
        for t in terms:
            x, _ = library.wrenches(t, flight)
            if t.effect is not None and t.effect.searched:
                x[:, [a for a in range(6) if AXES[a] not in t.effect.searched]] = 0.0
            place = np.searchsorted(t.columns, t.places[flight])
            rest -= x @ (fit.b[fit.part(t)][place] * t.scale[place])
        rows = mask & record.valid
        before, after = (np.sqrt((r[rows] ** 2).mean(axis=0)) for r in (np.nan_to_num(record.residual), rest))
        out.append(
            Regime(
                name,
                inside,
                {AXES[a]: float(before[a]) for a in record.axes},
                {AXES[a]: float(after[a]) for a in record.axes},
            )
        )
    return tuple(out)
