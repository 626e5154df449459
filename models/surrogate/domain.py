"""Where the data are: a map of the distance to the nearest data, and bounds, turned into trust 0...1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import Array

# Nodes along each side of the table of trust: a cell is 1/64 of the range of the scaled distances.
NODES = 65
PER_UNIT = (NODES - 1) / 2.0
LAST_CELL = NODES - 2
# Trust is whole up to one typical gap of the data from the nearest row, and none at this many gaps.
GAPS_TO_NOTHING = 3.0
# Outside the rotor speeds of the data trust fades over this share of them; so below the nearest distances.
# Chosen, not fitted: forces go as rpm^2 far beyond the data, but nothing was checked there.
SPEED_MARGIN = 0.25
# Chosen: at half the nearest distance nothing is trusted.
NEAR_MARGIN = 0.5


@dataclass(frozen=True)
class Domain:
    """Trust by location: ``map`` (NODES, NODES) over the two distance coordinates in [-1, 1], bounds in m and rpm."""

    map: Array
    h_near: float
    d_near: float
    rpm_low: float
    rpm_high: float

    def trust(self, x: Array, h: Array, d: Array, rpm: Array) -> Array:
        """Trust (n,) at coordinates x (n, >= 2) in [-1, 1] that belong to h, d, rpm (n,); none of them NaN."""
        p = (x[:, :2] + 1.0) * PER_UNIT
        cell = np.minimum(p, LAST_CELL).astype(np.intp)
        fx, fy = (p - cell).T
        # One index into the rows of the map behind each other takes half of the time of two.
        corner = cell[:, 0] * NODES + cell[:, 1]
        m = self.map.ravel()
        left = (1 - fy) * m[corner] + fy * m[corner + 1]
        right = (1 - fy) * m[corner + NODES] + fy * m[corner + NODES + 1]
        inside = (1 - fx) * left + fx * right
        low = (rpm / self.rpm_low - (1 - SPEED_MARGIN)) / SPEED_MARGIN
        high = ((1 + SPEED_MARGIN) - rpm / self.rpm_high) / SPEED_MARGIN
        speed = _share(np.minimum(low, high))
        near = inside * _near(h, self.h_near) * _near(d, self.d_near)
        return np.asarray(near * speed)


def fit(x: Array, h: Array, d: Array, rpm: Array) -> Domain:
    """Map the domain of rows at coordinates x (n, >= 2).

    The typical gap is the 95th percentile, over distinct locations, of the distance to the nearest other location.
    """
    from scipy.spatial import KDTree  # to fly, numpy is enough

    places = np.unique(np.round(x[:, :2], 9), axis=0)
    tree = KDTree(places)
    gap = 1.0 / PER_UNIT
    if len(places) > 1:
        apart, _ = tree.query(places, 2)
        gap = max(gap, float(np.quantile(apart[:, 1], 0.95)))
    axis = np.linspace(-1.0, 1.0, NODES)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1)
    distance, _ = tree.query(grid.reshape(-1, 2))
    trust = _share((GAPS_TO_NOTHING - distance / gap) / (GAPS_TO_NOTHING - 1))
    return Domain(
        map=trust.reshape(NODES, NODES),
        h_near=_nearest_seen(h, d),
        d_near=_nearest_seen(d, h),
        rpm_low=float(rpm.min()),
        rpm_high=float(rpm.max()),
    )


def _nearest_seen(distance: Array, other: Array) -> float:
    """Nearest distance in the data; a surface that they never saw counts as seen only beyond the other's reach."""
    finite = distance[np.isfinite(distance)]
    others = other[np.isfinite(other)]
    if finite.size:
        return float(finite.min())
    if others.size:
        return float(others.max())
    return 0.0


def _near(value: Array, near: float) -> Array:
    if near > 0.0:
        return _share((value / near - NEAR_MARGIN) / (1 - NEAR_MARGIN))
    return np.ones_like(value)


def _share(value: Array) -> Array:
    """Within 0...1; numpy's clip takes three times as long on a few numbers."""
    return np.asarray(np.minimum(np.maximum(value, 0.0), 1.0))
