"""The air is thinner or denser than the sea-level air the model was trained for.

Valid: dry air.
Source: T proportional to rho at given speed: Leishman 2006, ch. 2; ideal gas, ISO 2533.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import mean, more, over_thrust
from models.effects.shown import Shown
from models.vehicle import RHO_SEA_LEVEL


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    return (ctx.rotor_force * (ctx.density / RHO_SEA_LEVEL - 1.0)[..., None],)


def _lacking(ctx: Context) -> str | None:
    share = ctx.density / RHO_SEA_LEVEL - 1.0
    if not np.isfinite(share).any():
        return "no pressure and air temperature in the log"
    if abs(float(np.nanmean(share))) > 0.01:
        return None
    return "the air has the model's density within 1 %"


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    share = mean(ctx.density) / RHO_SEA_LEVEL - 1.0
    return (
        f"the air is {more(share, 'denser', 'thinner')} than at sea level: "
        f"{more(p['gain'] * share)} thrust"
    )


EFFECT = Effect(
    name="air_density",
    belongs_to=BelongsTo.WEATHER,
    equation="dF = g F_rotors (rho/1.225 - 1), rho = p/(287.05 T)",
    sign="gain 1: as the ideal gas says",
    axes=("Fz",),
    channels=("pressure_pa", "air_temperature_c", "rpm_1"),
    excite="known from pressure and temperature; weigh the vehicle to be sure",
    coefficients=(Coefficient(name="gain", unit="1", low=0.4, high=1.6, typical=0.1, centre=1.0),),
    wrenches=_wrenches,
    lacking=_lacking,
    aliases=("thrust_scale", "payload"),
    shown=Shown(drawn=over_thrust, in_words=_words),
)
