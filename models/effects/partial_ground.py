"""An edge in the ground: one fan is over a table, another over the floor, and the rangefinder sees only one of them.

Valid: one straight edge.
Source: Sanchez-Cuevas, Heredia & Ollero 2017, Int. J. Aerospace Engineering, 1823056, eq. 4: images of the rotors over
the surface only.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context, decay
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.pictures import over_height
from models.effects.shown import Shown
from models.surface_map import COMPONENTS
from models.vehicle_wrench import fan_rpm

STEP_M = 0.12


def _edge(ctx: Context) -> tuple[Array, float, float, float] | None:
    """Straight edge: normal towards the high side (2,), offset along it, and the two levels (high, low); or None."""
    place = ctx.state.position_ned
    fan = ctx.state.rotation[:, 2] @ ctx.vehicle.fan_positions_m[0]
    surface = np.where(
        np.isfinite(ctx.state.h_m[:, 0]), place[:, 2] + fan + ctx.state.h_m[:, 0], np.nan
    )
    known = np.isfinite(surface)
    if known.sum() < 50:
        return None
    levels = np.quantile(surface[known], np.linspace(0.01, 0.99, 99))
    gaps = np.diff(levels)
    split = levels[gaps.argmax()] + gaps.max() / 2.0
    high = surface < split
    low = surface > split
    steps = np.flatnonzero((high[:-1] & low[1:]) | (low[:-1] & high[1:]))
    if gaps.max() < STEP_M or not steps.size:
        return None
    crossing = 0.5 * (place[steps, :2] + place[steps + 1, :2])
    move = place[high, :2].mean(axis=0) - place[low, :2].mean(axis=0)
    if len(crossing) >= 3 and np.ptp(crossing, axis=0).max() > 0.4:
        along = np.linalg.svd(crossing - crossing.mean(axis=0), full_matrices=False)[2][0]
        normal = np.array([-along[1], along[0]])
        normal *= np.sign(normal @ move) or 1.0
    else:
        normal = move / max(float(np.linalg.norm(move)), 1e-9)
    return (
        normal,
        float(np.median(crossing @ normal)),
        float(np.median(surface[high])),
        float(np.median(surface[low])),
    )


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    if ctx.record:
        edge = _edge(ctx)
    else:
        edge = None
    if edge is None:
        return (np.zeros((*ctx.state.time_s.shape, 6)),)
    normal, offset, high, low = edge
    arms = np.einsum("nij,fj->nfi", ctx.state.rotation, ctx.vehicle.fan_positions_m)
    place = ctx.state.position_ned[:, None] + arms
    along = np.clip((place[..., :2] @ normal - offset) / ctx.vehicle.rotor_radius_m, -1.0, 1.0)
    cover = (0.5 + (along * np.sqrt(1.0 - along**2) + np.arcsin(along)) / np.pi)[..., None]
    over, floor = (_air(ctx, np.maximum(level - place[..., 2], 0.0)) for level in (high, low))
    change = cover * over + (1.0 - cover) * floor - _air(ctx, ctx.state.h_m)
    return (ctx.corners(change, ctx.state.wall_bearing_rad),)


def _air(ctx: Context, h: Array) -> Array:
    """Wrenches of the fans (n, fans, 6) in their corner frames at heights (n, fans), up to what no height changes."""
    if ctx.model is None:
        lift = ctx.shared_thrust * decay(h, ctx.vehicle.rotor_radius_m)
        return np.asarray(lift[..., None] * COMPONENTS["lift"])
    return ctx.model.wrench(h, ctx.state.d_m, fan_rpm(ctx.vehicle, ctx.shared_rpm))


def _lacking(ctx: Context) -> str | None:
    if not np.isfinite(ctx.state.h_m).any():
        return "no height over ground in the log"
    if _edge(ctx) is not None:
        return None
    return "the ground had no step under the track"


def _words(_: Context, p: Mapping[str, float]) -> str:
    return (
        f"fans over the edge lift {p['gain']:.2g} times what the ground effect of the model says "
        "for each"
    )


EFFECT = Effect(
    name="partial_ground",
    belongs_to=BelongsTo.PLACE,
    equation="dF = sum over fans of c F(h_table) + (1 - c) F(h_floor) - F(h seen), c the disc's "
    "share over the table",
    sign="gain 1: as the model's ground effect says",
    axes=("Fz", "Mx", "My"),
    channels=("range_down_m", "down_m", "north_m", "east_m"),
    excite="cross the edge of a table slowly, at three heights",
    coefficients=(Coefficient(name="gain", unit="1", low=0.3, high=2.5, typical=0.5, centre=1.0),),
    wrenches=_wrenches,
    lacking=_lacking,
    aliases=("ground_effect", "cg_offset"),
    in_flight=NOT_FLOWN,
    shown=Shown(drawn=over_height, in_words=_words),
)
