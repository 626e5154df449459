"""What the wrench of a block scatters by: with it a size is weighed against what is measured."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from companion.adaptation.adaptation import Adaptation
from companion.adaptation.block import BLOCK_S
from models.common.frames import GRAVITY, Array
from models.vehicle import Vehicle

_NOISE_MEAN_S = 20.0
"""Over which the noise of an axis is averaged."""
_FORCE_FLOOR = 0.003
"""Least noise of a block, of the weight: a third of a centi-g of an accelerometer's drift."""
_MOMENT_FLOOR = 0.001
"""The same, of the weight times the farthest fan's arm."""


@lru_cache(maxsize=4)
def floors(vehicle: Vehicle) -> Array:
    """Least variance of a block (5,)."""
    weight = vehicle.mass_kg * GRAVITY
    lever = max(float(np.abs(vehicle.fan_positions_m).max()), vehicle.rotor_radius_m)
    force = _FORCE_FLOOR * weight
    moment = _MOMENT_FLOOR * weight * lever
    out: Array = np.array([force, force, force, moment, moment]) ** 2
    return out


def scatter(known: Adaptation, innovation: Array, vehicle: Vehicle) -> Array:
    """Half the mean square of differences between neighbours (von Neumann 1941, Ann. Math. Statist. 12, 367): what a
    size is still wrong by is in both and does not count."""
    if known.innovation is None:
        return known.variance
    change = innovation - known.innovation
    fresh = 0.5 * change * change
    fresh = np.where(np.isfinite(fresh), fresh, known.variance)
    return np.maximum(
        known.variance + BLOCK_S / _NOISE_MEAN_S * (fresh - known.variance), floors(vehicle)
    )
