"""A ceiling draws the vehicle up: image of the rotor's inflow, the length scale fitted.

Valid: gap above 0.2 radii.
Source: Hsiao & Chirarattananon 2019, IEEE/ASME Trans. Mechatronics 24(5), 2316-2327, arXiv:1905.04632.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse
from models.effects.lacking import where_seen
from models.effects.pictures import fan_mean, more, nearest, over
from models.effects.shown import Shown


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    gap = np.maximum(ctx.state.ceiling_m, 0.02) / (shape[0] * ctx.vehicle.rotor_radius_m)
    return (ctx.lift(ctx.shared_thrust * _extra(gap)),)


def _extra(gap: Array) -> Array:
    """More lift as a share, by the gap over the scale."""
    return (0.5 + 0.5 * np.sqrt(1.0 + 1.0 / (8.0 * gap * gap))) ** (2.0 / 3.0) - 1.0


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    z = max(nearest(ctx.state.ceiling_m), 0.02)
    extra = p["gain"] * float(_extra(np.array(z / (p["scale"] * ctx.vehicle.rotor_radius_m))))
    return f"at {z:.2f} m below the ceiling the lift is {more(extra)}"


EFFECT = Effect(
    name="ceiling",
    belongs_to=BelongsTo.PLACE,
    equation="dF_z = -g sum T (gamma(z/a)^(2/3) - 1), gamma = 1/2 + 1/2 sqrt(1 + (a R/z)^2/8)",
    sign="gain > 0: drawn to the ceiling",
    axes=("Fz",),
    channels=("range_up_m", "rpm_1"),
    excite="hover at three gaps below two radii under the ceiling, with an up-looking rangefinder",
    coefficients=(
        Coefficient(name="gain", unit="1", low=0.05, high=10.0, typical=0.6, centre=1.0),
    ),
    wrenches=_wrenches,
    in_flight=FlightUse(gain=True),
    shapes=(Shape(name="scale", unit="1", tried=(0.5, 0.75, 1.0, 1.5, 2.5)),),
    lacking=where_seen("ceiling_m", "no rangefinder saw a ceiling"),
    aliases=("thrust_scale",),
    shown=Shown(
        drawn=lambda ctx, axis: over("gap to the ceiling [m]", fan_mean(ctx.state.ceiling_m), axis),
        in_words=_words,
    ),
)
