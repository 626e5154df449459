"""Drag of the fans on the vehicle's own motion: the stream they turn, and the blades in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.effects._base import Coefficient, Context, Effect, Shape, columns
from models.wrench import Array


def _regressors(ctx: Context, shape: tuple[float, ...]) -> Array:
    level = -np.array(ctx.fan_velocity)
    level[..., 2] = 0.0
    force = ctx.mass_flow[..., None] * level
    return columns(ctx.push(force, shape[0] * ctx.vehicle.rotor_radius_m))


def _grid(_: Context) -> Sequence[tuple[float, ...]]:
    return ((0.0,), (0.5,), (1.0,))


EFFECT = Effect(
    name="rotor_drag",
    equation="dF_xy = -c mdot v_xy, mdot = sum sqrt(rho A T)",
    sign="drag > 0: against the motion",
    source="physics.md E11 (Faessler arXiv:1712.02402)",
    valid="speeds well below the induced velocity",
    axes=("Fx", "Fy", "Mx", "My"),
    channels=("vn_m_s", "ve_m_s", "rpm_1"),
    excite="fly to and fro sideways and forward, faster than 0.5 m/s",
    coefficients=(Coefficient("drag", "1", 0.05, 6.0),),
    regressors=_regressors,
    shapes=(Shape("above_radii", "1"),),
    shape_grid=_grid,
    aliases=("body_drag", "wind"),
)
