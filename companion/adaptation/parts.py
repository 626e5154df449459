"""The modelled wrench in parts: one for each gain, what is left in free air, and one for each adopted effect."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from models.frames import Array, at_cg
from models.vehicle import Vehicle

_LIFT = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_PULL = (1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
_TILT = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
_MASKS = np.array([_LIFT, _PULL, _TILT])[:, None, :]
"""Components of a fan's own wrench that make a part; lift acts at its fan, so that its moments belong to it."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Rows of wrenches about the CG, body FRD: ``now`` (3 + 1 + k, 6) for measuring, ``ahead`` (3 + k, 6) for offsets.

    Rows of ``now``: lift, pull and tilt of ground and wall, all fans in free air, then each adopted effect that has a
    size. ``ahead`` is without the free air, at the leads of the offsets.
    """

    now: Array
    ahead: Array
    fan_lift_n: Array
    """(fans,): lift of every fan with what ground and wall add, for the vanes in its stream."""
    tip_m_s: float
    """Mean speed of the blade tips."""


@lru_cache(maxsize=8)
def _positions(vehicle: Vehicle) -> Array:
    return vehicle.fan_positions_m[None, :, :]


def split(vehicle: Vehicle, at_fans: Array) -> Array:
    """(3, 6): lift, pull and tilt about the CG of what ground and wall do at every fan (fans, 6), body FRD."""
    out: Array = at_cg(_MASKS * at_fans, _positions(vehicle)).sum(axis=1)
    return out


def at_the_cg(vehicle: Vehicle, at_fans: Array) -> Array:
    """(6,): wrenches of the fans (fans, 6) about the CG."""
    out: Array = at_cg(at_fans, vehicle.fan_positions_m).sum(axis=0)
    return out
