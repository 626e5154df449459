"""Measured minus modelled wrench of one block of flight, and what each size would add to it.

The formulas are those of diagnosis (``models.common.frames.wrench_of_motion``, the surrogate,
``models.vehicle_wrench.vane_wrench``); the one filter that both sides go through is here a mean over the block in place
of a Gaussian over the record, and the delay of rotor speeds is a lag of the accelerometer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.adaptation import sizes as at
from companion.adaptation import steady
from companion.adaptation.block import AXES, Block, measured
from companion.adaptation.vanes import vanes_wrench
from companion.disturbance.about_cg import about_cg
from models.common.frames import Array, Rows
from models.vehicle import Vehicle

_EQUAL = 1e-9
"""N m per kg: rotors that never differ are copies of one number, and tell no moments, as in diagnosis."""


@dataclass(frozen=True, slots=True)
class BlockResidual:
    """One block: ``residual`` (5,) with all sizes as modelled, ``regressors`` (5, n), ``modelled`` (5,)."""

    residual: Array
    regressors: Array
    modelled: Array


def block_residual(
    block: Block,
    vehicle: Vehicle,
    rotation: Rows,
    bearing_rad: float,
    sizes: int,
    wind_ne: tuple[float, float] = (0.0, 0.0),
) -> BlockResidual:
    """The residual of a full block. ``rotation`` FRD -> NED and the wall's bearing at its end; ``wind_ne`` as believed
    [m/s]; ``sizes``: how many there are."""
    assert block.at_fans is not None
    assert block.effects is not None
    share = 1.0 / block.samples
    near, free = (block.at_fans * share).tolist()
    effects = (block.effects * share).tolist()
    above = [
        [x - y for x, y in zip(one, alone, strict=True)]
        for one, alone in zip(near, free, strict=True)
    ]
    lift, pull, tilt = about_cg(vehicle, above, bearing_rad)
    alone = [a + b + c for a, b, c in zip(*about_cg(vehicle, free, bearing_rad), strict=True)]
    declared_n = alone[2] + sum([effect[2] for effect in effects])
    together = zip(lift, pull, tilt, alone, *effects, strict=True)
    modelled = [sum(column) for column in together][:AXES]
    if vehicle.vanes:
        outputs_us = [v * share for v in block.vanes_us]
        of_vanes = vanes_wrench(vehicle, outputs_us, [fan[2] for fan in near])
        declared_n += of_vanes[2]
        modelled = [a + b for a, b in zip(modelled, of_vanes, strict=False)]
    seen = measured(block, vehicle)
    if not vehicle.vanes and abs(alone[3]) + abs(alone[4]) < _EQUAL * vehicle.mass_kg:
        seen = [*seen[:3], math.nan, math.nan]
    unknown = [0.0] * (sizes - at.THRUST)
    rows = [[a, b, c, *unknown] for a, b, c in zip(lift[:AXES], pull, tilt, strict=False)]
    for k, effect in enumerate(effects, at.FIRST_EFFECT):
        for row, value in zip(rows, effect, strict=False):
            row[k] = value
    means = steady.BlockMeans(
        rotation=rotation,
        velocity=_through_the_air([v * share for v in block.motion[6:]], rotation, wind_ne),
        free=alone,
        declared_n=declared_n,
        tip_m_s=block.tip_m_s * share,
    )
    steady.fill(rows, vehicle, means)
    residual = [a - b for a, b in zip(seen, modelled, strict=True)]
    return BlockResidual(np.array(residual), np.array(rows), np.array(modelled))


def _through_the_air(
    velocity: Sequence[float], rotation: Rows, wind_ne: tuple[float, float]
) -> tuple[float, float, float]:
    """Along x and y over ground, along the rotors' axis through the air; ``velocity`` and ``wind_ne`` NED [m/s]."""
    (x_north, y_north, z_north), (x_east, y_east, z_east), (x_down, y_down, z_down) = rotation
    north, east, down = velocity
    wind_north, wind_east = wind_ne
    return (
        north * x_north + east * x_east + down * x_down,
        north * y_north + east * y_east + down * y_down,
        (north - wind_north) * z_north + (east - wind_east) * z_east + down * z_down,
    )
