"""What the mesh does to the numbers: the same positions on coarser and finer meshes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from models.cfd.case_run import Row
from models.cfd.config import Setup
from models.cfd.position import Place
from models.frames import Array


def mesh_error(rows: Sequence[Row], setup: Setup) -> Array:
    """Error (6,) [N, N m] by the mesh of what a place adds to free air, at the campaign's speed.

    Half of the spread of the increment over the meshes of half models, rms over the places computed on all of them;
    zero without any.
    """
    c, free = setup.campaign, (math.inf, math.inf)
    levels = {1.0, *c.grid_levels}
    found: dict[Place, dict[float, Array]] = {}
    for row in rows:
        p = row.position
        usable = p.model == "half" and p.rpm == c.rpm and p.approach == "near" and math.isfinite(row.result.wrench[2])
        if usable and p.level in levels and p.place in c.grid_at:
            found.setdefault(p.place, {})[p.level] = np.array(row.result.wrench)
    whole = {place: by for place, by in found.items() if len(by) == len(levels)}
    added = [[by[n] - whole[free][n] for n in levels] for p, by in whole.items() if free in whole and p != free]
    return np.sqrt(np.mean([(np.ptp(a, axis=0) / 2) ** 2 for a in added], axis=0)) if added else np.zeros(6)
