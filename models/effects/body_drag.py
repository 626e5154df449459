"""Pressure drag of the body: with the square of the speed.

Valid: still air.
Source: Hoerner 1965, Fluid-Dynamic Drag, ch. 3: pressure drag of bluff bodies.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import force_words, over_speed
from models.effects.shown import Shown
from models.vehicle import RHO_SEA_LEVEL


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    v = ctx.velocity
    discs = ctx.vehicle.disc_area_m2 * len(ctx.vehicle.fans)
    speed = np.linalg.norm(v, axis=-1, keepdims=True)
    pressure = -0.5 * RHO_SEA_LEVEL * discs * speed * v
    return tuple(pressure[..., i, None] * np.eye(6)[i] for i in range(3))


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    pressure = 0.5 * RHO_SEA_LEVEL * ctx.vehicle.disc_area_m2 * len(ctx.vehicle.fans) * 3.0**2
    front = force_words(ctx, p["front"] * pressure)
    side = force_words(ctx, p["side"] * pressure)
    return f"the drag of the body at 3 m/s is {front} forward, {side} sideways"


EFFECT = Effect(
    name="body_drag",
    equation="dF_i = -rho/2 c_i A |v| v_i, A the area of all discs",
    sign="c > 0: against the motion",
    axes=("Fx", "Fy", "Fz"),
    channels=("vn_m_s", "ve_m_s"),
    excite="fly at more than 2 m/s forward and sideways",
    coefficients=(
        Coefficient(name="front", unit="1", low=-0.1, high=10.0, typical=0.5),
        Coefficient(name="side", unit="1", low=-0.1, high=10.0, typical=0.5),
        Coefficient(name="top", unit="1", low=-0.1, high=10.0, typical=0.5, optional=True),
    ),
    wrenches=_wrenches,
    main=("front", "side"),
    law=True,
    aliases=("rotor_drag",),
    shown=Shown(drawn=over_speed, in_words=_words),
)
