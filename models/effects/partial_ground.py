"""An edge in the ground: one fan is over a table, another over the floor, and the rangefinder sees only one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from models.effects.effect import DOWNWARD, NOT_FLOWN, BelongsTo, Coefficient, Context, Effect, Shown, columns, decay
from models.effects.pictures import over_height
from models.frames import Array
from models.vehicle_wrench import disturbance_wrench

STEP_M = 0.12


def _surface(ctx: Context) -> Array:
    """Down coordinate of the surface under the rangefinder (n,), NaN where unknown."""
    fan = np.asarray(ctx.vehicle.fans[0].position_m)
    down = ctx.state.position_ned[:, 2] + np.einsum("nj,j->n", ctx.state.rotation[:, 2], fan)
    surface: Array = np.where(np.isfinite(ctx.state.h_m[:, 0]), down + ctx.state.h_m[:, 0], np.nan)
    return surface


def _edge(ctx: Context) -> tuple[Array, float, float, float] | None:
    """Straight edge: normal towards the high side (2,), offset along it, and the two levels (high, low); or None."""
    surface = _surface(ctx)
    known = np.isfinite(surface)
    if known.sum() < 50:
        return None
    ordered = np.sort(surface[known])
    gaps = np.diff(np.quantile(ordered, np.linspace(0.01, 0.99, 99)))
    if gaps.max() < STEP_M:
        return None
    split = float(np.quantile(ordered, np.linspace(0.01, 0.99, 99))[int(gaps.argmax())] + gaps.max() / 2.0)
    high = known & (surface < split)
    low = known & (surface > split)
    levels = float(np.median(surface[high])), float(np.median(surface[low]))
    place = ctx.state.position_ned[:, :2]
    steps = np.flatnonzero((high[:-1] & low[1:]) | (low[:-1] & high[1:]))
    if len(steps) < 1:
        return None
    crossing = 0.5 * (place[steps] + place[steps + 1])
    move = place[high].mean(axis=0) - place[low].mean(axis=0)
    if len(crossing) >= 3 and np.ptp(crossing, axis=0).max() > 0.4:
        centred = crossing - crossing.mean(axis=0)
        along = np.linalg.svd(centred, full_matrices=False)[2][0]
        normal = np.array([-along[1], along[0]])
        normal *= np.sign(normal @ move) or 1.0
    else:
        normal = move / max(float(np.linalg.norm(move)), 1e-9)
    return normal, float(np.median(crossing @ normal)), levels[0], levels[1]


def _regressors(ctx: Context, _: tuple[float, ...]) -> Array:
    out = np.zeros((*ctx.state.time_s.shape, 6))
    edge = _edge(ctx) if ctx.record else None
    if edge is None:
        return columns(out)
    normal, offset, high, low = edge
    radius = ctx.vehicle.rotor_radius_m
    share, over, floor = [], [], []
    for fan in ctx.vehicle.fans:
        arm = np.einsum("nij,j->ni", ctx.state.rotation, np.asarray(fan.position_m))
        along = np.clip(((ctx.state.position_ned + arm)[:, :2] @ normal - offset) / radius, -1.0, 1.0)
        share.append(0.5 + (along * np.sqrt(1.0 - along**2) + np.arcsin(along)) / np.pi)
        down = (ctx.state.position_ned + arm)[:, 2]
        over.append(np.maximum(high - down, 0.0))
        floor.append(np.maximum(low - down, 0.0))
    cover, h_over, h_floor = (np.stack(v, axis=-1) for v in (share, over, floor))
    if ctx.model is None:
        lift = ctx.shared_thrust * (cover * decay(h_over, radius) + (1.0 - cover) * decay(h_floor, radius))
        seen = ctx.shared_thrust * decay(ctx.state.h_m, radius)
        return columns(ctx.wrench_at_cg(-(lift - seen)[..., None] * DOWNWARD))
    state = replace(ctx.state, rpm=ctx.shared_rpm)
    total = np.zeros_like(out)
    for i in range(len(ctx.vehicle.fans)):
        only = np.full_like(state.h_m, np.inf)
        for h, weight in ((h_over, cover), (h_floor, 1.0 - cover), (state.h_m, -np.ones_like(cover))):
            at = only.copy()
            at[:, i] = h[:, i]
            far = replace(state, h_m=only)
            part = disturbance_wrench(ctx.vehicle, ctx.model, replace(state, h_m=at))
            total += weight[:, i, None] * (part - disturbance_wrench(ctx.vehicle, ctx.model, far))
    return columns(total)


def _lacking(ctx: Context) -> str | None:
    if not ctx.record or not np.isfinite(ctx.state.h_m).any():
        return "no height over ground in the log"
    return None if _edge(ctx) is not None else "the ground had no step under the track"


def _words(_: Context, p: Mapping[str, float]) -> str:
    return f"fans over the edge lift {p['gain']:.2g} times what the ground effect of the model says for each"


EFFECT = Effect(
    name="partial_ground",
    belongs_to=BelongsTo.PLACE,
    equation="dF = sum over fans of c F(h_table) + (1 - c) F(h_floor) - F(h seen), c the disc's share over the table",
    sign="gain 1: as the model's ground effect says",
    source="Sanchez-Cuevas, Heredia & Ollero 2017, Int. J. Aerospace Engineering, 1823056, eq. 4: images of the "
    "rotors over the surface only",
    valid="one straight edge",
    axes=("Fz", "Mx", "My"),
    channels=("range_down_m", "down_m", "north_m", "east_m"),
    excite="cross the edge of a table slowly, at three heights",
    coefficients=(Coefficient("gain", "1", 0.3, 2.5, typical=0.5, centre=1.0),),
    regressors=_regressors,
    lacking=_lacking,
    aliases=("ground_effect", "cg_offset"),
    in_flight=NOT_FLOWN,
    shown=Shown(over_height, _words),
)
