"""A second wall besides the one the model knows: its pull and tilt, and the loss of lift in the vertex.

Valid: two walls at right angles.
Source: wall attraction and tilt of the first wall, added for a second one; no closed form is published.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context, decay
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse, Reach
from models.effects.lacking import where_seen
from models.effects.pictures import nearest, over_second_wall, pull_words
from models.effects.shown import Shown


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    length = shape[0] * ctx.vehicle.rotor_radius_m
    d = ctx.state.second_d_m
    bearing = ctx.state.second_bearing_rad
    size = ctx.shared_thrust * decay(d, length)
    both = ctx.shared_thrust * decay(
        np.maximum(d, 0.0) + np.maximum(ctx.state.d_m, 0.0), 3.0 * length
    )
    return ctx.pull(size, bearing), ctx.tilt(size, bearing), ctx.lift(size), ctx.lift(-both)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    d = nearest(ctx.state.second_d_m)
    share = p["pull"] * float(np.exp(-d / (p["length_radii"] * ctx.vehicle.rotor_radius_m)))
    return f"at {d:.2f} m the second wall {pull_words(share)}"


EFFECT = Effect(
    name="second_wall",
    belongs_to=BelongsTo.PLACE,
    equation="at its bearing (pull, R tilt, lift) sum T exp(-d2/L); loss of lift in the vertex "
    "sum T exp(-(d+d2)/3L)",
    sign="pull, tilt > 0: towards the second wall; loss > 0: less lift in the vertex",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=("range_forward_m", "range_right_m", "range_back_m", "range_left_m", "rpm_1"),
    excite="approach the second wall at several distances from the first",
    coefficients=(
        Coefficient(name="pull", unit="1", low=-1.0, high=1.0, typical=0.1),
        Coefficient(name="tilt", unit="1", low=-2.0, high=2.0, typical=0.2),
        Coefficient(name="lift", unit="1", low=-1.0, high=1.0, typical=0.1),
        Coefficient(name="loss", unit="1", low=-1.0, high=1.0, typical=0.1),
    ),
    wrenches=_wrenches,
    in_flight=FlightUse(gain=True, reach=Reach.WALL),
    shapes=(Shape(name="length_radii", unit="1", tried=(0.5, 0.9, 1.4)),),
    lacking=where_seen("second_d_m", "no second wall was seen by a second horizontal rangefinder"),
    aliases=("wall_effect",),
    shown=Shown(drawn=over_second_wall, in_words=_words),
)
