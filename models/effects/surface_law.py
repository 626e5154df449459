"""A smooth correction of lift, pull and tilt over height and distance to the wall, where no formula is right."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import product

import numpy as np

from models.effects.effect import Coefficient, Context, Drawn, Effect, Shape
from models.effects.pictures import more, nearest, over_height, over_wall, percent
from models.frames import Array
from models.surface_map import SurfaceMap, prior_factor

SURFACE = SurfaceMap((0.8, 1.0, 1.25, 1.6, 2.0, 2.6, 3.4, 4.5), (0.2, 0.4, 0.65, 1.0, 1.6, 2.4, 4.0))
PARTS = ("lift", "pull", "tilt")
SD = {"lift": 0.05, "pull": 0.012, "tilt": 0.05}
"""Standard deviation of the prior close by, of the fan's thrust (tilt: times the radius), at a spread of 1: half of the
largest values that are published (Ai et al. 2020)."""
GAIN_SD = 1.0
"""The same of a gain on what the declared model says of lift, pull and tilt: it may be wrong by its own size."""
COMPONENTS = {
    "lift": np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
    "pull": np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
    "tilt": np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
}
"""Components of a fan's wrench in the corner frame that belong to each part."""
CELLS = [
    (part, k)
    for part, k in product(PARTS, range(SURFACE.size))
    if k < SURFACE.size - 1 and (part == "lift" or (k + 1) % len(SURFACE.gaps))
]
"""Cells that may differ from zero."""


def _name(part: str, cell: int) -> str:
    row, column = divmod(cell, len(SURFACE.gaps))
    return f"{part}_{SURFACE.heights[row]:g}_{SURFACE.gaps[column]:g}"


def _regressors(ctx: Context, _: tuple[float, ...]) -> Array:
    radius, thrust, bearing = ctx.vehicle.rotor_radius_m, ctx.shared_thrust, ctx.state.wall_bearing_rad
    near = SURFACE.weights(ctx.state.h_m / radius, ctx.state.d_m / radius) * thrust[..., None]
    unit = {
        "lift": (0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        "pull": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "tilt": (0.0, 0.0, 0.0, 0.0, radius, 0.0),
    }
    declared = _declared(ctx)
    gains = [ctx.corners(declared * COMPONENTS[part], bearing) for part in PARTS]
    return np.stack([*gains, *(ctx.corner(unit[part], near[..., k], bearing) for part, k in CELLS)], axis=-1)


def _wrench(ctx: Context, p: Mapping[str, float]) -> Array:
    """``_regressors`` times the coefficients, in one sum a fan."""
    radius = ctx.vehicle.rotor_radius_m
    weights = SURFACE.weights(ctx.state.h_m / radius, ctx.state.d_m / radius)
    law = _maps(tuple(p.items()))
    lift, pull, tilt = np.moveaxis(weights @ law.T, -1, 0)
    zero = np.zeros_like(lift)
    local = np.stack([pull, zero, lift, zero, radius * tilt, zero], axis=-1) * ctx.shared_thrust[..., None]
    gains = sum(p[f"{part}_of_model"] * COMPONENTS[part] for part in PARTS)
    if ctx.model is not None and np.any(gains):
        local = local + gains * _declared(ctx)
    return ctx.corners(local, ctx.state.wall_bearing_rad)


@lru_cache(maxsize=8)
def _maps(parameters: tuple[tuple[str, float], ...]) -> Array:
    """Values of the cells (parts, size)."""
    out, known = np.zeros((len(PARTS), SURFACE.size)), dict(parameters)
    for part, k in CELLS:
        out[PARTS.index(part), k] = known[_name(part, k)]
    return out


def _declared(ctx: Context) -> Array:
    """What the declared model says of the surroundings, corner frame (..., fans, 6)."""
    if ctx.model is None:
        return np.zeros((*ctx.shared_thrust.shape, 6))
    near = ctx.model.wrench(ctx.state.h_m, ctx.state.d_m, ctx.rpm)
    far = ctx.model.wrench(np.inf, np.inf, ctx.rpm)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((near - far) * (ctx.shared_thrust / far[..., 2])[..., None])


def _mixing(shape: tuple[float, ...]) -> Array:
    first = len(PARTS)
    out = np.zeros((first + len(CELLS), first + len(CELLS)))
    out[:first, :first] = GAIN_SD * np.eye(first)
    for part, spread in zip(PARTS, shape, strict=True):
        index = np.array([i for i, (p, _) in enumerate(CELLS) if p == part])
        factor = prior_factor(SURFACE, spread * SD[part], part != "lift")
        out[np.ix_(first + index, first + index)] = factor[[CELLS[i][1] for i in index], : len(index)]
    return out


def _grid(_: Context) -> Sequence[tuple[float, ...]]:
    return tuple(product((0.5, 1.0, 2.0, 4.0), repeat=len(PARTS)))


def _lacking(ctx: Context) -> str | None:
    near = np.minimum(ctx.state.h_m / SURFACE.heights[-1], ctx.state.d_m / SURFACE.gaps[-1])
    close = np.nan_to_num(near, nan=np.inf).min(axis=-1) < ctx.vehicle.rotor_radius_m
    return None if close.any() else "the flight never came near a surface"


def _drawn(ctx: Context, axis: str) -> Drawn:
    if axis == "Fz":
        return over_height(ctx, axis)
    return over_wall("distance to the wall [m]", ctx.state.d_m, ctx.state.wall_bearing_rad, axis)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    h, d = nearest(ctx.state.h_m), nearest(ctx.state.d_m)
    radius, told = ctx.vehicle.rotor_radius_m, []

    def at(part: str, height: float, gap: float) -> float:
        cells = SURFACE.cells(height / radius, gap / radius)
        return float(sum(w * p.get(_name(part, k), 0.0) for k, w in cells))

    if np.isfinite(h):
        told.append(f"at {h:.2f} m above ground the fans lift {more(at('lift', h, np.inf))} than the model")
    if np.isfinite(d):
        pull = at("pull", np.inf, d)
        verb = "draws" if pull > 0.0 else "pushes"
        told.append(f"at {d:.2f} m from the wall it {verb} with {percent(pull)} of the thrust beyond the model")
    return "; ".join(told)


EFFECT = Effect(
    name="surface_law",
    equation="dF = sum g F_model + T m(h/R, d/R), a gain g and a map m each for lift, pull and tilt (times R)",
    sign="lift > 0: more lift; pull, tilt > 0: towards the wall",
    source="Gaussian process over the logarithms of height and distance: Rasmussen & Williams 2006, Gaussian Processes "
    "for Machine Learning; sizes: Ai, Xu, Xiang, Fan & Zhang 2020, Sensors 20(20), 5805",
    valid="where the flights were, 0.8 to 4.5 radii of ground and 0.35 to 4 radii of a wall",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=("range_down_m", "range_right_m", "range_left_m", "range_forward_m", "range_back_m", "rpm_1"),
    excite="fly slowly to ground, wall and corner, at three heights and distances each",
    coefficients=tuple(
        Coefficient(name, "1", -math.inf, math.inf)
        for name in (*(f"{part}_of_model" for part in PARTS), *(_name(part, k) for part, k in CELLS))
    ),
    regressors=_regressors,
    in_one=_wrench,
    mixing=_mixing,
    shapes=tuple(Shape(f"{part}_spread", "1", continuous=False) for part in PARTS),
    shape_grid=_grid,
    lacking=_lacking,
    remainder=True,
    exact=True,
    gain_in_flight=True,
    odds=0.02,
    aliases=("ground_effect", "wall_effect", "corner_effect"),
    drawn=_drawn,
    in_words=_words,
)
