"""Two fidelities: what full models with swirl add to half models, learnt over the positions computed both ways.

Zero-mean Gaussian process on the difference of the increments over free air (Kennedy and O'Hagan 2000, with the scale
of the cheap model kept at one). The error is that of full models left out, with length and noise chosen without
them; where it is larger than without a correction, the half model stays as it is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.cfd.position import Place, near
from models.frames import AXES, Array

FREE: Place = (math.inf, math.inf)
# Lengths in the coordinates 1 / (0.5 + distance), and variances of noise over that of the signal; inf: nothing learnt.
LENGTHS = (0.15, 0.3, 0.6, 1.2)
NOISES = (0.01, 0.1, 0.5, 2.0, math.inf)
LEAST = 4
"""Fewest positions, free air aside, from which anything is learnt."""


@dataclass(frozen=True)
class Correction:
    """What is added to the half model, N and N m, corner frame, at the campaign's speed.

    ``places`` were computed both ways, ``change`` (n, 6) is full less half, as increments over free air. ``missed``
    (n, 6) is what the correction misses at each place when it is left out. ``choice``: length and noise by component.
    """

    places: tuple[Place, ...]
    change: Array
    missed: Array
    choice: tuple[tuple[float, float], ...]

    @property
    def error(self) -> Array:
        """Rms (6,) of what the correction misses at places left out."""
        return _rms(self.missed)

    @property
    def plain(self) -> Array:
        """Rms (6,) of what the half model alone misses."""
        return _rms(self.change)

    def error_at(self, place: Place) -> Array:
        """Error (6,) at a place: rms over the places left out that are alike, with ground or without."""
        alike = [i for i, p in enumerate(self.places) if math.isinf(p[0]) == math.isinf(place[0])]
        return np.zeros(6) if place == FREE else _rms(self.missed[alike] if alike else self.missed)

    @property
    def learnt(self) -> Array:
        """Components (6,) for which something is learnt."""
        return np.array([math.isfinite(noise) for _, noise in self.choice])

    def at(self, place: Place) -> Array:
        """Correction (6,) at a place."""
        if not self.places or place == FREE:
            return np.zeros(6)
        known, here = _coordinates(self.places), near(place)[None, :]
        return np.array([_predict(known, self.change[:, k], here, *self.choice[k])[0] for k in range(len(AXES))])


def learn(full: Mapping[Place, Array], half: Mapping[Place, Array]) -> Correction:
    """Correction from wrenches (6,) by place of both models, free air among them.

    Without free air of both, or with fewer than ``LEAST`` places, nothing is learnt; ``plain`` still says what full
    models differ by.
    """
    able = FREE in full and FREE in half
    places = tuple(sorted(p for p in full if able and p in half and p != FREE))
    nothing = tuple((LENGTHS[0], math.inf) for _ in AXES)
    if not places:
        return Correction((), np.empty((0, 6)), np.empty((0, 6)), nothing)
    change = np.array([full[p] - full[FREE] - (half[p] - half[FREE]) for p in places])
    if len(places) < LEAST:
        return Correction(places, change, change, nothing)
    x = _coordinates(places)
    missed, choice = change.copy(), list(nothing)
    for k in range(len(AXES)):
        left_out = _left_out(x, change[:, k])
        if np.sum(left_out**2) <= np.sum(change[:, k] ** 2):
            missed[:, k], choice[k] = left_out, _choose(x, change[:, k])
    return Correction(places, change, missed, tuple(choice))


def _rms(values: Array) -> Array:
    """Root mean square (6,) over the rows of ``values`` (n, 6); not known (nan) without rows."""
    return np.sqrt(np.mean(values**2, axis=0)) if len(values) else np.full(6, np.nan)


def _coordinates(places: Sequence[Place]) -> Array:
    return np.array([near(p) for p in places])


def _kernel(a: Array, b: Array, length: float) -> Array:
    apart = np.sum((a[:, None, :] - b[None, :, :]) ** 2, axis=2)
    out: Array = np.exp(-0.5 * apart / length**2)
    return out


def _predict(x: Array, y: Array, at: Array, length: float, noise: float) -> Array:
    if math.isinf(noise):
        return np.zeros(len(at))
    weights = np.linalg.solve(_kernel(x, x, length) + noise * np.eye(len(x)), y)
    out: Array = _kernel(at, x, length) @ weights
    return out


def _choose(x: Array, y: Array) -> tuple[float, float]:
    """Length and noise with the least error at points left out one at a time."""
    return min(itertools.product(LENGTHS, NOISES), key=lambda pair: float(np.sum(_leave_one_out(x, y, *pair) ** 2)))


def _leave_one_out(x: Array, y: Array, length: float, noise: float) -> Array:
    """Residuals (n,) of a process that does not know the point (Rasmussen and Williams 2006, eq. 5.12)."""
    if math.isinf(noise):
        return y
    inverse = np.linalg.inv(_kernel(x, x, length) + noise * np.eye(len(x)))
    out: Array = inverse @ y / np.diag(inverse)
    return out


def _left_out(x: Array, y: Array) -> Array:
    """Residuals (n,) at each point, of processes whose length and noise are chosen without it as well."""
    misses = []
    for i in range(len(y)):
        rest = np.arange(len(y)) != i
        misses.append(y[i] - _predict(x[rest], y[rest], x[[i]], *_choose(x[rest], y[rest]))[0])
    return np.array(misses)
