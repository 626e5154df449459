"""Height and wall distance as a regressor sees them: coordinates that saturate, and gates that close, far away."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.common.frames import Array
from models.dataset import DataSet, place_means
from models.surrogate.free_air import HORIZONTAL

# Where the data still show an effect at their outermost distance, the gate closes this much further out.
BEYOND_DATA = 1.5
# An effect is over where the increments' RMS falls below this share of their largest value.
OVER_SHARE = 0.003


@dataclass(frozen=True, kw_only=True)
class Coordinates:
    """Maps h, d [m] and rpm to inputs in [-1, 1] and to the gates that multiply the increments.

    With t = (h - h_near)/(h_far - h_near) clipped to 0...1: coordinate 1 - 2 (1 - t)^2 (fine near the surface, flat at
    ``h_far``), gate a(t) = (1 - t^2)^3, twice continuously differentiable and exactly 0 from ``h_far`` on; so for d.
    A component that needs a wall is gated by a(d); the others by 1 - (1 - a(h))(1 - a(d)), 0 only far from both.
    """

    h_near: float
    h_far: float
    d_near: float
    d_far: float
    rpm_low: float
    rpm_high: float
    axisymmetric: bool

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        """Lowest and highest of h, d and rpm, (3, 1) each."""
        low = np.array([[self.h_near], [self.d_near], [self.rpm_low]])
        return low, np.array([[self.h_far], [self.d_far], [self.rpm_high]])

    def inputs(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> tuple[Array, Array]:
        """Inputs (n, 3) and gates (n, 6) at flat arrays h, d, rpm (n,)."""
        t = unit(np.array([h, d, rpm], dtype=float), *self._bounds)
        near = t[:2]
        x = np.zeros((t.shape[1], 3))
        x[:, :2] = (1 - 2 * (1 - near) ** 2).T
        if self.rpm_high > self.rpm_low:
            x[:, 2] = 2 * t[2] - 1
        near_h, near_d = (1 - near * near) ** 3
        any_surface = 1 - (1 - near_h) * (1 - near_d)
        horizontal = near_d if self.axisymmetric else any_surface
        return x, np.where(HORIZONTAL, horizontal[:, None], any_surface[:, None])


def unit(value: Array, low: Array, high: Array) -> Array:
    """(value - low)/(high - low) clipped to 0...1; where the bounds coincide, 0.5 at or below them, 1 beyond.

    ``value`` (k, n), bounds (k, 1).
    """
    width = high - low
    above = np.minimum(np.maximum(value, low), high) - low
    if np.count_nonzero(width) == len(width):
        return np.asarray(above / width)
    # Without a width, what is above is zero, or NaN.
    side = above + np.where(value > high, 1.0, 0.5)
    return np.where(width > 0.0, above / np.where(width > 0.0, width, 1.0), side)


def fit(data: DataSet, increments: Array, axisymmetric: bool) -> Coordinates:
    """Take the bounds from the data: nearest distances, where each surface's effect ends, and the rotor speeds.

    ``increments`` (n, 6) over the free-air lift; a component that is all zero has no say.
    """
    h_near, h_far = _reach(data.h, data.d, increments)
    d_near, d_far = _reach(data.d, data.h, increments)
    return Coordinates(
        h_near=h_near,
        h_far=h_far,
        d_near=d_near,
        d_far=d_far,
        rpm_low=float(data.rpm.min()),
        rpm_high=float(data.rpm.max()),
        axisymmetric=axisymmetric,
    )


def _reach(distance: Array, other: Array, increments: Array) -> tuple[float, float]:
    """Nearest distance in the data and the distance from which on this surface has no effect."""
    finite = np.isfinite(distance)
    if not finite.any():
        return 0.0, 0.0
    near = float(distance[finite].min())
    outer = float(distance[finite].max())
    alone = np.isinf(distance)
    if not alone.any():
        return near, BEYOND_DATA * outer
    excess = increments - _effect_of_other(other[alone], increments[alone], other)
    scale = np.abs(increments).max(axis=0)
    relative = excess / np.where(scale > 0.0, scale, 1.0)
    components = max(np.count_nonzero(scale), 1)
    square = np.sum(relative**2, axis=1) / components
    # RMS over all rows at a distance or beyond, for every distance in the data from the nearest outwards.
    places, index = np.unique(distance[finite], return_inverse=True)
    sums = np.bincount(index, weights=square[finite])
    total = _from_there_on(sums) + square[alone].sum()
    count = _from_there_on(np.bincount(index)) + int(alone.sum())
    over = np.sqrt(total / count) < OVER_SHARE
    over[0] = False
    if over.any():
        return near, float(places[np.argmax(over)])
    return near, BEYOND_DATA * outer


def _from_there_on(values: NDArray[Any]) -> NDArray[Any]:
    """Sums (n,) of each value and all behind it."""
    return values[::-1].cumsum()[::-1]


def _effect_of_other(at: Array, increments: Array, query: Array) -> Array:
    """Increments (n, 6) that the other surface causes alone, interpolated over its distance (inf allowed)."""
    inverse = 1.0 / (1.0 + at)
    places, index = np.unique(inverse, return_inverse=True)
    want = 1.0 / (1.0 + query)
    columns = [np.interp(want, places, column) for column in place_means(increments, index).T]
    return np.stack(columns, axis=1)
