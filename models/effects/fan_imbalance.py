"""One fan gives less (or more) thrust than declared: a nicked blade, a loose duct.

Valid: everywhere.
Source: blade-element theory: a blade that lifts less is dragged less; Leishman 2006, ch. 3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import Array
from models.effects.adopted_effect import when
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import more, over_thrust
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown
from models.vehicle_wrench import fan_torques, vane_wrench


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    one = np.zeros_like(ctx.thrust)
    fan = round(shape[0]) - 1
    one[..., fan] = ctx.shared_thrust[..., fan]
    # Vanes turn what the fan blows: their force goes with its lift.
    wrench = ctx.lift(one) + np.nan_to_num(vane_wrench(ctx.vehicle, ctx.state.servo_us, one))
    # A blade that lifts less is mostly dragged less, too, but not in the same measure.
    torque = np.zeros_like(wrench)
    torque[..., 5] = fan_torques(ctx.vehicle, ctx.rotor_rpm)[..., fan]
    return wrench, torque


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    if len(ctx.vehicle.fans) > 1:
        return tuple((float(i + 1),) for i in range(len(ctx.vehicle.fans)))
    return ()


def _words(_: Context, p: Mapping[str, float]) -> str:
    return f"fan {p['fan']:.0f} gives {more(p['scale'])} thrust than declared{when(p)}"


EFFECT = Effect(
    name="fan_imbalance",
    equation="dF = e (F_fan + F_vanes), dM = r x dF + q Q_fan",
    sign="scale < 0: that fan is weaker than declared",
    axes=("Fz", "Mx", "My", "Mz"),
    channels=("rpm_1", "rpm_2", "rpm_3", "rpm_4"),
    excite="pitch and roll steps: one fan's speed against the others'",
    coefficients=(
        Coefficient(name="scale", unit="1", low=-1.0, high=0.3, typical=0.2),
        Coefficient(name="torque", unit="1", low=-0.6, high=0.6, typical=0.1),
    ),
    main=("scale",),
    wrenches=_wrenches,
    shapes=(Shape(name="fan", unit="1", continuous=False),),
    grid=_grid,
    search=SearchHints(
        needs_moments=True,
        may_begin=True,
        several=True,
    ),
    aliases=("cg_offset",),
    shown=Shown(drawn=over_thrust, in_words=_words),
)
