"""Does a component depend on the place at all? What does not rise above the data's noise is not learnt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array, Mask
from models.dataset import place_means
from models.surrogate import polynomial

# A component is learnt if simple models explain at least this share of it at places that they have not seen.
LEAST_SHARE = 0.1
DEGREES = (1, 2, 3, 4)
# The places around one on a grid.
NEIGHBOURS = 4
FOLDS = 5
# A sample of this many rows decides: seconds instead of minutes on large tables.
ROWS = 1500


def live(x: Array, y: Array, gate: Array, locations: NDArray[np.intp]) -> Mask:
    """Components (6,) of increments y (n, 6) that vary with the inputs x (n, 3) beyond noise.

    Noise at one place says nothing about the next: neither polynomials of degree 1 to 4 nor the mean of the four
    nearest places then beat a constant on places left out.
    """
    if len(x) > ROWS:
        chosen = np.random.default_rng(0).choice(len(x), ROWS, replace=False)
        rows = np.sort(chosen)
        x = x[rows]
        y = y[rows]
        gate = gate[rows]
        locations = locations[rows]
    _, place = np.unique(locations, return_inverse=True)
    drawn = np.random.default_rng(0).permutation(place.max() + 1)
    fold = drawn[place] % FOLDS
    left = [_nearest(x, y, place)]
    for degree in DEGREES:
        left.append(unexplained(x, y, gate, fold, degree))
    constant = ((y - y.mean(axis=0)) ** 2).sum(axis=0)
    explained = np.min(left, axis=0) < (1.0 - LEAST_SHARE) * constant
    varies = np.ptp(y, axis=0) > 1e-9
    return np.asarray(varies & explained)


def unexplained(x: Array, y: Array, gate: Array, fold: NDArray[np.intp], degree: int) -> Array:
    """Sum of squared errors (6,) of a polynomial on the folds that it was not fitted on."""
    left = np.zeros(6)
    for k in range(FOLDS):
        seen = fold != k
        unseen = fold == k
        fitted = polynomial.fit(x[seen], y[seen], gate[seen], degree)
        answer, _ = fitted.predict(x[unseen])
        error = gate[unseen] * answer - y[unseen]
        left += (error**2).sum(axis=0)
    return left


def _nearest(x: Array, y: Array, place: NDArray[np.intp]) -> Array:
    """Sum of squared errors (6,) of the mean of the nearest other places' means."""
    centre = place_means(x[:, :2], place)
    mean = place_means(y, place)
    apart = centre[:, None] - centre
    square = (apart**2).sum(axis=-1)
    np.fill_diagonal(square, np.inf)
    near = np.argsort(square, axis=1)[:, :NEIGHBOURS]
    forecast = mean[near].mean(axis=1)
    error = forecast[place] - y
    return np.asarray((error**2).sum(axis=0))
