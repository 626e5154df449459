"""Thrust over throttle (or over rpm^2) has another slope and curvature about hover than declared."""

from __future__ import annotations

from collections.abc import Mapping

from models.effects.effect import Coefficient, Context, Effect, columns
from models.effects.pictures import more, over_thrust
from models.frames import Array


def _regressors(ctx: Context, _: tuple[float, ...]) -> Array:
    above = (ctx.thrust.sum(axis=-1) / ctx.weight - 1.0)[..., None]
    return columns(ctx.rotor_force * above, ctx.rotor_force * above**2)


def _lacking(ctx: Context) -> str | None:
    return "the thrust varied hardly more than it answers disturbances" if ctx.only_answers else None


def _words(_: Context, p: Mapping[str, float]) -> str:
    high, low = (p["slope"] * u + p["curvature"] * u**2 for u in (0.2, -0.2))
    return f"at 1.2 times hover thrust the rotors give {more(high)} than declared, at 0.8 times {more(low)}"


EFFECT = Effect(
    name="thrust_curve",
    equation="dF = F_rotors (s (u - 1) + c (u - 1)^2), u the declared thrust over the weight",
    sign="slope > 0: a change of throttle does more than declared",
    source="Taylor expansion of the thrust curve about hover; Bitcraze's and ArduPilot's thrust stands",
    valid="u from 0.5 to 1.7",
    axes=("Fz",),
    channels=("thrust_command", "servo_1", "rpm_1", "az_m_s2"),
    excite="climb and sink with quick starts and stops: thrust well above and below hover",
    coefficients=(
        Coefficient("slope", "1", -0.4, 1.5, typical=0.25, centre=0.1),
        Coefficient("curvature", "1", -3.0, 3.0, typical=0.4),
    ),
    main=("slope", "curvature"),
    odds=lambda ctx: ctx.by_kind(0.02, 0.3),
    least_share=0.25,
    regressors=_regressors,
    lacking=_lacking,
    aliases=("thrust_scale", "battery_sag"),
    drawn=over_thrust,
    in_words=_words,
)
