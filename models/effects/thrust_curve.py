"""Thrust over throttle (or over rpm^2) has another slope and curvature about hover than declared.

Valid: u from 0.5 to 1.7.
Source: Taylor expansion of the thrust curve about hover; Bitcraze's and ArduPilot's thrust stands.
"""

from __future__ import annotations

from collections.abc import Mapping

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.lacking import where_commanded
from models.effects.pictures import more, over_thrust
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

FLATTEST = -0.4
FELT_WITHIN = 0.05
"""Smallest slope, and by how much it may be less than what the accelerometer feels."""


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    above = (ctx.thrust.sum(axis=-1) / ctx.weight - 1.0)[..., None]
    return ctx.rotor_force * above, ctx.rotor_force * above**2


def _flattest(ctx: Context) -> float:
    # A loop that holds the height answers a loss of lift by more thrust: that passes for a flat curve, but is not felt.
    if ctx.record:
        return max(min(ctx.felt_slope, 0.0) - FELT_WITHIN, FLATTEST)
    return FLATTEST


def _likely(ctx: Context) -> float:
    # At a speed, thrust goes with its square but for what the blades do with Reynolds number and bending.
    return ctx.by_kind(0.1, 0.25)


def _words(_: Context, p: Mapping[str, float]) -> str:
    high, low = (p["slope"] * u + p["curvature"] * u**2 for u in (0.2, -0.2))
    return (
        f"at 1.2 times hover thrust the rotors give {more(high)} than declared, at 0.8 times "
        f"{more(low)}"
    )


EFFECT = Effect(
    name="thrust_curve",
    equation="dF = F_rotors (s (u - 1) + c (u - 1)^2), u the declared thrust over the weight",
    sign="slope > 0: a change of throttle does more than declared",
    axes=("Fz",),
    channels=("thrust_command", "servo_1", "rpm_1", "az_m_s2"),
    excite="climb and sink with quick starts and stops: thrust well above and below hover",
    coefficients=(
        Coefficient(
            name="slope",
            unit="1",
            low=_flattest,
            high=1.5,
            typical=_likely,
            centre=lambda ctx: ctx.by_kind(0.0, 0.1),
        ),
        Coefficient(
            name="curvature",
            unit="1",
            low=-3.0,
            high=3.0,
            typical=lambda ctx: ctx.by_kind(0.15, 0.4),
        ),
    ),
    main=("slope", "curvature"),
    lacking=where_commanded,
    wrenches=_wrenches,
    law=True,
    search=SearchHints(
        chance=lambda ctx: ctx.if_commanded(ctx.by_kind(0.02, 0.3)),
    ),
    aliases=("thrust_scale", "battery_sag"),
    shown=Shown(drawn=over_thrust, in_words=_words),
)
