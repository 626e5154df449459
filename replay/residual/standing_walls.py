"""Walls stand still: the direction of a wall from all places at which a beam met it.

One beam says how far a wall is along the beam, and flight has to take it for square to the beam. A log holds the whole
flight: where the vehicle turned or passed along the wall, the places lie on a line.
"""

from __future__ import annotations

import numpy as np

from companion.estimation.range_geometry import PlaneDistance
from models.common.frames import Array

FEWEST = 30
MOST = 400
"""Places from which on a line is looked for, and how many at most are compared with each other."""
NEAR_M = 1.0
"""Places up to this far from one another are of one wall."""
SPREAD_M = 0.1
"""Standard deviation of places along a wall from which on it has a direction: a few times the noise of a range."""
STRAIGHT = 0.2
"""Standard deviation across over that along, up to which places lie on a line: four of them know it to 6 degrees."""
SQUARE_RAD = 0.05
"""Angle up to which a beam counts as square to the wall: heading and direction are known no better than to 3 degrees,
and a vehicle that faces a wall mostly means to."""
FLATTEST_RAD = np.pi / 3.0
"""Angle between beam and normal up to which a wall is met: one that is met more flatly returns nothing."""


def square_to_walls(plane: PlaneDistance, position: Array) -> PlaneDistance:
    """Distance and normal (n,) of the wall itself, of what a beam saw from ``position`` (n, 3), NED.

    The line through the places near each one is that of least squares across it (principal axes: Pearson 1901, Phil.
    Mag. 2, 559). As it was where they do not lie on a line.
    """
    seen = np.flatnonzero(np.isfinite(plane.distance_m) & np.isfinite(position).all(axis=1))
    if len(seen) < FEWEST:
        return plane
    beam = plane.normal_ned[seen, :2]
    places = position[seen, :2] + plane.distance_m[seen, None] * beam
    chosen = np.arange(0, len(seen), -(-len(seen) // MOST))
    latest = np.searchsorted(chosen, np.arange(len(seen)), side="right") - 1
    normal = _normals(places[chosen])[latest]
    bearing = np.arctan2(beam[:, 1], beam[:, 0])
    of_normal = np.arctan2(normal[:, 1], normal[:, 0])
    # The normal of a line may point either way: within a quarter turn of the beam.
    angle = (of_normal - bearing + np.pi / 2.0) % np.pi - np.pi / 2.0
    turn = np.sign(angle) * np.maximum(np.abs(angle) - SQUARE_RAD, 0.0)
    met = np.abs(angle) <= FLATTEST_RAD
    rows = seen[met]
    turned = bearing[met] + turn[met]
    distance_m = plane.distance_m.copy()
    normal_ned = plane.normal_ned.copy()
    distance_m[rows] *= np.cos(turn[met])
    normal_ned[rows, 0] = np.cos(turned)
    normal_ned[rows, 1] = np.sin(turned)
    return PlaneDistance(distance_m, normal_ned)


def _normals(places: Array) -> Array:
    """Unit normal (m, 2) of the line through the places (m, 2) near each one; NaN where they lie on none."""
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    near = (apart < NEAR_M).astype(float)
    near /= near.sum(axis=1, keepdims=True)
    mean = near @ places
    products = near @ (places[:, :, None] * places[:, None, :]).reshape(len(places), 4)
    covariance = products.reshape(len(places), 2, 2) - mean[:, :, None] * mean[:, None, :]
    variances, axes = np.linalg.eigh(covariance)
    across, along = np.sqrt(np.maximum(variances, 0.0)).T
    on_a_line = (along > SPREAD_M) & (across < STRAIGHT * along)
    return np.where(on_a_line[:, None], axes[:, :, 0], np.nan)
