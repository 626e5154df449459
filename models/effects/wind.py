"""Steady wind, constant in the world: momentum drag of the fans, with their drag on the own motion.

Valid: speeds well below the induced velocity.
Source: momentum drag of a lifting disc: Pflimlin, Binetti, Soueres, Hamel & Trouchet 2010, Control Engineering Practice
18(3), 209. Lift that air across the disc gives: Glauert 1926, ARC R&M 1026; Leishman 2006, ch. 2.14.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.adopted_effect import AdoptedEffect
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import compass, force_words, mean, over
from models.effects.search_hints import SearchHints
from models.effects.shown import Drawn, Quantity, Shown

WINDY_DAYS = 0.8
"""Share of the time in which air outdoors moves by more than 1 m/s, 10 m up: a Rayleigh distribution about 2.5 m/s has
0.88, the lower air is calmer (Manwell, McGowan & Rogers 2009, Wind Energy Explained, 2.4)."""
LIFT = 0.03
"""Share of the lift that a wind of 4 m/s gives at one rotor speed, c (v_i(0) - v_i(V)) / (Omega R) with the slope
c = 4 of the inflow: 0.024 to 0.068 for six vehicles of 0.03 to 20 kg (Glauert 1926)."""
LEAST_DRAG = 0.02
"""Share of momentum theory's drag below which no rotor's is: by less, a force would be a storm."""


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    above = shape[0] * ctx.vehicle.rotor_radius_m
    rotation = ctx.state.rotation
    flow = ctx.mass_flow
    north, east = (ctx.level_drag(-rotation[..., None, i, :], flow, above) for i in (0, 1))
    return north, east, *ctx.own_drag(above), ctx.rotor_force


def _drag(ctx: Context, p: Mapping[str, Array]) -> Array:
    """Of the vehicle over momentum theory's: what was found, and what its model has already."""
    declared = 0.0
    for one in getattr(ctx.model, "effects", ()):
        declared += one.parameters.get(
            {"wind": "own_motion", "rotor_drag": "drag"}.get(one.name, ""), 0.0
        )
    return np.asarray(np.maximum(p["own_motion"] + declared, LEAST_DRAG))


def _north(ctx: Context, p: Mapping[str, Array]) -> Array:
    return np.asarray(p["north"] / _drag(ctx, p))


def _east(ctx: Context, p: Mapping[str, Array]) -> Array:
    return np.asarray(p["east"] / _drag(ctx, p))


def _drag_alone(p: Mapping[str, float]) -> AdoptedEffect:
    """The drag on the own motion, which the next flight has in whatever wind."""
    of_vehicle = {
        "drag": p["own_motion"],
        "turning": p["turning"],
        "sinking": p.get("sinking", 0.0),
        "above_radii": p["above_radii"],
    }
    return AdoptedEffect("rotor_drag", of_vehicle)


def _log_weight(ctx: Context, p: Mapping[str, Array]) -> Array:
    """The prior of the speed of the air, whatever the drag, over that of the force that the search has.

    With w = f / k the density of (w, k) is k^2 that of (f, k); both w and f have the prior N(0, s^2).
    """
    spread = EFFECT.coefficients[0].spread(ctx)
    force = p["north"] ** 2 + p["east"] ** 2
    air = _north(ctx, p) ** 2 + _east(ctx, p) ** 2
    return np.asarray((force - air) / (2.0 * spread**2) - 2.0 * np.log(_drag(ctx, p)))


def _remark(determined: Mapping[str, bool]) -> str | None:
    if determined["own_motion"]:
        return None
    return (
        "how fast the wind blows hangs on the drag of the vehicle, which the flight does not say: "
        "usual drag is taken (0.7, give or take 0.7, of momentum theory's), and the interval is "
        "wide"
    )


def _drawn(ctx: Context, axis: str) -> Drawn:
    r = ctx.state.rotation
    heading = np.degrees(np.arctan2(r[..., 1, 0], r[..., 0, 0])) % 360.0
    return over("heading [deg]", heading, axis)


def _words(_: Context, p: Mapping[str, float]) -> str:
    north = p["north"]
    east = p["east"]
    speed = float(np.hypot(north, east))
    return f"wind of {speed:.2g} m/s from the {compass(-north, -east)}"


def _push(ctx: Context, p: Mapping[str, float]) -> str:
    force = mean(ctx.mass_flow.sum(axis=-1)) * float(np.hypot(p["north"], p["east"]))
    return f"it pushes with {force_words(ctx, force)}"


EFFECT = Effect(
    name="wind",
    belongs_to=BelongsTo.WEATHER,
    equation="dF_xy = sum (sqrt(rho A T) (w - k v - t omega x r) - s rho A v_down v)_xy, above "
    "the fans' references; dF_z = l F_rotors",
    sign="north, east > 0: the air moves to the north, east, with the speed w / k; lift > 0: air "
    "across the discs gives lift",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=("yaw_rad", "vn_m_s", "ve_m_s", "rpm_1"),
    excite="turn through 180 degrees or more in hover",
    coefficients=(
        Coefficient(name="north", unit="m/s", low=-25.0, high=25.0, typical=4.0),
        Coefficient(name="east", unit="m/s", low=-25.0, high=25.0, typical=4.0),
        Coefficient(
            name="own_motion",
            unit="1",
            low=0.0,
            high=3.0,
            typical=0.7,
            centre=0.7,
            belongs_to=BelongsTo.VEHICLE,
        ),
        Coefficient(name="turning", unit="1", low=-6.0, high=6.0, belongs_to=BelongsTo.VEHICLE),
        Coefficient(
            name="sinking",
            unit="1",
            low=-1.0,
            high=2.0,
            typical=0.3,
            centre=0.3,
            optional=True,
            belongs_to=BelongsTo.VEHICLE,
        ),
        Coefficient(name="lift", unit="1", low=0.0, high=0.15, typical=LIFT, optional=True),
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
    every_flight=True,
    search=SearchHints(
        chance=lambda ctx: ctx.if_outdoors(WINDY_DAYS, elsewhere=0.05),
    ),
    aliases=("imu_bias", "rotor_drag"),
    main=("north", "east"),
    contains=("rotor_drag",),
    stays=_drag_alone,
    shown=Shown(
        drawn=_drawn,
        in_words=_words,
        push=_push,
        quantities=(
            Quantity(instead_of="north", name="north", unit="m/s", of=_north),
            Quantity(instead_of="east", name="east", unit="m/s", of=_east),
        ),
        log_weight=_log_weight,
        remark=_remark,
    ),
)
