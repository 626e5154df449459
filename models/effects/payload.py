"""More (or less) mass than declared, all the time, picked up in flight, or dropped.

Valid: a load that moves with the vehicle.
Source: Newton's second law with a mass that is not declared.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.adopted_effect import when
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import percent
from models.effects.search_hints import SearchHints
from models.effects.shown import Quantity, Shown

MISSING = 0.25
"""Share of the mass that may be missing: a smaller pack and no camera. Some pack, a quarter of most, is on board."""
MOST_SHARE = 0.9
"""Of load and vehicle together, that the load may be: the mass that follows stays finite."""


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    # The declared lift stands for the specific force: the accelerometer's noise is in the residual as well.
    out = np.zeros((*ctx.state.time_s.shape, 6))
    out[..., 2] = ctx.thrust.sum(axis=-1) / ctx.vehicle.mass_kg
    return (out,)


def _mass(ctx: Context, p: Mapping[str, Array]) -> Array:
    """Mass of the load (m,) [kg]: lift T gives m + dm the specific force T / (m + dm), of which T dm / (m + dm) lacks.

    So the coefficient c, on T / m, is m dm / (m + dm).
    """
    share = np.minimum(p["mass"] / ctx.vehicle.mass_kg, MOST_SHARE)
    return np.asarray(ctx.vehicle.mass_kg * share / (1.0 - share))


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    mass = p["mass_kg"]
    if mass > 0.0:
        way = "heavier"
    else:
        way = "lighter"
    share = percent(mass / ctx.vehicle.mass_kg)
    if ctx.vehicle.mass_assumed:
        return f"the vehicle is {share} {way} than its lift says{when(p)}"
    size = f"the vehicle is {abs(mass):.2g} kg {way} than in its file"
    return f"{size} ({share} of {ctx.vehicle.mass_kg:.2g} kg){when(p)}"


EFFECT = Effect(
    name="payload",
    belongs_to=BelongsTo.LOAD,
    equation="dF = -T dm / (m + dm), T the declared lift",
    sign="mass_kg > 0: heavier than declared",
    axes=("Fz",),
    channels=("az_m_s2", "rpm_1", "rpm_2", "rpm_3", "rpm_4"),
    excite="weigh the vehicle, or pick the load up in flight",
    # Loads are added more often than taken off.
    coefficients=(
        Coefficient(
            name="mass",
            unit="kg",
            low=lambda ctx: -MISSING * ctx.vehicle.mass_kg,
            high=lambda ctx: ctx.most_load_kg,
            typical=lambda ctx: 0.15 * ctx.vehicle.mass_kg,
            centre=lambda ctx: 0.1 * ctx.vehicle.mass_kg,
        ),
    ),
    wrenches=_wrenches,
    every_flight=True,
    search=SearchHints(
        halvings=4,
        may_begin=True,
        exact=True,
        chance=0.028,
    ),
    aliases=("thrust_scale", "air_density"),
    shown=Shown(
        in_words=_words,
        quantities=(Quantity(instead_of="mass", name="mass_kg", unit="kg", of=_mass),),
    ),
)
