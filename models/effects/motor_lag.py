"""Thrust comes later than the measured speed (or the output) says.

Valid: logs of 20 Hz or more.
Source: Mahony, Kumar & Corke 2012, IEEE Robotics & Automation Magazine 19(3), 20-32: rotor speed as first order lag.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context, through
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.lacking import where_commanded
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

LAG_DOUBT_S = 0.035


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    wrench = ctx.rotor_wrench
    if not ctx.record:
        return (np.zeros_like(wrench),)
    tau, dead = shape
    return (
        through(
            ctx, wrench, lambda omega: np.exp(-1j * omega * dead) / (1.0 + 1j * omega * tau) - 1.0
        ),
    )


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    # A lag hardly longer than what the clock was set right by may be of that correction's making.
    shortest = ctx.clock_moved_s + LAG_DOUBT_S
    lags = (0.0, 0.04, 0.07, 0.12, 0.2, 0.35)
    return tuple((tau, dead) for dead in (0.0, 0.04, 0.1) for tau in lags if tau + dead >= shortest)


def _words(_: Context, p: Mapping[str, float]) -> str:
    dead = p["dead_s"] * 1e3
    tau = p["tau_s"] * 1e3
    return f"thrust comes {dead:.0f} ms late, with a time constant of {tau:.0f} ms"


EFFECT = Effect(
    name="motor_lag",
    equation="dF = F_rotors(filtered, exp(-d s)/(1 + tau s)) - F_rotors",
    sign="gain 1: dead time and a first-order lag",
    axes=("Fz", "Mx", "My"),
    channels=("rpm_1", "rpm_2", "rpm_3", "rpm_4", "thrust_command"),
    excite="vertical steps, quick ones",
    coefficients=(Coefficient(name="gain", unit="1", low=0.6, high=1.4, typical=0.15, centre=1.0),),
    wrenches=_wrenches,
    shapes=(
        Shape(name="tau_s", unit="s", free_at_zero=True),
        Shape(name="dead_s", unit="s", free_at_zero=True),
    ),
    grid=_grid,
    of_inputs=True,
    lacking=where_commanded,
    in_flight=NOT_FLOWN,
    shown=Shown(in_words=_words),
    law=True,
    search=SearchHints(
        chance=lambda ctx: ctx.if_commanded(ctx.by_kind(0.04, 0.2)),
        searched=("Fz",),
    ),
)
