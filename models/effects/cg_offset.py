"""The centre of gravity is not where the vehicle file says.

Valid: small offsets.
Source: moment of a force about another point: Goldstein, Classical Mechanics, ch. 1.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import over_thrust
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown
from models.vehicle_wrench import vane_wrench


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    vanes = np.nan_to_num(vane_wrench(ctx.vehicle, ctx.state.servo_us, ctx.thrust))
    force = (ctx.rotor_wrench + vanes)[..., :3]
    x = np.zeros((*force.shape[:-1], 6))
    y = np.zeros((*force.shape[:-1], 6))
    x[..., 3:] = -np.cross(np.array([1.0, 0.0, 0.0]), force)
    y[..., 3:] = -np.cross(np.array([0.0, 1.0, 0.0]), force)
    return x, y


def _words(_: Context, p: Mapping[str, float]) -> str:
    x = f"{abs(p['x']) * 1e3:.0f} mm {'ahead of' if p['x'] > 0.0 else 'behind'}"
    y = f"{abs(p['y']) * 1e3:.0f} mm to the {'right' if p['y'] > 0.0 else 'left'} of"
    return f"the centre of gravity is {x} and {y} the place in the vehicle file"


EFFECT = Effect(
    name="cg_offset",
    equation="dM = -r x F, F of rotors and vanes",
    sign="x > 0: CG ahead of the declared one (nose down); y > 0: to the right of it (right down)",
    axes=("Mx", "My"),
    channels=("rpm_1", "rpm_2", "rpm_3", "rpm_4"),
    excite="vary the thrust: quick climbs and stops",
    coefficients=tuple(
        Coefficient(name=a, unit="m", low=-0.3, high=0.3, typical=lambda ctx: 0.05 * ctx.lever)
        for a in "xy"
    ),
    wrenches=_wrenches,
    search=SearchHints(
        needs_moments=True,
    ),
    aliases=("fan_imbalance", "wall_effect"),
    shown=Shown(drawn=over_thrust, in_words=_words),
)
