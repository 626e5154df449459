"""What the mesh does to the numbers: the same positions on coarser and finer meshes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.cfd.campaign import Row
from models.cfd.config import Setup
from models.cfd.position import Place
from models.frames import Array


@dataclass(frozen=True)
class Study:
    """Mesh study; forces in N, moments in N m, at the campaign's speed.

    ``levels`` ascending; ``wrench`` (6,) by place and level. ``total`` and ``increment`` (6,): half of the spread over
    the levels, rms over the positions, of the wrench itself and of what it adds to free air on the same mesh.
    ``richardson``: free lift on an infinitely fine mesh and the observed order, where the levels fall monotonically.
    """

    levels: tuple[float, ...]
    wrench: dict[Place, dict[float, Array]]
    total: Array
    increment: Array
    richardson: tuple[float, float] | None


def spread(rows: Sequence[Row], setup: Setup) -> Study:
    """Study of the positions that were computed on several meshes; zeros without any."""
    c = setup.campaign
    levels = tuple(sorted({1.0, *c.grid_levels}))
    found: dict[Place, dict[float, Array]] = {}
    for row in rows:
        p = row.position
        usable = math.isfinite(row.result.wrench[2])
        if p.model == "half" and p.rpm == c.rpm and p.approach == "near" and p.place in c.grid_at and usable:
            found.setdefault(p.place, {})[p.level] = np.array(row.result.wrench)
    whole = {place: by for place, by in found.items() if all(level in by for level in levels)}
    free = whole.get((math.inf, math.inf))
    total = _rms([np.ptp(list(by.values()), axis=0) / 2 for by in whole.values()])
    added = [
        [by[level] - free[level] for level in levels] for by in whole.values() if free is not None and by is not free
    ]
    return Study(levels, whole, total, _rms([np.ptp(a, axis=0) / 2 for a in added]), _richardson(free, levels))


def _rms(parts: Sequence[Array]) -> Array:
    return np.sqrt(np.mean(np.square(parts), axis=0)) if parts else np.zeros(6)


def _richardson(free: dict[float, Array] | None, levels: tuple[float, ...]) -> tuple[float, float] | None:
    """Lift at zero cell size and order, from the last three levels (Roache 1994, unequal ratios by bisection)."""
    if free is None or len(levels) < 3:
        return None
    (coarse, middle, fine) = (float(free[level][2]) for level in levels[-3:])
    if (fine - middle) * (middle - coarse) <= 0:
        return None
    r_fine, r_coarse = levels[-1] / levels[-2], levels[-2] / levels[-3]

    def miss(order: float) -> float:
        return float((middle - coarse) / (fine - middle) - r_fine**order * (r_coarse**order - 1) / (r_fine**order - 1))

    low, high = 0.1, 8.0
    if miss(low) * miss(high) > 0:
        return None
    for _ in range(60):
        centre = (low + high) / 2
        low, high = (centre, high) if miss(centre) * miss(low) > 0 else (low, centre)
    return fine + (fine - middle) / (r_fine**low - 1), low
