"""Numbers and vectors of three in plain floats: most run at every message, and are too small for arrays to be quick."""

from __future__ import annotations

import math

from models.common.frames import Rows
from models.vehicle import Vector3

Level = tuple[float, float]
"""North and east, or roll and pitch."""


def plus(a: Vector3, b: Vector3) -> Vector3:
    """Sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector3, b: Vector3) -> Vector3:
    """Difference: the way from ``b`` to ``a``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(a: Vector3, by: float) -> Vector3:
    """``by`` times ``a``."""
    return a[0] * by, a[1] * by, a[2] * by


def lagged(late: Level, now: Level, share: float) -> Level:
    """A first-order average, one step on: ``share`` of the way from ``late`` to ``now``."""
    return late[0] + share * (now[0] - late[0]), late[1] + share * (now[1] - late[1])


def turned(rows: Rows, a: Vector3) -> Vector3:
    """``a`` in the frame that the rotation ``rows`` leads to."""
    (r, s, t), (u, v, w), (x, y, z) = rows
    north, east, down = a
    return (
        r * north + s * east + t * down,
        u * north + v * east + w * down,
        x * north + y * east + z * down,
    )


def within(vector: Vector3, level: float, vertical: float) -> Vector3:
    """NED: horizontal length at most ``level``, vertical part at most ``vertical``."""
    north, east, down = vector
    size = math.hypot(north, east)
    if size > level:
        share = level / size
        north = north * share
        east = east * share
    return north, east, -vertical if down < -vertical else vertical if down > vertical else down


def bounded(vector: Vector3, most: float) -> Vector3:
    """Each part within +-``most``."""
    return clipped(vector[0], most), clipped(vector[1], most), clipped(vector[2], most)


def clipped(value: float, most: float) -> float:
    """``value`` within +-``most``; a NaN stays one."""
    # Comparisons rather than min and max, which take ten times as long: it runs dozens of times for every setpoint.
    if value < -most:
        return -most
    if value > most:
        return most
    return value
