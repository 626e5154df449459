"""Moment of the airflow on the rotors: blades that meet the wind on one side lift more there, and the disc leans.

Rotors are round: forward and sideways have one coefficient.

Valid: speeds well below that of the blade tips; a stiff hub, or blades that bend.
Source: Mahony, Kumar & Corke 2012, IEEE Robotics & Automation Magazine 19(3), 20-32, section on blade flapping; hub
moment of a stiff rotor: Leishman 2006, Principles of Helicopter Aerodynamics, ch. 4.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import mean, over
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    flow = ctx.vehicle.rotor_radius_m * ctx.mass_flow.sum(axis=-1)
    wrench = np.zeros((*flow.shape, 6))
    wrench[..., 3] = -flow * ctx.velocity[..., 1]
    wrench[..., 4] = flow * ctx.velocity[..., 0]
    return (wrench,)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    flow = ctx.vehicle.rotor_radius_m * mean(ctx.mass_flow.sum(axis=-1))
    percent = 100.0 * abs(p["moment"]) * flow / (ctx.weight * ctx.lever)
    return f"at 1 m/s the airflow turns the vehicle with {percent:.2g} % of weight times arm"


EFFECT = Effect(
    name="flapping_moment",
    equation="dM = m R sum sqrt(rho A T) (-v_y, v_x, 0)",
    sign="moment > 0: nose up in forward flight, left side up when flying left",
    axes=("Mx", "My"),
    channels=("vn_m_s", "ve_m_s", "rpm_1"),
    excite="fly to and fro sideways and forward, faster than 1 m/s",
    coefficients=(Coefficient(name="moment", unit="1", low=-5.0, high=5.0, typical=0.5),),
    together=("Mx", "My"),
    wrenches=_wrenches,
    search=SearchHints(
        needs_moments=True,
        chance=0.01,
    ),
    aliases=("rotor_drag",),
    shown=Shown(
        drawn=lambda ctx, axis: over("speed forward [m/s]", ctx.velocity[..., 0], axis),
        in_words=_words,
    ),
)
