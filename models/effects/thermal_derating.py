"""Thrust is lost as motors and ESCs warm up.

Valid: below the ESC's own limit.
Source: magnets and copper lose about 0.1 % of torque a kelvin: Hughes & Drury 2013, Electric Motors and Drives, ch. 9.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import more, nearest, over
from models.effects.shown import Shown

STEP_C = 30.0
KNOWN_TO = 0.01
"""Standard deviation of ``start``: the thrust was declared at a temperature known to 10 K, of a slope of 3 % in 30 K. A
level that is further off is a load, or a thrust that is declared wrong, however warm the motors are."""


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    warmer = (ctx.state.esc_temperature_c - shape[0]) / STEP_C
    return ctx.rotor_force * warmer[..., None], ctx.rotor_force


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    known = ctx.state.esc_temperature_c[np.isfinite(ctx.state.esc_temperature_c)]
    return ((float(known[0]),),)


def _lacking(ctx: Context) -> str | None:
    known = ctx.state.esc_temperature_c[np.isfinite(ctx.state.esc_temperature_c)]
    if not known.size:
        return "no ESC temperature in the log"
    if np.ptp(known) > 2.0:
        return None
    return "the ESC temperature did not change"


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    hot = -nearest(-ctx.state.esc_temperature_c)
    share = p["slope"] * (hot - p["reference_c"]) / STEP_C
    return f"at {hot:.0f} °C the rotors give {more(share)} thrust than at {p['reference_c']:.0f} °C"


EFFECT = Effect(
    name="thermal_derating",
    equation="dF = F_rotors (s (T_esc - T_start)/30 K + s0), s0 at the start",
    sign="slope < 0: thrust is lost when hot",
    axes=("Fz",),
    channels=("esc_temperature_c", "rpm_1"),
    excite="a long flight from cold; rest with the battery connected separates heat from charge",
    coefficients=(
        Coefficient(name="slope", unit="1", low=-0.2, high=0.0, typical=0.03),
        Coefficient(
            name="start", unit="1", low=-0.3, high=0.3, typical=KNOWN_TO, belongs_to=BelongsTo.LOAD
        ),
    ),
    main=("slope",),
    wrenches=_wrenches,
    shapes=(Shape(name="reference_c", unit="degC", continuous=False),),
    grid=_grid,
    lacking=_lacking,
    aliases=("battery_sag",),
    shown=Shown(
        drawn=lambda ctx, axis: over("ESC temperature [°C]", ctx.state.esc_temperature_c, axis),
        in_words=_words,
    ),
)
