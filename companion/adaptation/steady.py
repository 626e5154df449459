"""What a unit of each size that every vehicle has does in a block: the regressors of their effects, in plain floats.

The catalogue's regressors (``models/effects``) take arrays of a whole flight, a thrust of each fan, and the product of
every sample. Here is one block: all fans share the lift, and products are those of the block's means. The tests hold
both within 2 % of each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from companion.adaptation import sizes as at
from models.common.frames import Rows
from models.vehicle import RHO_SEA_LEVEL, Vehicle

Row = list[float]
"""What every size adds to one axis."""


@dataclass(frozen=True, slots=True)
class BlockMeans:
    """Means over a block, of what steady sizes act by."""

    rotation: Rows
    """FRD -> NED, at its end."""
    velocity: tuple[float, float, float]
    """Along body x and y over ground, along the rotors' axis through the air [m/s]."""
    free: Row
    """(6,): wrench of the rotors in free air, body FRD about the CG."""
    declared_n: float
    """Vertical force of rotors, vanes and adopted effects in free air, body FRD."""
    tip_m_s: float
    """Speed of the blade tips."""


def fill(rows: list[Row], vehicle: Vehicle, means: BlockMeans) -> None:
    """Fill in the columns of steady sizes; ``rows``: Fx Fy Fz Mx My.

    With T the lift, m = sum sqrt(rho A T) the mass flow, z the fans' height about the CG, R the radius of a rotor:

        thrust_scale        Fz = -T
        wind_north, _east   F = m e_xy, M = z (-Fy, Fx), e the direction in the body
        cg_offset_x, _y     M = -r x F of rotors and vanes
        rotor_drag          F = -m v_xy, M = z (-Fy, Fx)
        drag_above          M = R (Fy, -Fx) of that drag
        vertical_inflow     Fz = -T v_z / (Omega R)
    """
    fx, fy, fz, mx, my = rows
    lift = max(-means.free[2], 0.0)
    flow = mass_flow(vehicle, lift)
    above = mean_height(vehicle)
    radius = vehicle.rotor_radius_m
    fz[at.THRUST] = means.free[2]
    for column, (x, y, _) in ((at.NORTH, means.rotation[0]), (at.EAST, means.rotation[1])):
        fx[column] = flow * x
        fy[column] = flow * y
        mx[column] = -above * flow * y
        my[column] = above * flow * x
    my[at.CG_X] = means.declared_n
    mx[at.CG_Y] = -means.declared_n
    forward, right, down = means.velocity
    drag_x = -flow * forward
    drag_y = -flow * right
    fx[at.DRAG] = drag_x
    fy[at.DRAG] = drag_y
    mx[at.DRAG] = -above * drag_y
    my[at.DRAG] = above * drag_x
    mx[at.DRAG_ARM] = radius * drag_y
    my[at.DRAG_ARM] = -radius * drag_x
    fz[at.INFLOW] = -lift * down / max(means.tip_m_s, 1.0)


def mass_flow(vehicle: Vehicle, lift_n: float) -> float:
    """Sum over the fans of momentum theory's mass flow in hover, sqrt(rho A T) [kg/s], at equal lift."""
    fans = len(vehicle.fans)
    return fans * math.sqrt(RHO_SEA_LEVEL * vehicle.disc_area_m2 * lift_n / fans)


@lru_cache(maxsize=8)
def mean_height(vehicle: Vehicle) -> float:
    """Body z of the fans' reference points, averaged [m]."""
    return float(vehicle.fan_positions_m[:, 2].mean())
