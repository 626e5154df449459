"""Sizes in shares of the weight: all that is known of forces and masses where the mass of the vehicle is assumed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from models.common.frames import GRAVITY
from models.vehicle import Vehicle
from replay.search.estimates import IntervalEstimate
from replay.search.least_visible import Visible

_BY_WEIGHT = {"N": "weight", "N m": "weight m", "N/m": "weight/m", "N s/m": "weight s/m"}
_BY_MASS = {"kg": "weight", "kg m": "weight m", "kg m^2": "weight m^2"}
"""A mass over the vehicle's is its weight over the vehicle's."""


def scale(unit: str, vehicle: Vehicle) -> tuple[float, str]:
    """Factor and unit of a size as it is said: shares of the weight where the mass is assumed, else as it is."""
    if vehicle.mass_assumed and unit in _BY_WEIGHT:
        return 1.0 / (vehicle.mass_kg * GRAVITY), _BY_WEIGHT[unit]
    if vehicle.mass_assumed and unit in _BY_MASS:
        return 1.0 / vehicle.mass_kg, _BY_MASS[unit]
    return 1.0, unit


def in_shares(
    estimates: Sequence[IntervalEstimate], vehicle: Vehicle
) -> tuple[IntervalEstimate, ...]:
    """Parameters as they are said of this vehicle."""
    return tuple(e.times(*scale(e.unit, vehicle)) for e in estimates)


def least_in_shares(one: Visible, vehicle: Vehicle) -> Visible:
    """The least size that would have been seen, as it is said of this vehicle."""
    factor, unit = scale(one.unit, vehicle)
    return replace(one, least=one.least * factor, unit=unit)
