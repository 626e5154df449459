"""A bumper touches the wall: a spring and a damper with a force away from it, none beyond their reach.

Valid: a soft bumper.
Source: Hunt & Crossley 1975, J. Applied Mechanics 42(2), 440-445, linearised: spring and damper at a contact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.pictures import force_words, over_surfaces
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    depth = np.maximum(shape[0] - ctx.state.d_m, 0.0)
    bearing = ctx.state.wall_bearing_rad
    velocity = ctx.velocity[..., None, :] + ctx.turning
    closing = (
        velocity[..., 0] * np.cos(bearing)[..., None]
        + velocity[..., 1] * np.sin(bearing)[..., None]
    )
    return ctx.pull(-depth, bearing), ctx.pull(np.where(depth > 0.0, -closing, 0.0), bearing)


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    if np.isfinite(ctx.state.d_m).any():
        nearest = float(np.nanmin(ctx.state.d_m))
    else:
        nearest = np.inf
    return tuple((s,) for s in (0.02, 0.04, 0.06, 0.08, 0.10) if s > nearest + 0.01)


def _lacking(ctx: Context) -> str | None:
    if _grid(ctx):
        return None
    return "never within 10 cm of a wall"


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    force = force_words(ctx, p["stiffness"] * 0.01)
    return (
        f"the vehicle touches the wall at {p['reach_m'] * 100.0:.0f} cm: each centimetre closer "
        f"adds {force} at each fan"
    )


EFFECT = Effect(
    name="contact",
    belongs_to=BelongsTo.PLACE,
    equation="dF = -k max(d0 - d, 0) + c d' where d < d0, towards the wall, at every fan",
    sign="stiffness > 0: force away from the wall",
    axes=("Fx", "Fy", "Mx", "My", "Mz"),
    channels=("range_right_m", "range_left_m", "range_forward_m", "range_back_m"),
    excite="touch the wall gently, several times",
    coefficients=(
        Coefficient(
            name="stiffness",
            unit="N/m",
            low=1.0,
            high=1e4,
            typical=lambda ctx: ctx.weight / 0.05 / len(ctx.vehicle.fans),
        ),
        Coefficient(
            name="damping",
            unit="N s/m",
            low=-100.0,
            high=1e3,
            typical=lambda ctx: 0.1 * ctx.weight / len(ctx.vehicle.fans),
        ),
    ),
    wrenches=_wrenches,
    shapes=(Shape(name="reach_m", unit="m"),),
    grid=_grid,
    lacking=_lacking,
    search=SearchHints(
        form=0.25,
    ),
    aliases=("wall_effect",),
    # Bumpers are neither linear nor alike, and ranges of a few centimetres are coarse.
    in_flight=NOT_FLOWN,
    main=("stiffness",),
    shown=Shown(over_surfaces, _words),
)
