"""Climbing takes lift from a fan at the same speed, sinking adds some."""

from __future__ import annotations

import numpy as np

from models.air import RPM_TO_RAD_S
from models.effects._base import DOWNWARD, Coefficient, Context, Effect, columns
from models.vehicle import RHO_SEA_LEVEL
from models.wrench import Array


def _regressors(ctx: Context, _: tuple[float, ...]) -> Array:
    tip = ctx.rpm * RPM_TO_RAD_S * ctx.vehicle.rotor_radius_m
    size = RHO_SEA_LEVEL * ctx.vehicle.disc_area_m2 * tip * -ctx.fan_velocity[..., 2]
    scale = ctx.thrust / np.maximum(RHO_SEA_LEVEL * ctx.vehicle.disc_area_m2 * tip**2, 1e-9)
    return columns(ctx.push((size * scale)[..., None] * DOWNWARD))


EFFECT = Effect(
    name="vertical_inflow",
    equation="dF_z = c T v_up / (Omega R) per fan",
    sign="slope > 0: lift is lost in a climb",
    source="physics.md E13, blade-element theory",
    valid="slow climbs and descents, no vortex ring",
    axes=("Fz",),
    channels=("vd_m_s", "rpm_1"),
    excite="climb and sink at 0.5 m/s or more, away from the ground",
    coefficients=(Coefficient("slope", "1", 0.2, 20.0),),
    regressors=_regressors,
    aliases=("range_offset",),
)
