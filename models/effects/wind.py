"""Steady wind, constant in the world: momentum drag of the fans, with their drag on the own motion.

Valid: speeds well below the induced velocity.
Source: momentum drag of a lifting disc: Pflimlin, Binetti, Soueres, Hamel & Trouchet 2010, Control Engineering Practice
18(3), 209.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.effects.effect import BelongsTo, Coefficient, Context, Drawn, Effect, Shape, Shown
from models.effects.pictures import compass, mean, over
from models.frames import Array


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    above, rotation, flow = shape[0] * ctx.vehicle.rotor_radius_m, ctx.state.rotation, ctx.mass_flow
    north, east = (ctx.level_drag(-rotation[..., None, i, :], flow, above) for i in (0, 1))
    return north, east, *ctx.own_drag(above)


def _speed(found: Mapping[str, tuple[float, float, float]]) -> str | None:
    """The wind by the vehicle's own drag, where that is clearly not momentum theory's, in which it is given."""
    drag, low, high = found["own_motion"]
    if low <= 0.0 or low <= 1.0 <= high:
        return None
    north, east = found["north"][0] / drag, found["east"][0] / drag
    return (
        f"the vehicle's drag is {drag:.2g} of momentum theory's, in which `north` and `east` are given; with that "
        f"drag the wind blows with {north:.2g} m/s to the north and {east:.2g} m/s to the east"
    )


def _drawn(ctx: Context, axis: str) -> Drawn:
    r = ctx.state.rotation
    heading = np.degrees(np.arctan2(r[..., 1, 0], r[..., 0, 0])) % 360.0
    return over("heading [deg]", heading, axis)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    # The force is known well; the speed behind it hangs on the vehicle's drag.
    north, east = p["north"], p["east"]
    force = mean(ctx.mass_flow.sum(axis=-1)) * np.hypot(north, east)
    return f"the wind pushes with {force:.2g} N from the {compass(-north, -east)}"


EFFECT = Effect(
    name="wind",
    belongs_to=BelongsTo.WEATHER,
    equation="dF_xy = sum (sqrt(rho A T) (w - k v - t omega x r) - s rho A v_down v)_xy, above the fans' references",
    sign="north, east > 0: the air moves to the north, east",
    axes=("Fx", "Fy", "Mx", "My"),
    channels=("yaw_rad", "vn_m_s", "ve_m_s", "rpm_1"),
    excite="turn through 180 degrees or more in hover",
    coefficients=(
        Coefficient("north", "m/s", -25.0, 25.0, typical=4.0),
        Coefficient("east", "m/s", -25.0, 25.0, typical=4.0),
        Coefficient("own_motion", "1", 0.0, 3.0, typical=0.7, centre=0.7, belongs_to=BelongsTo.VEHICLE),
        Coefficient("turning", "1", -6.0, 6.0, belongs_to=BelongsTo.VEHICLE),
        Coefficient("sinking", "1", -1.0, 2.0, typical=0.3, centre=0.3, optional=True, belongs_to=BelongsTo.VEHICLE),
    ),
    wrenches=_wrenches,
    shapes=(Shape("above_radii", "1", free_at_zero=True, tried=(0.0, 0.25, 0.5, 0.75, 1.0, 1.3, 1.7)),),
    aliases=("imu_bias", "rotor_drag"),
    main=("north", "east"),
    chance=0.05,
    contains=("rotor_drag",),
    shown=Shown(_drawn, _words, remark=_speed),
)
