"""Two fidelities: what full models with swirl add to half models, learnt over the positions computed both ways.

Zero-mean Gaussian process on the difference of the increments over free air (Kennedy and O'Hagan 2000, with the scale
of the cheap model kept at one). Its prior fades to nothing as the ground goes away, where full and half models agree
(the places computed both ways say how well). A difference counts the less, the worse its own mean is known. The error
is that of full models left out, with length, fading and noise chosen without them; where it is not less than without a
correction, by two standard errors, the half model stays as it is.
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
# What is chosen from: lengths in the coordinates 1 / (0.5 + distance); powers of 1 / (0.5 + h) with which the prior's
# standard deviation fades; variances of noise over that of the prior at h = 1 R, inf: nothing learnt.
LENGTHS = (0.15, 0.3, 0.6, 1.2)
POWERS = (1, 2, 3)
NOISES = (0.01, 0.1, 0.5, 2.0, math.inf)
LEAST = 4
"""Fewest positions, free air aside, from which anything is learnt."""
SIGNIFICANT = 2.0
"""Standard errors by which the correction must miss less than the half model alone."""
LEAST_FADE = 1e-3
"""The prior without ground over that at h = 1 R: above zero, so that a set without any ground can be learnt."""
NEAR = 0.3
"""Width, in the same coordinates, over which errors of places left out are averaged; 2 R and 1 R are 0.27 apart."""


@dataclass(frozen=True)
class Choice:
    """How one component is learnt: length, power with which the prior fades, noise."""

    length: float
    power: int
    noise: float

    @property
    def nothing(self) -> bool:
        """True where the correction is zero."""
        return math.isinf(self.noise)


CHOICES = tuple(Choice(*values) for values in itertools.product(LENGTHS, POWERS, NOISES))
NOTHING = Choice(LENGTHS[0], POWERS[0], math.inf)


@dataclass(frozen=True)
class Correction:
    """What is added to the half model, N and N m, corner frame, at the campaign's speed.

    ``places`` were computed both ways, ``change`` (n, 6) is full less half, as increments over free air, and
    ``error_of_change`` (n, 6) that of its mean. ``missed`` (n, 6) is what the correction misses at each
    place when it is left out. ``choice`` by component.
    """

    places: tuple[Place, ...]
    change: Array
    error_of_change: Array
    missed: Array
    choice: tuple[Choice, ...]

    @property
    def error(self) -> Array:
        """Rms (6,) of what the correction misses at places left out."""
        return _rms(self.missed)

    @property
    def plain(self) -> Array:
        """Rms (6,) of what the half model alone misses."""
        return _rms(self.change)

    def error_at(self, place: Place) -> Array:
        """Error (6,) at a place: rms over places left out, with ground or without as it is, near ones counting most."""
        if place == FREE or not self.places:
            return np.zeros(6)
        weight = _rbf(near(place)[None, :], _coordinates(self.places), NEAR)[0] + np.finfo(float).tiny
        alike = np.array([math.isinf(p[0]) == math.isinf(place[0]) for p in self.places])
        weight = np.where(alike, weight, 0.0) if alike.any() else weight
        out: Array = np.sqrt(weight @ self.missed**2 / weight.sum())
        return out

    @property
    def learnt(self) -> Array:
        """Components (6,) for which something is learnt."""
        return np.array([not choice.nothing for choice in self.choice])

    def at(self, place: Place) -> Array:
        """Correction (6,) at a place."""
        if not self.places or place == FREE:
            return np.zeros(6)
        here = near(place)[None, :]
        return np.array([_data(self, k).predict(here, self.choice[k])[0] for k in range(len(AXES))])

    def left_out(self, place: Place) -> Array:
        """Correction (6,) at a place by the other places alone."""
        if place not in self.places:
            return self.at(place)
        i = self.places.index(place)
        out: Array = self.change[i] - self.missed[i]
        return out


def learn(
    full: Mapping[Place, Array], half: Mapping[Place, Array], error: Mapping[Place, Array] | None = None
) -> Correction:
    """Correction from wrenches (6,) by place of both models, free air among them.

    ``error`` (6,) by place: that of the difference's mean, zero where it is not given. Without free air of both, or
    with fewer than ``LEAST`` places, nothing is learnt; ``plain`` still says what full models differ by.
    """
    able = FREE in full and FREE in half
    places = tuple(sorted(p for p in full if able and p in half and p != FREE))
    nothing = (NOTHING,) * len(AXES)
    if not places:
        none = np.empty((0, 6))
        return Correction((), none, none, none, nothing)
    change = np.array([full[p] - full[FREE] - (half[p] - half[FREE]) for p in places])
    known = np.array([np.zeros(6) if error is None else error[p] for p in places])
    bare = Correction(places, change, known, change, nothing)
    if len(places) < LEAST:
        return bare
    missed, choice = change.copy(), list(nothing)
    for k in range(len(AXES)):
        data = _data(bare, k)
        left_out = data.left_out()
        gain = change[:, k] ** 2 - left_out**2
        sure = np.mean(gain) > SIGNIFICANT * np.std(gain, ddof=1) / math.sqrt(len(gain))
        if sure or not np.any(change[:, k]):
            missed[:, k], choice[k] = left_out, data.choose()
    return Correction(places, change, known, missed, tuple(choice))


@dataclass(frozen=True)
class _Data:
    """One component's differences ``y`` (n,) with the error of their means, at coordinates ``x`` (n, 2)."""

    x: Array
    y: Array
    error: Array

    def predict(self, at: Array, choice: Choice) -> Array:
        """Mean (m,) at coordinates (m, 2)."""
        if choice.nothing or not np.any(self.y):
            return np.zeros(len(at))
        out: Array = _kernel(at, self.x, choice) @ np.linalg.solve(self._covariance(choice), self.y)
        return out

    def choose(self) -> Choice:
        """The choice with the least error at points left out one at a time; doubtful points count less."""
        weight = 1.0 / (np.mean(self.y**2) + self.error**2 + np.finfo(float).tiny)
        return min(CHOICES, key=lambda choice: float(weight @ self._leave_one_out(choice) ** 2))

    def left_out(self) -> Array:
        """Residuals (n,) at each point, of processes that are chosen without it as well."""
        misses = []
        for i in range(len(self.y)):
            rest = np.arange(len(self.y)) != i
            known = _Data(self.x[rest], self.y[rest], self.error[rest])
            misses.append(self.y[i] - known.predict(self.x[[i]], known.choose())[0])
        return np.array(misses)

    def _leave_one_out(self, choice: Choice) -> Array:
        """Residuals (n,) of a process that does not know the point (Rasmussen and Williams 2006, eq. 5.12)."""
        if choice.nothing or not np.any(self.y):
            return self.y
        inverse = np.linalg.inv(self._covariance(choice))
        out: Array = inverse @ self.y / np.diag(inverse)
        return out

    def _covariance(self, choice: Choice) -> Array:
        """Over the prior's variance at h = 1 R, which is that of the differences over what fading leaves of it."""
        variance = np.sum(self.y**2) / np.sum(_fade(self.x, choice.power) ** 2)
        out: Array = _kernel(self.x, self.x, choice) + np.diag(choice.noise + self.error**2 / variance)
        return out


def _data(correction: Correction, k: int) -> _Data:
    return _Data(_coordinates(correction.places), correction.change[:, k], correction.error_of_change[:, k])


def _rms(values: Array) -> Array:
    """Root mean square (6,) over the rows of ``values`` (n, 6); not known (nan) without rows."""
    return np.sqrt(np.mean(values**2, axis=0)) if len(values) else np.full(6, np.nan)


def _coordinates(places: Sequence[Place]) -> Array:
    return np.array([near(p) for p in places])


def _rbf(a: Array, b: Array, length: float) -> Array:
    apart = np.sum((a[:, None, :] - b[None, :, :]) ** 2, axis=2)
    out: Array = np.exp(-0.5 * apart / length**2)
    return out


def _fade(x: Array, power: int) -> Array:
    """Prior standard deviation (n,) over that at h = 1 R."""
    out: Array = np.maximum((x[:, 0] / near((1.0, math.inf))[0]) ** power, LEAST_FADE)
    return out


def _kernel(a: Array, b: Array, choice: Choice) -> Array:
    out: Array = _fade(a, choice.power)[:, None] * _rbf(a, b, choice.length) * _fade(b, choice.power)[None, :]
    return out
