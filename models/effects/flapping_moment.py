"""Moment of the airflow on the rotors: blades that meet the wind on one side lift more there, and the disc leans.

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
    roll = np.zeros((*flow.shape, 6))
    pitch = np.zeros((*flow.shape, 6))
    roll[..., 3] = -flow * ctx.velocity[..., 1]
    pitch[..., 4] = flow * ctx.velocity[..., 0]
    return roll, pitch


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    flow = ctx.vehicle.rotor_radius_m * mean(ctx.mass_flow.sum(axis=-1))
    unit = ctx.weight * ctx.lever / 100.0
    roll = abs(p["roll"]) * flow / unit
    pitch = abs(p["pitch"]) * flow / unit
    return (
        f"at 1 m/s the airflow turns the vehicle with {pitch:.2g} % of weight times arm in pitch, "
        f"{roll:.2g} % in roll"
    )


EFFECT = Effect(
    name="flapping_moment",
    equation="dM = R sum sqrt(rho A T) (-r v_y, p v_x, 0)",
    sign="pitch > 0: nose up in forward flight; roll > 0: left side up when flying left",
    axes=("Mx", "My"),
    channels=("vn_m_s", "ve_m_s", "rpm_1"),
    excite="fly to and fro sideways and forward, faster than 1 m/s",
    coefficients=(
        Coefficient(name="roll", unit="1", low=-5.0, high=5.0, typical=0.5),
        Coefficient(name="pitch", unit="1", low=-5.0, high=5.0, typical=0.5),
    ),
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
