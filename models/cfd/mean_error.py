"""How far the mean of one computed flow is from the truth: its own swing is not all of it.

Near the ground the flow tips over to one side, even without a wall. Which side is left to chance, and the flow turns
slowly, if at all: the mean of one run is that of one direction, and no block average of that run can tell. Two things
can. Without a wall the mean over all directions is zero by symmetry, so what a case shows there is its error. And where
iterations that went round in circles were followed by a march in time, the two means can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.cfd.case_run import Result, Row
from models.cfd.position import near
from models.frames import Array

# By the mirror plane through axis and wall normal, without swirl.
ODD = np.array([False, True, False, True, False, True])
# Without a wall the fan stands on an axis of symmetry: no side force, no tilt.
TILT = np.array([True, True, False, True, True, False])
# Width over heights, in the coordinate 1 / (0.5 + h): about that of the step from 1.75 to 2 R, where tipping ends.
WIDTH = 0.04


@dataclass(frozen=True)
class Misfit:
    """By how much the means of some cases missed others that are known better.

    ``h`` (n,) over R; ``size`` (n, 6) what was missed beyond the error of the better mean, nan where that is not known,
    at 1 rpm, N and N m, going as rpm^2.
    """

    h: Array
    size: Array

    def near(self, h: float) -> Array:
        """Rms (6,) of ``size`` near that height; zero where nothing is known."""
        apart = np.array([near((x, h))[0] - near((h, h))[0] for x in self.h])
        known = np.isfinite(self.size)
        # The nearest counts, however far it is.
        weight = np.exp(-0.5 * (apart**2 - (apart**2).min(initial=np.inf)) / WIDTH**2)[:, None] * known
        square = (weight * np.where(known, self.size, 0.0) ** 2).sum(axis=0)
        return np.asarray(np.sqrt(square / np.maximum(weight.sum(axis=0), np.finfo(float).tiny)))


@dataclass(frozen=True)
class MeanError:
    """What was found of the means of one kind of case: iterations in ``circles``, which did not settle, and others."""

    circles: Misfit
    others: Misfit

    def of(self, row: Row) -> Array:
        """Error (6,) of the mean of one case, N and N m: its own, or what such means missed at that height if more."""
        misses = self.circles if in_circles(row.result) else self.others
        return np.maximum(own_error(row.result), row.position.rpm**2 * misses.near(row.position.h))


def learn(rows: Sequence[Row]) -> MeanError:
    """From all cases of one kind (model and mesh)."""
    circles: list[tuple[float, Array]] = []
    others: list[tuple[float, Array]] = []
    for row in rows:
        p, r = row.position, row.result
        scale, forbidden = p.rpm**-2, TILT & math.isinf(p.d)
        mean, iterated = np.array(r.wrench), np.array(r.iterated)
        if in_circles(r):
            circles.append((p.h, scale * np.where(forbidden, mean, np.nan)))
            continue
        others.append((p.h, scale * np.where(forbidden, mean, np.nan)))
        if np.isfinite(iterated).all() and np.isfinite(r.error).all():
            apart = np.sqrt(np.maximum((iterated - mean) ** 2 - np.square(r.error), 0.0))
            circles.append((p.h, scale * np.where(forbidden, iterated, apart)))
    model = rows[0].position.model if rows else ""
    return MeanError(_misses(circles, model), _misses(others, model))


def in_circles(result: Result) -> bool:
    """True where nothing but the mean over iterations that did not settle is known."""
    return result.status == "cycling" and result.steps == 0


def own_error(result: Result) -> Array:
    """Error (6,) of a case's mean as far as its own run shows: by block averages, else swing and drift."""
    out: Array = np.where(np.isnan(result.error), amplitude(result), result.error)
    return out


def amplitude(result: Result) -> Array:
    """Swing or drift (6,); a drift dies out over about a hundred iterations, twice the span it is taken over."""
    out: Array = np.maximum(result.swing, 2 * np.array(result.drift))
    return out


def _misses(found: Sequence[tuple[float, Array]], model: str) -> Misfit:
    """Side forces and tilts are taken together over the directions solved: both, of a half model its mirror plane's."""
    size = np.array([size for _, size in found]).reshape(-1, 6)
    if model == "half":
        size[:, ODD] = 0.0
    else:
        for pair in ((0, 1), (3, 4)):
            size[:, pair] = np.sqrt(np.mean(size[:, pair] ** 2, axis=1, keepdims=True))
    return Misfit(np.array([h for h, _ in found]), size)
