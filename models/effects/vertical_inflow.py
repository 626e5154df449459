"""Climbing takes lift from a fan at the same speed, sinking adds some."""

from __future__ import annotations

import numpy as np

from models.effects.effect import DOWNWARD, Coefficient, Context, Effect, columns
from models.frames import Array
from models.vehicle_wrench import RPM_TO_RAD_S


def _regressors(ctx: Context, _: tuple[float, ...]) -> Array:
    tip = ctx.rpm * RPM_TO_RAD_S * ctx.vehicle.rotor_radius_m

    def loss(velocity: Array) -> Array:
        return ctx.push((ctx.thrust * -velocity[..., 2] / np.maximum(tip, 1.0))[..., None] * DOWNWARD)

    return columns(loss(ctx.velocity[..., None, :]), loss(ctx.turning))


EFFECT = Effect(
    name="vertical_inflow",
    equation="dF_z = T (c v_up + t (omega x r)_up) / (Omega R) per fan",
    sign="slope > 0: lift is lost in a climb",
    source="blade-element momentum theory in climb: Leishman 2006, ch. 3",
    valid="slow climbs and descents, no vortex ring",
    axes=("Fz",),
    channels=("vd_m_s", "rpm_1"),
    excite="climb and sink at 0.5 m/s or more, away from the ground",
    coefficients=(Coefficient("slope", "1", 0.2, 20.0, typical=4.0), Coefficient("turning", "1", -20.0, 20.0, typical=4.0)),
    main=("slope",),
    regressors=_regressors,
    aliases=("range_offset",),
)
