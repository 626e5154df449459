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
    """

    levels: tuple[float, ...]
    wrench: dict[Place, dict[float, Array]]
    total: Array
    increment: Array


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
    return Study(levels, whole, total, _rms([np.ptp(a, axis=0) / 2 for a in added]))


def _rms(parts: Sequence[Array]) -> Array:
    return np.sqrt(np.mean(np.square(parts), axis=0)) if parts else np.zeros(6)
