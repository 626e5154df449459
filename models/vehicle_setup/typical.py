"""Sizes of a multirotor that nobody gave: typical ratios between mass, rotors and arms, each with its spread."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from models.frames import GRAVITY
from models.vehicle import RHO_SEA_LEVEL
from models.vehicle_setup.estimate import OPEN_ROTOR_CT
from models.vehicle_setup.frames import Motor

_DISC_LOADING = 70.0
"""Weight over disc area [N/m^2]: Crazyflie 40, camera quadrotors 50 to 100."""
_SPACING = 1.25
"""Distance of neighbouring rotors over their diameter: 1.05 to 1.6."""
_RADIUS_M = 0.127
"""A propeller of ten inches."""


@dataclass(frozen=True)
class Guess:
    """A number that was given, or is typical: then ``low`` and ``high`` are the range in which most vehicles lie."""

    value: float
    source: str = ""
    low: float = math.nan
    high: float = math.nan

    @property
    def assumed(self) -> bool:
        """Whether nobody gave it."""
        return math.isfinite(self.low)

    @property
    def spread(self) -> float:
        """Factor between ``value`` and ``high``; 1 where it was given."""
        return self.high / self.value if self.assumed else 1.0


def typical_sizes(
    mass_kg: float | None, radius_m: float | None, arm_m: float | None, motors: Sequence[Motor], hover_rpm: float | None
) -> dict[str, Guess]:
    """Mass, rotor radius R and arm by their keys in a vehicle file; what is None follows from the others.

    W = n C_T rho pi R^4 Omega^2 where the rotor speed Omega in hover is known, else W = (disc loading) pi R^2 per
    place; neighbouring places are ``_SPACING`` diameters apart.
    """
    places = {(m.forward, m.right) for m in motors}
    apart = min((math.dist(a, b) for a, b in combinations(places, 2)), default=1.0)
    per_r2 = _DISC_LOADING * math.pi * len(places)
    omega = (hover_rpm or 0.0) * 2.0 * math.pi / 60.0
    per_r4 = len(motors) * OPEN_ROTOR_CT * RHO_SEA_LEVEL * math.pi * omega**2
    weight = None if mass_kg is None else mass_kg * GRAVITY
    if radius_m is not None:
        radius = Guess(radius_m)
    elif weight is not None and per_r4:
        radius = _typical((weight / per_r4) ** 0.25, 1.1, "typical for mass and rotor speed")
    elif arm_m is not None:
        radius = _typical(arm_m * apart / (2.0 * _SPACING), 1.25, "typical for rotors so far apart")
    elif weight is not None:
        radius = _typical(math.sqrt(weight / per_r2), 1.4, "typical for the mass")
    elif per_r4:
        radius = _typical(math.sqrt(per_r2 / per_r4), 1.4, "typical for this rotor speed")
    else:
        radius = _typical(_RADIUS_M, 2.0, "ten inches")
    if mass_kg is not None:
        mass = Guess(mass_kg)
    elif per_r4:
        mass = _typical(per_r4 * radius.value**4 / GRAVITY, 1.3 * radius.spread**4, "typical for this rotor speed")
    else:
        mass = _typical(per_r2 * radius.value**2 / GRAVITY, 2.0 * radius.spread**2, "typical for these rotors")
    arm = Guess(arm_m or 0.0)
    if arm_m is None:
        arm = _typical(2.0 * radius.value * _SPACING / apart, 1.4 * radius.spread, "typical for these rotors")
    return {"mass_kg": mass, "rotor_radius_m": radius, "position_m": arm}


def _typical(value: float, factor: float, source: str) -> Guess:
    return Guess(float(f"{value:.4g}"), source, value / factor, value * factor)
