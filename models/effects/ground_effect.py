"""More (or less) ground effect than the model has; the length over which it fades is fitted.

Valid: h above 0.3 radii.
Source: exponential form: He & Leang 2019, J. Dynamic Systems, Measurement and Control 141(7), 071013; length fitted.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context, decay
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse
from models.effects.lacking import where_seen
from models.effects.pictures import more, nearest, over_height
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    size = ctx.shared_thrust * decay(ctx.state.h_m, shape[0] * ctx.vehicle.rotor_radius_m)
    return (ctx.lift(size),)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    length = p["length_radii"] * ctx.vehicle.rotor_radius_m
    h = nearest(ctx.state.h_m)
    extra = p["gain"] * float(np.exp(-h / length))
    half = f"{0.69 * length:.2f} m higher half of that"
    return f"at {h:.2f} m above ground the lift is {more(extra)} than modelled, {half}"


EFFECT = Effect(
    name="ground_effect",
    equation="dF_z = -g sum T exp(-h/L)",
    sign="gain > 0: more lift near the ground than the model has",
    axes=("Fz",),
    channels=("range_down_m", "down_m", "rpm_1"),
    excite="hover at three heights or more between 0.7 and 4 radii",
    coefficients=(
        Coefficient(name="gain", unit="1", low=-1.0, high=3.0, typical=0.15, centre=0.15),
    ),
    wrenches=_wrenches,
    in_flight=FlightUse(gain=True),
    shapes=(Shape(name="length_radii", unit="1", tried=(0.3, 0.45, 0.7, 1.0, 1.4, 2.0)),),
    lacking=where_seen("h_m", "no height over ground in the log"),
    law=True,
    search=SearchHints(
        chance=lambda ctx: ctx.by_model(0.04, 0.3),
    ),
    aliases=("range_offset", "partial_ground"),
    shown=Shown(drawn=over_height, in_words=_words),
)
