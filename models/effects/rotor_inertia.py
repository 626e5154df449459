"""Rotors that speed up turn the vehicle the other way: the part of a gyrostat's moment that follows from them alone.

Valid: rigid rotors.
Source: Euler's equations of a gyrostat; Mahony, Kumar & Corke 2012, IEEE Robotics & Automation Magazine 19(3), 20-32.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.gyroscopic import likely_inertia, spin, spin_change
from models.effects.pictures import over
from models.effects.search_hints import SearchHints
from models.effects.shown import Drawn, Shown


def _declared(ctx: Context) -> Array:
    return np.array([rotor.spin for rotor in ctx.vehicle.rotors])


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    change = spin_change(ctx, spin(ctx, _declared(ctx)))
    out = np.zeros((*change.shape, 6))
    out[..., 5] = -change
    return (out,)


def _lacking(ctx: Context) -> str | None:
    if not ctx.vehicle.telemetered:
        return "rotor speeds are not in the log"
    return None


def _drawn(ctx: Context, axis: str) -> Drawn:
    change = spin_change(ctx, spin(ctx, _declared(ctx)))
    return over("change of the sum of spins [rad/s^2]", change, axis)


def _words(_: Context, p: Mapping[str, float]) -> str:
    moment = p["inertia"] * 1000.0
    return f"a rotor that gains 1000 rad/s in a second turns the vehicle back with {moment:.2g} N m"


EFFECT = Effect(
    name="rotor_inertia",
    equation="dM_z = -J d/dt sum s_i Omega_i, s_i the declared spins",
    sign="against the change of the rotors' spin",
    axes=("Mz",),
    channels=("r_rad_s", "rpm_1", "rpm_2"),
    excite="quick turns about the vertical",
    coefficients=(
        Coefficient(name="inertia", unit="kg m^2", low=0.0, high=0.1, typical=likely_inertia),
    ),
    wrenches=_wrenches,
    of_inputs=True,
    lacking=_lacking,
    # Rotors that speed up are flywheels in all else, too: gyroscopic says both, and comes first.
    search=SearchHints(
        needs_moments=True,
        exact=True,
        chance=0.0005,
    ),
    aliases=("gyroscopic",),
    in_flight=NOT_FLOWN,
    shown=Shown(drawn=_drawn, in_words=_words),
)
