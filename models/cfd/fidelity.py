"""Two fidelities: what full models with swirl add to half models, learnt over the positions computed both ways.

Zero-mean Gaussian process on the difference of the increments over free air (Kennedy and O'Hagan 2000, with the scale
of the cheap model kept at one). Its prior fades to nothing as the ground goes away, where full and half models agree
(the places computed both ways say how well); that of side force and tilt with the wall as well, without which there is
none. A difference counts the less, the worse its own mean is known. The error
is that of full models left out, with length, fading and noise chosen without them; where it is not less than without a
correction, by two standard errors, the half model stays as it is.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from models.cfd.labels import TILT, Label, added
from models.cfd.position import FREE, Place, near
from models.common.frames import Array

# What is chosen from: lengths in the coordinates 1 / (0.5 + distance); powers of 1 / (0.5 + h) with which the prior's
# standard deviation fades; variances of noise over that of the prior at h = 1 R.
LENGTHS = (0.15, 0.3, 0.6, 1.2)
POWERS = (1, 2, 3)
NOISES = (0.01, 0.1, 0.5, 2.0)
LEAST = 4
"""Fewest positions, free air aside, from which anything is learnt."""
SIGNIFICANT = 2.0
"""Standard errors by which the correction must miss less than the half model alone."""
LEAST_FADE = 1e-3
"""The prior without ground over that at h = 1 R: above zero, so that a set without any ground can be learnt."""
APART = 0.08
"""Where a wall counts, places nearer than this, in the same coordinates, are left out together."""
SMALLEST = np.finfo(float).tiny
"""Keeps what is divided by above zero."""
TINY = 1e-12
"""Variance [N^2, N^2 m^2] far below that of any place."""
TOGETHER = 0.5
"""Share of the error of a side force or tilt that neighbours have in common, over ``NEAR``."""
NEAR = 0.3
"""Width, in the same coordinates, over which errors of places left out are averaged; 2 R and 1 R are 0.27 apart."""


class KernelChoice(NamedTuple):
    """How one component is learnt: length, power with which the prior fades, noise."""

    length: float
    power: int
    noise: float


CHOICES = tuple(KernelChoice(*values) for values in itertools.product(LENGTHS, POWERS, NOISES))


@dataclass(frozen=True)
class Correction:
    """What is added to the half model, N and N m, corner frame, at the campaign's speed.

    ``places`` were computed both ways, ``change`` (n, 6) is full less half, as increments over free air, and
    ``error_of_change`` (n, 6) that of its mean. ``missed`` (n, 6) is what the correction misses at each
    place when it is left out. ``choice`` by component, None: the correction is zero.
    """

    places: tuple[Place, ...]
    change: Array
    error_of_change: Array
    missed: Array
    choice: tuple[KernelChoice | None, ...] = (None,) * 6

    @property
    def learnt(self) -> Array:
        """Components (6,) for which something is learnt."""
        return np.array([choice is not None for choice in self.choice])

    def error_at(self, place: Place) -> Array:
        """Error (6,) at a place: what is missed at places left out, beyond the error of the full models' means there.

        Taken over the shape of the prior, with ground or without as the place is, near and well known ones counting
        most. The estimate's own error is added: full models of which little is known do not speak for the half model.
        """
        if place == FREE or not self.places:
            return np.zeros(6)
        x = _coordinates(self.places)
        here = near(place)[None, :]
        weight = self._nearness(place, here, x)
        shape = _shape(x)
        squares = np.where(shape > 0.0, shape**2, np.inf)
        missed = self.missed**2 / squares
        known = self.error_of_change**2 / squares
        usual = weight @ self.missed**2 / np.maximum(weight @ shape**2, SMALLEST)
        # A variance is known to a variance of twice its square.
        counts = np.where(shape > 0.0, weight[:, None], 0.0)
        share = counts / (known + usual + TINY) ** 2
        share /= np.maximum(share.sum(axis=0), SMALLEST)
        excess = np.sum(share * (missed - known), axis=0)
        doubt = np.sqrt(2.0 * np.sum((share * known) ** 2, axis=0))
        size = np.sqrt(np.maximum(excess, 0.0) + doubt)
        return np.asarray(_shape(here)[0] * size)

    def _nearness(self, place: Place, here: Array, x: Array) -> Array:
        """Weights (n,) of the places for another: of those with ground as it has, or without as it has none."""
        weight: Array = _rbf(here, x, NEAR)[0] + SMALLEST
        heights = np.array([h for h, _ in self.places])
        alike = np.isinf(heights) == math.isinf(place[0])
        if alike.any():
            weight[~alike] = 0.0
        return weight

    def at(self, place: Place) -> Array:
        """Correction (6,) at a place."""
        if not self.places or place == FREE:
            return np.zeros(6)
        here = near(place)
        out = np.zeros(6)
        for k, choice in enumerate(self.choice):
            out[k] = self.component(k).predict(here, choice)
        return out

    def left_out(self, place: Place) -> Array:
        """Correction (6,) at a place by the other places alone."""
        if place not in self.places:
            return self.at(place)
        i = self.places.index(place)
        return np.asarray(self.change[i] - self.missed[i])

    def component(self, k: int) -> _Component:
        """What is known of one component."""
        return _Component(
            x=_coordinates(self.places),
            y=self.change[:, k],
            error=self.error_of_change[:, k],
            wall=bool(TILT[k]),
        )


def learn(full: Mapping[Place, Label], half: Mapping[Place, Label]) -> Correction:
    """Correction from the labels by place of both models, free air among them.

    Without free air of both, or with fewer than ``LEAST`` places, nothing is learnt.
    """
    places: tuple[Place, ...] = ()
    if FREE in full and FREE in half:
        places = tuple(sorted((full.keys() & half.keys()) - {FREE}))
    change = np.zeros((len(places), 6))
    known = np.zeros((len(places), 6))
    for i, place in enumerate(places):
        change[i] = added(full, place).wrench - added(half, place).wrench
        known[i] = np.hypot(full[place].sigma, half[place].sigma)
    bare = Correction(places, change, known, change)
    if len(places) < LEAST:
        return bare
    missed = change.copy()
    choice = list(bare.choice)
    for k in range(6):
        data = bare.component(k)
        left_out = data.left_out()
        gain = (change[:, k] ** 2 - left_out**2) * data.weight
        error = np.std(gain, ddof=1) / math.sqrt(len(gain))
        sure = np.mean(gain) > SIGNIFICANT * error
        if sure or not np.any(change[:, k]):
            missed[:, k] = left_out
            choice[k] = data.choose()
    return Correction(places, change, known, missed, tuple(choice))


@dataclass(frozen=True)
class _Component:
    """One component's differences ``y`` (n,) with the error of their means, at coordinates ``x`` (n, 2).

    ``wall``: whether it takes a wall, as side force and tilt do.
    """

    x: Array
    y: Array
    error: Array
    wall: bool

    def predict(self, at: Array, choice: KernelChoice | None) -> float:
        """Mean at coordinates (2,)."""
        if choice is None or not np.any(self.y):
            return 0.0
        known = np.linalg.solve(self._covariance(choice), self.y)
        prior = _kernel(at[None], self.x, choice, self.wall)
        return float(prior[0] @ known)

    def choose(self) -> KernelChoice | None:
        """The choice with the least error at points left out one at a time; doubtful points count less.

        Residuals of a process that does not know the point: Rasmussen and Williams 2006, eq. 5.12.
        """
        if not np.any(self.y):
            return CHOICES[0]
        left = []
        for choice in CHOICES:
            inverse = np.linalg.inv(self._covariance(choice))
            residual = inverse @ self.y / inverse.diagonal()
            left.append(residual**2 @ self.weight)
        best = int(np.argmin(left))
        if left[best] < self.y**2 @ self.weight:
            return CHOICES[best]
        return None

    @property
    def weight(self) -> Array:
        """How much a point (n,) counts where errors are compared: doubtful ones less."""
        variance = np.mean(self.y**2) + self.error**2
        return np.asarray(1.0 / (variance + SMALLEST))

    def left_out(self) -> Array:
        """Residuals (n,) at each point, of processes that do not know it, nor were chosen by it.

        Nor by its neighbours, where a wall counts: a case starts from the state of a neighbour, and where the flow tips
        over, it tips to the same side.
        """
        misses = []
        for i in range(len(self.y)):
            rest = np.arange(len(self.y)) != i
            if self.wall:
                rest = np.sum((self.x - self.x[i]) ** 2, axis=1) > APART**2
            others = _Component(self.x[rest], self.y[rest], self.error[rest], self.wall)
            forecast = others.predict(self.x[i], others.choose())
            misses.append(self.y[i] - forecast)
        return np.array(misses)

    def _covariance(self, choice: KernelChoice) -> Array:
        """(n, n), over the prior's variance at h = 1 R, which is that of the differences over what fading leaves.

        A case starts from the state of a neighbour: where the flow tips over, their errors have the same sign.
        """
        single = np.eye(len(self.y))
        alike = single
        if self.wall:
            alike = (1.0 - TOGETHER) * single + TOGETHER * _rbf(self.x, self.x, NEAR)
        error = self.error[:, None] * alike * self.error
        fade = _fade(self.x, choice.power, self.wall)
        over_prior = np.sum(fade**2) / np.sum(self.y**2)
        prior = _kernel(self.x, self.x, choice, self.wall)
        return np.asarray(prior + choice.noise * single + error * over_prior)


def _coordinates(places: tuple[Place, ...]) -> Array:
    return np.array([near(p) for p in places])


def _rbf(a: Array, b: Array, length: float) -> Array:
    apart = np.sum((a[:, None] - b) ** 2, axis=2)
    return np.asarray(np.exp(-0.5 * apart / length**2))


def _fade(x: Array, power: int, wall: bool) -> Array:
    """Prior standard deviation (n,) over that at h = 1 R; of what takes a wall, times 1 / (0.5 + d)."""
    at_one_radius, _ = near((1.0, math.inf))
    fade = np.maximum((x[:, 0] / at_one_radius) ** power, LEAST_FADE)
    return np.asarray(fade * x[:, 1] if wall else fade)


def _shape(x: Array) -> Array:
    """Shape of the prior (n, 6): its standard deviation by component over that at h = 1 R."""
    return np.stack([_fade(x, 1, bool(wall)) for wall in TILT], axis=1)


def _kernel(a: Array, b: Array, choice: KernelChoice, wall: bool) -> Array:
    fade_a = _fade(a, choice.power, wall)
    fade_b = _fade(b, choice.power, wall)
    return np.asarray(fade_a[:, None] * _rbf(a, b, choice.length) * fade_b)
