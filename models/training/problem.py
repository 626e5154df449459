"""A data set framed for regression: what is learnt over what, and which rows are learnt and tried together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.common.errors import ModelError
from models.common.frames import AXES, Array, Mask
from models.dataset import DataSet
from models.surrogate import coordinates, free_air
from models.surrogate.coordinates import Coordinates
from models.surrogate.free_air import FreeAir
from models.training import live_components

Index = NDArray[np.intp]
# Two places for each fold.
MIN_PLACES = 2 * live_components.FOLDS
# Calibration leaves out whole blocks of a grid of this many by this many over the distances.
BLOCKS = 4


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A data set framed for regression: y = gate x net(x), with y the increments over the free-air lift.

    ``x`` (n, 3) in [-1, 1], ``gate`` and ``y`` (n, 6), ``scale`` (6,) the largest |y| (1 where y is nothing),
    ``locations`` (n,) one number per distinct (h, d), ``live`` (6,) the components that depend on the place; y of the
    others is zero, their constant is the free-air law's share. ``weight`` (n, 6), mean 1: how much a row counts.
    """

    free_air: FreeAir
    coordinates: Coordinates
    x: Array
    gate: Array
    y: Array
    scale: Array
    locations: Index
    live: Mask
    weight: Array

    def __len__(self) -> int:
        return len(self.x)

    def take(self, index: Index) -> Problem:
        """The rows ``index``."""
        return replace(
            self,
            x=self.x[index],
            gate=self.gate[index],
            y=self.y[index],
            locations=self.locations[index],
            weight=self.weight[index],
        )


def frame(data: DataSet, live: Mask | None = None) -> Problem:
    """Fit the free-air law and the coordinates, and divide the increments by the lift.

    ``live`` (6,) where it is known which components depend on the place; else the data decide. Raises ModelError where
    there are too few places for five folds.
    """
    places = int(data.locations.max()) + 1
    if places < MIN_PLACES:
        raise ModelError(
            f"data set {data.source}: has {places} distinct places (h, d) to learn from; at least "
            f"{MIN_PLACES} are needed"
        )
    law = free_air.fit(data)
    if live is None:
        y = increments(data.wrench, data.rpm, law)
        axes = coordinates.fit(data, y, axisymmetric=False)
        x, gate = axes.inputs(data.h, data.d, data.rpm)
        live = live_components.live(x, y, gate, data.locations)
    law = _with_constants(law, data, live)
    y = _live_increments(data, law, live)
    axes = coordinates.fit(data, y, free_air.is_axisymmetric(law, live))
    return in_frame(data, law, axes, live)


def in_frame(data: DataSet, law: FreeAir, axes: Coordinates, live: Mask) -> Problem:
    """The data in a frame that is known: free-air law, coordinates, and which components depend on the place."""
    x, gate = axes.inputs(data.h, data.d, data.rpm)
    y = _live_increments(data, law, live)
    size = np.abs(y).max(axis=0)
    return Problem(
        free_air=law,
        coordinates=axes,
        x=x,
        gate=gate,
        y=y,
        scale=np.where(size > 1e-9, size, 1.0),
        locations=data.locations,
        live=live,
        weight=_weights(data, law),
    )


def _live_increments(data: DataSet, law: FreeAir, live: Mask) -> Array:
    """Increments (n, 6) of the components that depend on the place; 0 in the others."""
    return np.where(live, increments(data.wrench, data.rpm, law), 0.0)


def _weights(data: DataSet, law: FreeAir) -> Array:
    """Weight (n, 6) of each row in training, mean 1: 1 / (median^2 + sigma^2), sigma over the lift.

    The median keeps a few very sure rows from being all that counts: the nets' own error does not go below it.
    """
    if data.sigma is None:
        return np.ones_like(data.wrench)
    sigma = data.sigma / law.lift(data.rpm)[:, None]
    out = 1.0 / (np.median(sigma, axis=0) ** 2 + sigma**2 + 1e-12)
    return np.asarray(out / out.mean(axis=0))


def _with_constants(law: FreeAir, data: DataSet, live: Mask) -> FreeAir:
    """The law with the mean over all places as the share of components that do not depend on the place.

    A mean that is not significantly off zero is zero; the spread about it becomes the law's scatter. Fz keeps its 1.
    """
    if live.all():
        return law
    ratio = data.wrench / law.lift(data.rpm)[:, None]
    mean, error = free_air.mean_over_places(ratio, data.locations)
    constant = np.where(np.abs(mean) > free_air.SIGNIFICANT * error, mean, 0.0)
    constant[AXES.index("Fz")] = 1.0
    share = np.where(live, law.share, constant)
    spread = np.sqrt(np.mean((ratio - share) ** 2, axis=0))
    scatter = np.where(live, law.scatter, spread)
    return replace(law, share=tuple(share.tolist()), scatter=tuple(scatter.tolist()))


def increments(wrench: Array, rpm: Array, law: FreeAir) -> Array:
    """Wrench (n, 6) over the free-air lift, less the free-air share: F/(rho A Omega^2 R^2) up to one constant."""
    out: Array = wrench / law.lift(rpm)[:, None] - np.asarray(law.share)
    return out


def drawn(count: int, most: int, rng: np.random.Generator) -> Index:
    """Which of ``count`` rows: all, or ``most`` of them at random, in order."""
    if count <= most:
        return np.arange(count)
    return np.sort(rng.choice(count, most, replace=False))


def folds(problem: Problem, count: int, rng: np.random.Generator) -> Index:
    """Fold 0...count-1 of each row, shape (n,); rows of one (h, d) stay together."""
    _, place = np.unique(problem.locations, return_inverse=True)
    fold = np.arange(place.max() + 1) % count
    return np.asarray(rng.permutation(fold)[place])


def blocks(problem: Problem) -> Index:
    """Group 0...3 of each row, shape (n,): sixteenths of the (h, d) plane, those of one group apart from each other."""
    across = _band(problem.x[:, 0])
    along = _band(problem.x[:, 1])
    return 2 * (across % 2) + along % 2


def _band(values: Array) -> Index:
    """Which of ``BLOCKS`` bands each value is in, shape (n,), as many distinct values in each."""
    _, order = np.unique(values, return_inverse=True)
    band = BLOCKS * order // (order.max() + 1)
    return np.asarray(np.minimum(band, BLOCKS - 1))


def constant_notes(live: Mask) -> list[str]:
    """Words for components that were learnt as a constant."""
    notes = []
    for c in np.flatnonzero(~live):
        notes.append(
            f"{AXES[c]} does not vary with the place beyond the data's noise: learnt as a constant "
            "share of the lift, R2 of its increments undefined"
        )
    return notes
