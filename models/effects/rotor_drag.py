"""Drag of the fans on the vehicle's own motion: the stream they turn, and the blades in it.

Valid: speeds well below the induced velocity.
Source: Faessler, Franchi & Scaramuzza 2018, IEEE Robotics and Automation Letters 3(2), 620-626, arXiv:1712.02402;
flapping with the inflow: Leishman 2006, ch. 4.
"""

from __future__ import annotations

from collections.abc import Mapping

from models.common.frames import Array
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import force_words, mean, over_speed
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

HUBS_RADII = 1.0
"""A hub may stand so much higher than its file says [rotor radii]: files give it roughly."""


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    return ctx.own_drag(shape[0] * ctx.vehicle.rotor_radius_m)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    force = p["drag"] * mean(ctx.mass_flow.sum(axis=-1))
    said = f"the drag of the rotors at 1 m/s is {force_words(ctx, force)}"
    above = p["above_radii"]
    if above <= HUBS_RADII:
        return said
    # A drag c that acts h radii higher has the moments of flapping_moment of c h.
    beyond = p["drag"] * (above - HUBS_RADII)
    return (
        f"{said}; it acts {above:.2g} radii above the hubs, too high for their drag alone: part of "
        f"its moment is that of the airflow on the blades (flapping_moment of {beyond:.2g})"
    )


EFFECT = Effect(
    name="rotor_drag",
    equation="dF_xy = -sum (sqrt(rho A T) (c v + t omega x r) + s rho A v_down v)_xy per fan",
    sign="drag > 0: against the motion; sinking > 0: and more in a descent, as the disc flaps "
    "back further",
    axes=("Fx", "Fy", "Mx", "My"),
    channels=("vn_m_s", "ve_m_s", "rpm_1"),
    excite="fly to and fro sideways and forward, faster than 0.5 m/s",
    coefficients=(
        Coefficient(name="drag", unit="1", low=0.05, high=6.0, typical=1.0),
        Coefficient(name="turning", unit="1", low=-6.0, high=6.0),
        Coefficient(
            name="sinking", unit="1", low=-1.0, high=2.0, typical=0.3, centre=0.3, optional=True
        ),
    ),
    wrenches=_wrenches,
    shapes=(
        Shape(
            name="above_radii",
            unit="1",
            free_at_zero=True,
            tried=(0.0, 0.25, 0.5, 0.75, 1.0, 1.3, 1.7),
        ),
    ),
    law=True,
    every_vehicle=True,
    search=SearchHints(
        chance=0.3,
    ),
    aliases=("body_drag", "wind"),
    main=("drag",),
    shown=Shown(drawn=over_speed, in_words=_words),
)
