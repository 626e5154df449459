"""The modelled wrench in parts: one for each gain, what is left in free air, and one for each adopted effect."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from models.frames import Array, at_cg
from models.vehicle import Vehicle
from models.vehicle_wrench import RPM_TO_RAD_S

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
    vertical_n: float
    """Sum of ``now``'s vertical forces, body FRD."""
    around: Around | None = None
    """At the lead of thrust."""


@lru_cache(maxsize=8)
def _maps(vehicle: Vehicle) -> Array:
    """(6 fans, 18): from wrenches at the fans, one after another, to lift, pull and tilt about the CG."""
    fans = len(vehicle.fans)
    unit = np.eye(6 * fans).reshape(6 * fans, 1, fans, 6)
    out: Array = at_cg(_MASKS * unit, vehicle.fan_positions_m).sum(axis=2).reshape(6 * fans, 18)
    return out


def split(vehicle: Vehicle, at_fans: Array) -> Array:
    """(..., 3, 6): lift, pull and tilt about the CG of wrenches at the fans (..., fans, 6), body FRD."""
    flat = at_fans.reshape(*at_fans.shape[:-2], -1)
    return (flat @ _maps(vehicle)).reshape(*at_fans.shape[:-2], 3, 6)


def parts_of(
    vehicle: Vehicle, now: Array, ahead: Array, free: Array, effects: Array, fan_lift_n: Array, rpm: Array,
    around: Around | None = None,
) -> Parts:  # fmt: skip
    """Parts of what ground and wall do at every fan (fans, 6), now and at the leads, of the fans in free air (fans, 6),
    and of adopted effects (k, 6) about the CG; body FRD."""
    both = split(vehicle, np.stack([now, ahead, free]))
    rows = np.concatenate([both[0], both[2].sum(axis=0, keepdims=True), effects])
    shared = np.concatenate([both[1], effects]) if len(effects) else both[1]
    tip = float(rpm.mean()) * RPM_TO_RAD_S * vehicle.rotor_radius_m
    return Parts(rows, shared, fan_lift_n, tip, float(rows[:, 2].sum()), around)
