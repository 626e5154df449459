"""Air along the rotor axis: climbing, or tilting into wind, takes lift from a fan at the same speed; sinking adds.

Valid: slow climbs and descents, no vortex ring.
Source: blade-element momentum theory in climb and in forward flight: Leishman 2006, ch. 2.14 and 3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import mean, over, percent
from models.effects.search_hints import SearchHints
from models.effects.shown import Quantity, Shown
from models.vehicle import RHO_SEA_LEVEL
from models.vehicle_wrench import RPM_TO_RAD_S


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    tip = ctx.rpm * RPM_TO_RAD_S * ctx.vehicle.rotor_radius_m

    def loss(velocity: Array) -> Array:
        return ctx.lift(ctx.shared_thrust * velocity[..., 2] / np.maximum(tip, 1.0))

    # The wind's part along the axis: the vehicle moves against it.
    north, east = (-ctx.state.rotation[..., None, axis, :] for axis in (0, 1))
    # Level speed carries the fan's own stream away: less of it stands on the blades.
    level = (ctx.velocity[..., :2] ** 2).sum(axis=-1)[..., None] * np.ones(len(ctx.vehicle.fans))
    gain = ctx.lift(RHO_SEA_LEVEL * ctx.vehicle.disc_area_m2 * level)
    return loss(ctx.velocity[..., None, :]), loss(ctx.turning), loss(north), loss(east), gain


def _by_tilt(direction: str) -> Callable[[Context, Mapping[str, Array]], Array]:
    """Share of the lift that a tilt into the wind gives, by radian: the slope times the wind over the tip speed."""

    def of(ctx: Context, p: Mapping[str, Array]) -> Array:
        tip = mean(ctx.rpm) * RPM_TO_RAD_S * ctx.vehicle.rotor_radius_m
        return p[direction] / max(tip, 1.0)

    return of


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    tip = mean(ctx.rpm) * RPM_TO_RAD_S * ctx.vehicle.rotor_radius_m
    return f"a climb at 1 m/s takes {percent(p['slope'] / tip)} of the lift; sinking adds as much"


EFFECT = Effect(
    name="vertical_inflow",
    equation="dF_z = T (c v_up - (c w)_up + t (omega x r)_up) / (Omega R) - l rho A |v_xy|^2 per "
    "fan, w the wind, up along the rotor axis",
    sign="slope > 0: lift is lost in a climb; level > 0: and gained in level flight; north, east: "
    "slope times the wind, said as what a tilt of the thrust to that side gains of the lift (w c "
    "/ Omega R)",
    axes=("Fz",),
    channels=("vd_m_s", "pitch_rad", "roll_rad", "rpm_1"),
    excite="climb and sink at 0.5 m/s or more, away from the ground",
    coefficients=(
        Coefficient(name="slope", unit="1", low=0.2, high=20.0, typical=2.5, centre=4.0),
        Coefficient(name="turning", unit="1", low=-20.0, high=20.0, typical=4.0, optional=True),
        Coefficient(
            name="north",
            unit="m/s",
            low=-200.0,
            high=200.0,
            typical=16.0,
            belongs_to=BelongsTo.WEATHER,
            optional=True,
        ),
        Coefficient(
            name="east",
            unit="m/s",
            low=-200.0,
            high=200.0,
            typical=16.0,
            belongs_to=BelongsTo.WEATHER,
            optional=True,
        ),
        Coefficient(
            name="level", unit="1", low=-0.2, high=1.5, typical=0.2, centre=0.15, optional=True
        ),
    ),
    main=("slope", "north", "east"),
    wrenches=_wrenches,
    law=True,
    every_flight=True,
    search=SearchHints(
        chance=0.3,
    ),
    aliases=("range_offset",),
    shown=Shown(
        drawn=lambda ctx, axis: over(
            "climb along the rotor axis [m/s]", -ctx.velocity[..., 2], axis
        ),
        in_words=_words,
        # The flight shows the slope times the wind, not the wind.
        quantities=(
            Quantity(
                instead_of="north", name="lift_by_tilt_north", unit="1/rad", of=_by_tilt("north")
            ),
            Quantity(
                instead_of="east", name="lift_by_tilt_east", unit="1/rad", of=_by_tilt("east")
            ),
        ),
    ),
)
