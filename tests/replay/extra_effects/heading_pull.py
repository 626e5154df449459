"""A side force that goes with the heading, as of a taut cable: no effect of the catalogue, made for a test.

Valid: everywhere.
Source: made for a test.
"""

from __future__ import annotations

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    rotation = ctx.state.rotation
    heading = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    out = np.zeros((*heading.shape, 6))
    out[..., 1] = ctx.weight * np.sin(2.0 * heading)
    return (out,)


EFFECT = Effect(
    name="heading_pull",
    belongs_to=BelongsTo.PLACE,
    equation="dF_y = a W sin(2 yaw)",
    sign="a > 0: to the right at a heading of 45 degrees",
    axes=("Fy",),
    channels=("yaw_rad",),
    excite="turn on the spot",
    coefficients=(Coefficient(name="share", unit="1", low=-1.0, high=1.0, typical=0.1),),
    wrenches=_wrenches,
)
