"""The named sizes: what each is, its prior, and what is believed of all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from companion.disturbance.adopted_effects import effects_with_size
from models.common.frames import Array
from models.surrogate.empty import is_empty
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle

GAINS = ("ground_lift", "wall_pull", "wall_tilt")
"""Gains on what the surrogate says of ground and wall: its vertical forces, its level forces, its moments."""
LIFT, PULL, TILT, THRUST, NORTH, EAST, CG_X, CG_Y, DRAG, DRAG_ARM, INFLOW = range(11)
"""Places of the sizes that every vehicle has; those of adopted effects come after."""
FIRST_EFFECT = 11
_HEAVY = 0.3
"""Prior sd of a gain on the model: its law is that of another fan in another place. 10 to 30 % is what the built-in
vehicle's air differs by (docs/lab/simulator.md)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Size:
    """One named size: the value at which everything is as modelled, its prior, how fast it may change, its bounds.

    ``per_minute``: standard deviation of its change within a minute. Tables are compared by identity.
    """

    name: str
    unit: str
    as_modelled: float
    mean: float
    sd: float
    per_minute: float
    low: float
    high: float


@dataclass(frozen=True)
class Sizes:
    """What is believed: ``offset`` (n,) from the values as modelled, ``covariance`` (n, n). Never changed in place."""

    offset: Array
    covariance: Array

    def sd(self, index: int) -> float:
        """Standard deviation of one size."""
        return math.sqrt(max(float(self.covariance[index, index]), 0.0))


@dataclass(frozen=True)
class SizeEstimate:
    """One size as it is reported."""

    value: float
    sd: float
    unit: str


def channels(table: tuple[Size, ...]) -> tuple[int, ...]:
    """Places of the sizes by which something is compensated: the three gains and the adopted effects."""
    return (*range(len(GAINS)), *range(FIRST_EFFECT, len(table)))


@lru_cache(maxsize=8)
def size_table(vehicle: Vehicle, model: FanSurrogate) -> tuple[Size, ...]:
    """Every size of this vehicle and model, with the priors of the catalogue.

    A gain's prior is ``_HEAVY`` and the model's own scatter; its change per minute lets it follow a law whose
    form is wrong from place to place. Without a model it is 0 and stays there.
    """
    lever = max(float(np.abs(vehicle.fan_positions_m).max()), vehicle.rotor_radius_m)
    if is_empty(model):
        gain = 0.0
    else:
        gain = 1.0
    table = [
        Size(
            name=name,
            unit="1",
            as_modelled=1.0,
            mean=gain,
            sd=gain * math.hypot(_HEAVY, scatter),
            per_minute=0.15,
            low=-2.0,
            high=4.0,
        )
        for name, scatter in zip(GAINS, _scatter(model), strict=True)
    ]
    # Outputs tell less of the thrust than speeds do: a battery sags within minutes.
    if vehicle.telemetered:
        scale = 0.15
        sags = 0.02
    else:
        scale = 0.06
        sags = 0.1
    for row in _steady(lever, scale, sags, drag_prior(vehicle)):
        name, unit, as_modelled, mean, sd, per_minute, low, high = row
        table.append(
            Size(
                name=name,
                unit=unit,
                as_modelled=as_modelled,
                mean=mean,
                sd=sd,
                per_minute=per_minute,
                low=low,
                high=high,
            )
        )
    for k in effects_with_size(model):
        table.append(
            Size(
                name=model.effects[k].name,
                unit="1",
                as_modelled=1.0,
                mean=1.0,
                sd=_HEAVY,
                per_minute=0.1,
                low=-2.0,
                high=4.0,
            )
        )
    return tuple(table)


_Row = tuple[str, str, float, float, float, float, float, float]


def _steady(arm: float, scale: float, sags: float, drag: tuple[float, float]) -> list[_Row]:
    """Name, unit, value as modelled, mean, sd, change a minute, and bounds of what is no gain."""
    return [
        ("thrust_scale", "1", 1.0, 1.0, scale, sags, 0.4, 1.6),
        ("wind_north", "m/s", 0.0, 0.0, 4.0, 2.0, -25.0, 25.0),
        ("wind_east", "m/s", 0.0, 0.0, 4.0, 2.0, -25.0, 25.0),
        ("cg_offset_x", "m", 0.0, 0.0, 0.05 * arm, 0.005 * arm, -0.3 * arm, 0.3 * arm),
        ("cg_offset_y", "m", 0.0, 0.0, 0.05 * arm, 0.005 * arm, -0.3 * arm, 0.3 * arm),
        ("rotor_drag", "1", 0.0, *drag, 0.05, 0.0, 6.0),
        ("drag_above", "rotor radii", 0.0, 0.5, 0.7, 0.1, -3.0, 6.0),
        ("vertical_inflow", "1", 0.0, 4.0, 2.5, 0.5, -5.0, 20.0),
    ]


def drag_prior(vehicle: Vehicle) -> tuple[float, float]:
    """Momentum drag over that of momentum theory, and its standard deviation.

    A duct turns all of the stream it takes in, an open rotor a part of it.
    """
    ducted = vehicle.fans[0].lip_radius_m > 1.1 * vehicle.rotor_radius_m
    if ducted:
        return (1.0, 0.15)
    return (0.3, 0.5)


def _scatter(model: FanSurrogate) -> tuple[float, float, float]:
    """Unexplained share of the increments: of lift, level forces, moments."""
    calibration = model.calibration
    share = []
    for f, s in zip(calibration.floor, calibration.size, strict=True):
        if s > 0.0:
            share.append(min(f / s, 1.0))
        else:
            share.append(0.0)
    return share[2], max(share[0], share[1]), max(share[3], share[4])


def prior(table: tuple[Size, ...]) -> Sizes:
    """What is believed before any flight."""
    return Sizes(
        np.array([size.mean - size.as_modelled for size in table]),
        np.diag([size.sd * size.sd for size in table]),
    )


def estimates(table: tuple[Size, ...], sizes: Sizes) -> dict[str, SizeEstimate]:
    """Every size by its name."""
    return {
        size.name: SizeEstimate(size.as_modelled + float(sizes.offset[k]), sizes.sd(k), size.unit)
        for k, size in enumerate(table)
    }
