"""A map over height and distance to the wall: what no formula says of ground and wall.

The map is bilinear over the logarithms of height and distance, both in rotor radii. Its prior is a Gaussian process
with a squared-exponential kernel (Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, 4.2).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from models.common.frames import Array

_LENGTH = 0.5
"""Correlation length of the prior, in logarithms: a factor of 1.65 in distance."""
_NEAR = 2.0
"""Rotor radii: from here on the standard deviation of the prior falls with the distance."""
_VISITED = 0.5
"""Flights were at a cell: half of the time after which it counts as seen in full."""


@dataclass(frozen=True)
class SurfaceMap:
    """Knots of a map in rotor radii: reference point to ground, lip to wall.

    The last knot stands for every greater distance: no ground, no wall. Cells are numbered row by row, heights first.
    """

    heights: tuple[float, ...]
    gaps: tuple[float, ...]

    @property
    def size(self) -> int:
        """Number of cells."""
        return len(self.heights) * len(self.gaps)

    @cached_property
    def _logs(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return tuple(map(math.log, self.heights)), tuple(map(math.log, self.gaps))

    def cells(self, height: float, gap: float) -> list[tuple[int, float]]:
        """Up to four cells around a place [rotor radii] and their weights, which add up to 1."""
        log_heights, log_gaps = self._logs
        across = _between(gap, self.gaps, log_gaps)
        width = len(self.gaps)
        out = []
        for row, a in _between(height, self.heights, log_heights):
            for column, b in across:
                out.append((row * width + column, a * b))
        return out

    def weights(self, height: Array, gap: Array) -> Array:
        """Weights (..., size) of all cells at heights and gaps (...) [rotor radii]; 0 where one is not known."""
        with np.errstate(invalid="ignore"):
            rows = _hats(height, self.heights)
            columns = _hats(gap, self.gaps)
        out: Array = rows[..., :, None] * columns[..., None, :]
        return np.nan_to_num(out.reshape(*out.shape[:-2], self.size))

    def covariance(self, sd: float, *, of_wall: bool) -> Array:
        """Prior (size, size) of a map whose standard deviation is ``sd`` close by.

        Zero in free air, and with ``of_wall`` where there is no wall.
        """
        log_heights, log_gaps = self._logs
        place = np.array([(h, d) for h in log_heights for d in log_gaps])
        apart = ((place[:, None] - place[None]) ** 2).sum(axis=2)
        size = sd * np.minimum(1.0, _NEAR / np.exp(place.min(axis=1)))
        size[-1] = 0.0
        if of_wall:
            size[len(self.gaps) - 1 :: len(self.gaps)] = 0.0
        return np.asarray(size[:, None] * size[None] * np.exp(-0.5 * apart / _LENGTH**2))


@lru_cache(maxsize=16)
def prior_factor(surface: SurfaceMap, sd: float, of_wall: bool) -> Array:
    """(size, size) F with F F^T = ``covariance``: cells are F times independent numbers of unit variance."""
    values, vectors = np.linalg.eigh(surface.covariance(sd, of_wall=of_wall))
    out: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return out[:, ::-1]


def _between(
    value: float, knots: Sequence[float], logs: Sequence[float]
) -> tuple[tuple[int, float], ...]:
    if value <= knots[0]:
        return ((0, 1.0),)
    if value >= knots[-1]:
        return ((len(knots) - 1, 1.0),)
    k = bisect_right(knots, value)
    share = (math.log(value) - logs[k - 1]) / (logs[k] - logs[k - 1])
    return (k - 1, 1.0 - share), (k, share)


def _hats(value: Array, knots: Sequence[float]) -> Array:
    """Weights (..., knots) of linear interpolation over the logarithm; NaN where the value is."""
    at = np.log(np.clip(np.asarray(value, dtype=float), knots[0], knots[-1]))
    logs = np.log(knots)
    k = np.clip(np.searchsorted(logs, np.nan_to_num(at), side="right"), 1, len(knots) - 1)
    share = (at - logs[k - 1]) / (logs[k] - logs[k - 1])
    out = np.zeros((*at.shape, len(knots)))
    np.put_along_axis(out, k[..., None] - 1, (1.0 - share)[..., None], -1)
    np.put_along_axis(out, k[..., None], share[..., None], -1)
    return out


PARTS = ("lift", "pull", "tilt")
COMPONENTS = {
    "lift": np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
    "pull": np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
    "tilt": np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
}
"""Components of a fan's wrench in the corner frame that belong to each part."""
MEASURED = SurfaceMap(
    (0.8, 1.0, 1.25, 1.6, 2.0, 2.6, 3.4, 4.5), (0.2, 0.4, 0.65, 1.0, 1.6, 2.4, 4.0)
)
"""The map that diagnosis fits to flights and that amends a model."""
CELLS = [
    (part, k)
    for part in PARTS
    for k in range(MEASURED.size)
    if k < MEASURED.size - 1 and (part == "lift" or (k + 1) % len(MEASURED.gaps))
]
"""Cells of it that may differ from zero: lift everywhere but in free air, pull and tilt beside a wall."""


def cell_name(part: str, cell: int) -> str:
    """Name of a cell's parameter: part, height and distance in rotor radii."""
    row, column = divmod(cell, len(MEASURED.gaps))
    return f"{part}_{MEASURED.heights[row]:g}_{MEASURED.gaps[column]:g}"


def _held_towards_wall(cells: Array, seen: Array) -> Array:
    """``cells`` (parts, size) whose pull and tilt do not fall nearer to a wall than flights were.

    The prior lets them fall to zero there. An offset that falls as the vehicle comes nearer lets the wall draw it in.
    Lift does not feed itself so. ``seen`` (size,): where flights were.
    """
    gaps = len(MEASURED.gaps)
    visited = np.flatnonzero(seen.reshape(-1, gaps).max(axis=0) >= _VISITED)
    if not visited.size:
        return cells
    held = cells.reshape(len(cells), -1, gaps).copy()
    for column in range(int(visited[0]) - 1, -1, -1):
        outer = held[:, :, column + 1]
        nearer = held[:, :, column]
        falls = np.sign(outer) * nearer < np.abs(outer)
        held[:, :, column] = np.where(falls, outer, nearer)
    held[PARTS.index("lift")] = cells[PARTS.index("lift")].reshape(-1, gaps)
    return held.reshape(cells.shape)


@dataclass(frozen=True)
class LawCorrection:
    """What flights measured of ground and wall beyond a model: gains on its law, and a map.

    ``gains`` (3,) of lift, pull and tilt; ``cells`` (3, size) in shares of the fan's free-air lift (tilt: times the
    radius); ``seen`` (size,) 0...1, where flights were.
    """

    radius_m: float
    gains: Array
    cells: Array
    seen: Array

    @classmethod
    def of(cls, parameters: Mapping[str, float], radius_m: float) -> LawCorrection:
        """From the parameters of an adopted ``surface_law``."""
        gains = np.array([parameters[f"{part}_of_model"] for part in PARTS])
        cells = np.zeros((len(PARTS), MEASURED.size))
        for part, k in CELLS:
            cells[PARTS.index(part), k] = parameters[cell_name(part, k)]
        seen = np.array([parameters.get(cell_name("seen", k), 0.0) for k in range(MEASURED.size)])
        return cls(radius_m, gains, _held_towards_wall(cells, seen), seen)

    def amended(
        self, h: Array, d: Array, wrench: Array, free: Array, trust: Array
    ) -> tuple[Array, Array]:
        """Wrench (n, 6) in the corner frame and trust (n,) of a model at h, d (n,), corrected; ``free`` (n, 6)."""
        weights = MEASURED.weights(h / self.radius_m, d / self.radius_m)
        lift, pull, tilt = (weights @ self.cells.T).T
        zero = np.zeros_like(lift)
        more = (
            np.stack([pull, zero, lift, zero, self.radius_m * tilt, zero], axis=-1) * free[:, 2:3]
        )
        gain = sum(g * COMPONENTS[part] for g, part in zip(self.gains, PARTS, strict=True))
        return wrench + gain * (wrench - free) + more, np.maximum(trust, weights @ self.seen)
