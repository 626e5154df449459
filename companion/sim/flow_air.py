"""The air of the scenario ``corner_cfd``: flow simulation's wrenches at one half of its places, interpolated by scipy.

It shares neither places nor interpolator with the surrogate that flies there (``corner_cfd_half``), which was trained
on the other half. Only the flow simulation is common to both.
"""

from __future__ import annotations

import math
from functools import lru_cache
from importlib import resources
from importlib.util import find_spec

import numpy as np

from companion.sim.air import NOMINAL, PAPER_CQ, PAPER_CT, RPM_HOVER, Increments
from models.common.errors import ConfigError
from models.common.extras import how_to_install
from models.common.frames import Array
from models.corner_law import ClosedForm
from models.dataset import DataSet, half, read

AIR_HALF = "even"
FREE_RADII = 7.0
"""Ground alone and wall alone are taken to be this far from the other: beyond the outermost distance, 5 radii."""
_KNOTS = 64


class FlowAir:
    """Increments of a fan, tabulated over the logarithms of height and distance to the wall, bilinear in between.

    Nearer than the nearest place its values hold. The unsteadiness is that of the other simulated air.
    """

    def __init__(self, data: DataSet, radius_m: float) -> None:
        near, shares = _shares(data, radius_m)
        self._low = near.min(axis=0).tolist()
        self._high = math.log(FREE_RADII)
        knots = [np.linspace(low, self._high, _KNOTS) for low in self._low]
        self._per_knot = [(_KNOTS - 1) / (self._high - low) for low in self._low]
        grid = np.stack(np.meshgrid(*knots, indexing="ij"), axis=-1)
        self._table: list[list[list[float]]] = _interpolated(near, shares, grid).tolist()

    def increments(self, eta: float, delta: float) -> Increments:
        """At height ``eta`` = h/R and lip-to-wall distance ``delta`` = d/R (either may be inf)."""
        i, a = self._cell(0, eta)
        j, b = self._cell(1, delta)
        below = _between(self._table[i][j], self._table[i][j + 1], b)
        above = _between(self._table[i + 1][j], self._table[i + 1][j + 1], b)
        x, y, z, mx, my, mz = _between(below, above, a)
        rms = NOMINAL.increments(eta, delta).rms
        return Increments(x=x, y=y, z=z, mx=mx, my=my, mz=mz, rms=rms)

    def _cell(self, axis: int, value: float) -> tuple[int, float]:
        """The knot below a distance, and how far it is towards the next."""
        low = self._low[axis]
        log_value = min(max(math.log(max(value, 1e-3)), low), self._high)
        at = (log_value - low) * self._per_knot[axis]
        k = min(int(at), _KNOTS - 2)
        return k, at - k


def _between(first: list[float], second: list[float], share: float) -> list[float]:
    """Linear interpolation, ``share`` of the way from the first to the second."""
    pairs = zip(first, second, strict=True)
    return [(1.0 - share) * a + share * b for a, b in pairs]


def _shares(data: DataSet, radius_m: float) -> tuple[Array, Array]:
    """Places (n, 2), log radii, and increments (n, 6) over lift, lift times radius and torque, at hover's speed."""
    rows = data.take(data.rpm == RPM_HOVER)
    free = rows.wrench[rows.free_air][0]
    torque = radius_m * PAPER_CQ / PAPER_CT
    unit = free[2] * np.array([1.0, 1.0, 1.0, radius_m, radius_m, torque])
    place = np.stack([rows.h, rows.d], axis=1) / radius_m
    return np.log(np.minimum(place, FREE_RADII)), (rows.wrench - free) / unit


def _interpolated(place: Array, values: Array, grid: Array) -> Array:
    """Thin-plate splines through ``values`` (n, 6) at ``place`` (n, 2), on ``grid`` (..., 2)."""
    from scipy.interpolate import RBFInterpolator

    spline = RBFInterpolator(place, values, kernel="thin_plate_spline")
    out: Array = spline(grid.reshape(-1, 2)).reshape(*grid.shape[:-1], 6)
    return out


def require_scipy() -> None:
    """Raises ConfigError where it is not installed."""
    if find_spec("scipy") is None:
        raise ConfigError(f"sim:corner_cfd: needs the package scipy: {how_to_install('replay')}")


@lru_cache(maxsize=1)
def flow_air() -> FlowAir:
    """Of the shipped set. Raises ConfigError without scipy."""
    require_scipy()
    path = resources.files("models") / "data" / "corner_cfd.csv"
    with resources.as_file(path) as file:
        return FlowAir(half(read(file), AIR_HALF), ClosedForm().radius_m)
