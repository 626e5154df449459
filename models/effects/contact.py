"""A bumper touches the wall: spring and damper push along the wall's normal and never pull.

Valid: a soft bumper.
Source: Hunt & Crossley 1975, J. Applied Mechanics 42(2), 440-445: contact without adhesion; here spring
and damper are linear.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context, smoothed
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.pictures import force_words, over_surfaces
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

REACHES_M = (0.02, 0.04, 0.06, 0.08, 0.10)
DAMPINGS_S = (0.0, 0.05, 0.1, 0.2)
"""None, and about the damping of a bumper that bounces little: 0.5 to 1 of sqrt(m/k)."""


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    reach_m, damping_s = shape
    normal = _towards_wall(ctx)
    velocity = ctx.velocity[..., None, :] + ctx.turning
    closing = (velocity * normal).sum(axis=-1)
    depth = np.maximum(reach_m - ctx.state.d_m, 0.0)
    pressed = np.where(depth > 0.0, np.maximum(depth + damping_s * closing, 0.0), 0.0)
    return (smoothed(ctx, ctx.wrench_at_cg(-pressed[..., None] * normal)),)


def _towards_wall(ctx: Context) -> Array:
    """Level unit vector towards the wall in body axes (..., 1, 3).

    A vehicle that leans into the wall is also pushed along its rotor axis.
    """
    rotation = ctx.state.rotation
    yaw = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    heading = yaw + ctx.state.wall_bearing_rad
    level = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=-1)
    in_body = np.einsum("...ji,...j->...i", rotation, level)
    return np.asarray(in_body[..., None, :])


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    if np.isfinite(ctx.state.d_m).any():
        nearest = float(np.nanmin(ctx.state.d_m))
    else:
        nearest = np.inf
    reaches = [reach for reach in REACHES_M if reach > nearest + 0.01]
    return tuple(product(reaches, DAMPINGS_S))


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
    equation="dF = -k max(d0 - d + c v, 0) where d < d0, along the wall's normal, at every fan; "
    "v: speed to the wall",
    sign="stiffness > 0: force away from the wall",
    axes=("Fx", "Fy", "Fz", "Mx", "My", "Mz"),
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
    ),
    wrenches=_wrenches,
    shapes=(
        Shape(name="reach_m", unit="m"),
        Shape(name="damping_s", unit="s", free_at_zero=True),
    ),
    grid=_grid,
    lacking=_lacking,
    search=SearchHints(
        form=0.25,
    ),
    aliases=("wall_effect",),
    # Bumpers are neither linear nor alike, and ranges of a few centimetres are coarse.
    in_flight=NOT_FLOWN,
    main=("stiffness",),
    shown=Shown(drawn=over_surfaces, in_words=_words),
)
