"""The modelled wrench in parts: lift, pull and tilt of ground and wall, what is left in free air, adopted effects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from models.frames import Array, at_cg, corner_to_body
from models.vehicle import Vehicle

_LIFT = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_PULL = (1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
_TILT = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
_MASKS = np.array([_LIFT, _PULL, _TILT])[:, None, :]
"""Components of a fan's own wrench that make a part; lift acts at its fan, so that its moments belong to it."""


@dataclass(frozen=True, slots=True)
class Around:
    """Where the fans are: heights and gaps in rotor radii, lift in free air [N], the wall's bearing (0: no wall)."""

    heights: tuple[float, ...]
    gaps: tuple[float, ...]
    free_lift_n: tuple[float, ...]
    bearing_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Parts:
    """What surrogate and adopted effects say at one instant, as they say it: it is worked on once a block."""

    at_fans: Array
    """(2, fans, 6): with ground and wall, and in free air, corner frame."""
    effects: Array
    """(k, 6): of each adopted effect that has a size, body FRD about the CG."""
    tip_m_s: float
    """Mean speed of the blade tips."""
    vertical_n: float
    """Sum of all vertical forces, body FRD."""
    around: Around
    """At the lead of thrust."""


@lru_cache(maxsize=8)
def _maps(vehicle: Vehicle) -> Array:
    """(6 fans, 18): from wrenches at the fans, one after another, to lift, pull and tilt about the CG."""
    fans = len(vehicle.fans)
    unit = np.eye(6 * fans).reshape(6 * fans, 1, fans, 6)
    out: Array = at_cg(_MASKS * unit, vehicle.fan_positions_m).sum(axis=2).reshape(6 * fans, 18)
    return out


def rows_of(vehicle: Vehicle, at_fans: Array, effects: Array, bearing_rad: float) -> Array:
    """(4 + k, 6), body FRD about the CG: lift, pull and tilt of ground and wall, free air, adopted effects.

    ``at_fans`` and ``effects`` as in ``Parts``, or means of them.
    """
    near, free = corner_to_body(at_fans, bearing_rad)
    both = (np.stack([near - free, free]).reshape(2, -1) @ _maps(vehicle)).reshape(2, 3, 6)
    return np.concatenate([both[0], both[1].sum(axis=0, keepdims=True), effects])


def about_cg(vehicle: Vehicle, at_fans: Iterable[Sequence[float]], bearing_rad: float) -> list[list[float]]:
    """Lift, pull and tilt (3, 6), body FRD about the CG, of wrenches at the fans (fans, 6), corner frame.

    The same as the first rows of ``rows_of``, in plain floats.
    """
    c, s = math.cos(bearing_rad), math.sin(bearing_rad)
    lz = lx = ly = px = py = pmx = pmy = pmz = tx = ty = tz = 0.0
    for fan, (x, y, lift, roll, pitch, yaw) in zip(vehicle.fans, at_fans, strict=True):
        ax, ay, az = fan.position_m
        north, east = c * x + s * y, s * x - c * y
        lz, lx, ly = lz - lift, lx - ay * lift, ly + ax * lift
        px, py, pmx, pmy, pmz = px + north, py + east, pmx - az * east, pmy + az * north, pmz + ax * east - ay * north
        tx, ty, tz = tx + c * roll + s * pitch, ty + s * roll - c * pitch, tz - yaw
    return [[0.0, 0.0, lz, lx, ly, 0.0], [px, py, 0.0, pmx, pmy, pmz], [0.0, 0.0, 0.0, tx, ty, tz]]
