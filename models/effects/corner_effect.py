"""What wall and ground do together and neither does alone.

Valid: h above 0.8 radii, d above 0.2 radii.
Source: form: least squares on 90 places of the data set corner_cfd, R2 0.88, 0.58 and 0.61 (without b: 0.57, 0.18 and
0.61); that it exists: Ai, Xu, Xiang, Fan & Zhang 2020, Sensors 20(20), 5805, figures 8 to 10.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context, decay
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse, Reach
from models.effects.pictures import nearest, over_surfaces, percent
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    length = shape[0] * ctx.vehicle.rotor_radius_m
    bearing = ctx.state.wall_bearing_rad
    h = ctx.state.h_m
    d = ctx.state.d_m
    size = ctx.shared_thrust * decay(h, length) * decay(d, length)
    with np.errstate(invalid="ignore"):
        higher = np.where(size > 0.0, size * h / length, 0.0)
    pull, tilt = ([of(s, bearing) for s in (size, higher)] for of in (ctx.pull, ctx.tilt))
    return *pull, ctx.lift(size), ctx.lift(higher), *tilt


def _lacking(ctx: Context) -> str | None:
    both = np.isfinite(ctx.state.h_m) & np.isfinite(ctx.state.d_m)
    if both.any():
        return None
    return "ground and wall were never seen together"


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    length = p["length_radii"] * ctx.vehicle.rotor_radius_m
    h = nearest(ctx.state.h_m)
    d = nearest(ctx.state.d_m)
    near = float(np.exp(-(h + d) / length))
    pull, lift = ((p[name] + p[f"{name}_rise"] * h / length) * near for name in ("pull", "lift"))
    if pull > 0.0:
        way = "to the wall"
    else:
        way = "off the wall"
    if lift > 0.0:
        change = "lifts"
    else:
        change = "takes lift"
    return (
        f"in the corner the air pushes {way} with {percent(pull)} of the thrust and {change} "
        f"by {percent(lift)}"
    )


EFFECT = Effect(
    name="corner_effect",
    equation="F(h,d) - F(h,inf) - F(inf,d) + F(inf,inf) = sum T (a + b h/L) exp(-(h + d)/L), for "
    "pull, lift, tilt/R",
    sign="pull, tilt > 0: towards the wall; lift > 0: more lift; rise > 0: more of it higher up",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=(
        "range_down_m",
        "range_right_m",
        "range_left_m",
        "range_forward_m",
        "range_back_m",
        "rpm_1",
    ),
    excite="descend and climb beside a wall, slowly, at two distances",
    coefficients=tuple(
        Coefficient(name=f"{part}{rise}", unit="1", low=-2.0, high=2.0, typical=typical)
        for part, typical in (("pull", 0.08), ("lift", 0.1), ("tilt", 0.1))
        for rise in ("", "_rise")
    ),
    wrenches=_wrenches,
    in_flight=FlightUse(gain=True, reach=Reach.CORNER),
    shapes=(Shape(name="length_radii", unit="1", tried=(0.7, 1.2, 2.0)),),
    lacking=_lacking,
    law=True,
    search=SearchHints(
        chance=lambda ctx: ctx.by_model(0.05, 0.3),
    ),
    aliases=("wall_effect", "ground_effect"),
    shown=Shown(drawn=over_surfaces, in_words=_words),
)
