"""More (or less) pull and tilt towards the wall, and lift beside it, than the model has.

Valid: d above 0.2 radii.
Source: signs and range: Ai, Xu, Xiang, Fan & Zhang 2020, Sensors 20(20), 5805, section 2. That lift
changes, too: Thrust variations in small rotors due to corner and vertex effects on the ground side,
2025, The Aeronautical Journal. No closed form is published.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context, decay
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse, Reach
from models.effects.lacking import where_seen
from models.effects.pictures import nearest, over_first_wall, pull_words
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    size = ctx.shared_thrust * decay(ctx.state.d_m, shape[0] * ctx.vehicle.rotor_radius_m)
    bearing = ctx.state.wall_bearing_rad
    return ctx.pull(size, bearing), ctx.tilt(size, bearing), ctx.lift(size)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    d = nearest(ctx.state.d_m)
    share = p["pull"] * float(np.exp(-d / (p["length_radii"] * ctx.vehicle.rotor_radius_m)))
    said = f"at {d:.2f} m the wall {pull_words(share)}"
    if ctx.vehicle.mass_assumed:
        return said
    return f"{said} ({abs(share) * ctx.weight:.2g} N)"


EFFECT = Effect(
    name="wall_effect",
    equation="dF = p sum T exp(-d/L) towards the wall, dM = t R sum T exp(-d/L), dL = l sum T "
    "exp(-d/L) more lift",
    sign="pull > 0: towards the wall; tilt > 0: tilts towards the wall; lift > 0: more lift",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=("range_right_m", "range_left_m", "range_forward_m", "range_back_m", "rpm_1"),
    excite="approach and leave a wall between 0.3 and 4 radii, with and without ground near",
    coefficients=(
        Coefficient(name="pull", unit="1", low=-1.0, high=1.0, typical=0.08),
        Coefficient(name="tilt", unit="1", low=-2.0, high=2.0, typical=0.15),
        Coefficient(name="lift", unit="1", low=-1.0, high=1.0, typical=0.05, optional=True),
    ),
    # What changes the lift alone beside a wall is no wall's law.
    main=("pull", "tilt"),
    wrenches=_wrenches,
    in_flight=FlightUse(gain=True, reach=Reach.WALL),
    shapes=(Shape(name="length_radii", unit="1", tried=(0.4, 0.7, 1.1, 1.7)),),
    lacking=where_seen("d_m", "no wall was seen"),
    law=True,
    search=SearchHints(
        chance=lambda ctx: ctx.by_model(0.05, 0.3),
    ),
    aliases=("contact", "wind"),
    shown=Shown(drawn=over_first_wall, in_words=_words),
)
