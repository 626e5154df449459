"""A constant moment that the autopilot trims out: a bent arm, a motor askew, a cable, a load on one side.

Valid: while nothing on board moves.
Source: trim in steady flight: Etkin & Reid 1996, Dynamics of Flight, ch. 2.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    shape = (*ctx.state.time_s.shape, 6)
    return tuple(np.broadcast_to(np.eye(6)[axis], shape).copy() for axis in (3, 4, 5))


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    unit = ctx.weight * ctx.lever / 100.0
    parts = [
        f"{p[key] / unit:+.2g} % {name}"
        for key, name in (("roll", "in roll"), ("pitch", "in pitch"), ("yaw", "in yaw"))
    ]
    return f"a constant moment, of weight times arm: {', '.join(parts)}"


def _likely(ctx: Context) -> float:
    return 0.01 * ctx.weight * ctx.lever


def _most(ctx: Context) -> float:
    return 0.3 * ctx.weight * ctx.lever


EFFECT = Effect(
    name="trim_moment",
    belongs_to=BelongsTo.LOAD,
    equation="dM = constant",
    sign="roll > 0: right down; pitch > 0: nose up; yaw > 0: nose right",
    axes=("Mx", "My", "Mz"),
    channels=("rpm_1", "rpm_2", "rpm_3", "rpm_4"),
    excite="change the thrust: a moment of the centre of gravity goes with it, a trim stays",
    coefficients=tuple(
        Coefficient(name=name, unit="N m", low=lambda ctx: -_most(ctx), high=_most, typical=_likely)
        for name in ("roll", "pitch", "yaw")
    ),
    wrenches=_wrenches,
    search=SearchHints(
        needs_moments=True,
        chance=0.005,
        exact=True,
    ),
    aliases=("cg_offset", "fan_imbalance"),
    in_flight=NOT_FLOWN,
    shown=Shown(in_words=_words),
)
