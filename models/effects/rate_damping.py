"""Moment against turning: a rotor that turning moves down meets more air and lifts more; arms and hull are dragged.

Rotors are round: roll and pitch have one coefficient.

Valid: rates whose speed at the rotors stays well below that of the blade tips.
Source: Pounds, Mahony & Corke 2010, Control Engineering Practice 18(7), 691-699, section on damping by the rotors.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import mean, over
from models.effects.search_hints import SearchHints
from models.effects.shown import Drawn, Shown

_RATES = {"Mx": "roll", "My": "pitch", "Mz": "yaw"}
_TOLD_DEG_S = 90.0
"""Rate at which the effect is told."""


def _unit(ctx: Context) -> Array:
    """Moment [N m] at 1 rad/s for a coefficient of 1, (...)."""
    flow = ctx.mass_flow.sum(axis=-1)
    return np.asarray(ctx.lever**2 * flow)


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    against = -_unit(ctx)[..., None] * ctx.state.rates
    tilting = np.zeros((*against.shape[:-1], 6))
    yaw = np.zeros_like(tilting)
    tilting[..., 3:5] = against[..., :2]
    yaw[..., 5] = against[..., 2]
    return tilting, yaw


def _drawn(ctx: Context, axis: str) -> Drawn:
    name = _RATES[axis]
    rates = ctx.state.rates[..., list(_RATES).index(axis)]
    return over(f"{name} rate [deg/s]", np.degrees(rates), axis)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    rate = np.radians(_TOLD_DEG_S)
    held_back = rate * abs(p["tilting"]) * mean(_unit(ctx)) / (ctx.weight * ctx.lever)
    return (
        f"tilting at {_TOLD_DEG_S:.0f} deg/s is held back by {100.0 * held_back:.2g} % of "
        "weight times arm"
    )


EFFECT = Effect(
    name="rate_damping",
    equation="dM = -L^2 sum sqrt(rho A T) (c p, c q, y r), L the longest arm",
    sign="tilting, yaw > 0: against the turning",
    axes=("Mx", "My", "Mz"),
    channels=("p_rad_s", "q_rad_s", "r_rad_s", "rpm_1"),
    excite="quick roll and pitch steps, and turns about the vertical",
    coefficients=(
        Coefficient(name="tilting", unit="1", low=0.0, high=10.0, typical=1.0),
        Coefficient(name="yaw", unit="1", low=0.0, high=10.0, typical=0.5),
    ),
    main=("tilting",),
    together=("Mx", "My"),
    wrenches=_wrenches,
    search=SearchHints(
        needs_moments=True,
        chance=0.01,
    ),
    aliases=("vertical_inflow", "rotor_drag"),
    shown=Shown(drawn=_drawn, in_words=_words),
)
