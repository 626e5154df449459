"""All fans give the same share more or less than declared: wear, ice, tip gap, a wrong coefficient.

Valid: everywhere.
Source: Leishman 2006, Principles of Helicopter Aerodynamics, ch. 2: T = C_T rho A Omega^2 R^2, C_T changed by wear, ice
or tip gap.
"""

from __future__ import annotations

from collections.abc import Mapping

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import more, over_thrust
from models.effects.shown import Shown


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    return (ctx.rotor_force,)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    said = f"the rotors give {more(p['scale'])} thrust than declared"
    if ctx.vehicle.mass_assumed:
        return said
    return f"{said} ({abs(p['scale']) * ctx.weight:.2g} N in hover)"


EFFECT = Effect(
    name="thrust_scale",
    equation="dF = e F_rotors",
    sign="e > 0: more thrust than declared",
    axes=("Fz",),
    channels=("rpm_1", "rpm_2", "rpm_3", "rpm_4"),
    excite="weigh the vehicle: one flight sees only the ratio of thrust to mass",
    # Outputs are declared by a hover of this vehicle, rotor speeds by a coefficient of a data sheet.
    coefficients=(
        Coefficient(
            name="scale", unit="1", low=-0.6, high=0.6, typical=lambda ctx: ctx.by_kind(0.15, 0.06)
        ),
    ),
    wrenches=_wrenches,
    aliases=("payload", "air_density", "battery_sag", "thermal_derating"),
    shown=Shown(drawn=over_thrust, in_words=_words),
)
