"""What the surroundings do to the vehicle at one instant, as one record, and its parts as adaptation measures them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from companion.estimation.surfaces import Surface
from models.common.frames import Array

THRUST_LEAD_S = 0.06
"""How far ahead the lift is looked up: what motors take to follow."""


class FanPlaces(NamedTuple):
    """Where the fans are: heights and gaps in rotor radii, lift in free air [N], the wall's bearing (0: no wall)."""

    heights: tuple[float, ...]
    gaps: tuple[float, ...]
    free_lift_n: tuple[float, ...]
    bearing_rad: float = 0.0


class Parts(NamedTuple):
    """What surrogate and adopted effects say at one instant, as they say it: it is worked on once a block."""

    at_fans: Array
    """(2, fans, 6): with ground and wall, and in free air, corner frame."""
    effects: Array
    """(k, 6): of each adopted effect that has a size, body FRD about the CG."""
    tip_m_s: float
    """Mean speed of the blade tips."""
    vertical_n: float
    """Sum of all vertical forces, body FRD."""
    around: FanPlaces
    """At the lead of thrust."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """What the surroundings do to the vehicle: body FRD about the CG, and how far that is to be believed."""

    wrench: tuple[float, ...]
    """Disturbance at the leads of thrust (Fz) and tilt (the others), with the vanes' reaction to its moment."""
    free_lift_n: float
    trust: float
    gain: float
    """Bounded so that delayed feed-forward towards a wall stays below a fifth of the loop's damping."""
    h_m: tuple[float, ...]
    d_m: tuple[float, ...]
    """Of every fan, at the lead of thrust."""
    ground: Surface
    wall: Surface
    ceiling: Surface
    """Watched only where an adopted effect knows of ceilings."""
    parts: Parts | None = None
    """What adaptation measures by; None without it."""
