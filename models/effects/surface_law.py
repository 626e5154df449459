"""A smooth correction of lift, pull and tilt over height and distance to the wall, where no formula is right.

Valid: where the flights were, 0.8 to 4.5 radii of ground and 0.2 to 4 radii of a wall.
Source: Gaussian process over the logarithms of height and distance: Rasmussen & Williams 2006, Gaussian Processes for
Machine Learning; sizes: Ai, Xu, Xiang, Fan & Zhang 2020, Sensors 20(20), 5805.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse, InFlight
from models.effects.pictures import more, nearest, over_surfaces, pull_words
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown
from models.surface_map import (
    CELLS,
    COMPONENTS,
    MEASURED,
    PARTS,
    LawCorrection,
    cell_name,
    prior_factor,
)

SD = {"lift": 0.05, "pull": 0.012, "tilt": 0.05}
"""Standard deviation of the prior close by, of the fan's thrust (tilt: times the radius), at a spread of 1: half of the
largest values that are published (Ai et al. 2020)."""
GAIN_SD = 1.0
"""The same of a gain on what the declared model says of lift, pull and tilt: it may be wrong by its own size."""
CHANCE = 2e-4
"""That of a free curve: what can bend to anything comes after every law that has a form."""
LEAST_SAID = 1e-3
"""Share of the thrust: no flight tells less, so no sentence does."""
SEEN_S = 0.5
"""Time at a place after which it counts as seen [s]: one period of what is judged."""


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    bearing = ctx.state.wall_bearing_rad
    declared = _declared(ctx)
    near = _weights(ctx) * ctx.shared_thrust[..., None]
    made: dict[str, Callable[[Array], Array]] = {
        "lift": ctx.lift,
        "pull": partial(ctx.pull, bearing=bearing),
        "tilt": partial(ctx.tilt, bearing=bearing),
    }
    gains = [ctx.corners(declared * COMPONENTS[part], bearing) for part in PARTS]
    fans = near.shape[-2]
    # A newton at every fan in turn, (fans, ..., 6): a cell's wrench is a sum of these.
    alone = np.eye(fans).reshape(fans, *(1,) * np.ndim(bearing), fans)
    cells = {part: np.moveaxis(make(alone), 0, -1) @ near for part, make in made.items()}
    return (*gains, *(cells[part][..., k] for part, k in CELLS))


def _weights(ctx: Context) -> Array:
    """Weights (..., fans, size) of the map's cells at every fan."""
    radius = ctx.vehicle.rotor_radius_m
    return MEASURED.weights(ctx.state.h_m / radius, ctx.state.d_m / radius)


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
        factor = prior_factor(MEASURED, spread * SD[part], part != "lift")
        out[np.ix_(first + index, first + index)] = factor[
            [CELLS[i][1] for i in index], : len(index)
        ]
    return out


def _seen(flights: Sequence[Context]) -> dict[str, float]:
    seconds = np.zeros(MEASURED.size)
    for ctx in flights:
        step = ctx.state.step_s
        seconds += step * _weights(ctx).mean(axis=1).sum(axis=0)
    return {
        cell_name("seen", k): round(min(s / SEEN_S, 1.0), 3) for k, s in enumerate(seconds.tolist())
    }


def _lacking(ctx: Context) -> str | None:
    near = np.minimum(ctx.state.h_m / MEASURED.heights[-1], ctx.state.d_m / MEASURED.gaps[-1])
    close = np.nan_to_num(near, nan=np.inf).min(axis=-1) < ctx.vehicle.rotor_radius_m
    if close.any():
        return None
    return "the flight never came near a surface"


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    radius = ctx.vehicle.rotor_radius_m
    parts = []
    h = nearest(ctx.state.h_m)
    d = nearest(ctx.state.d_m)

    def at(part: str, height: float, gap: float) -> tuple[float, float]:
        """Declared and measured, as shares of the lift."""
        modelled = 0.0
        if ctx.model is not None:
            rpm = float(np.nanmedian(ctx.rpm))
            near = ctx.model.wrench(height, gap, rpm)
            far = ctx.model.wrench(np.inf, np.inf, rpm)
            modelled = float((near - far)[{"lift": 2, "pull": 0}[part]] / far[2])
        cells = MEASURED.cells(height / radius, gap / radius)
        beyond = sum(w * p.get(cell_name(part, k), 0.0) for k, w in cells)
        return modelled, modelled * (1.0 + p[f"{part}_of_model"]) + beyond

    if np.isfinite(h):
        was, found = at("lift", h, np.inf)
        if abs(found - was) >= LEAST_SAID:
            parts.append(
                f"at {h:.2f} m above ground a fan lifts {more(found)} than in free air, by the "
                f"model {more(was)}"
            )
    if np.isfinite(d):
        was, found = at("pull", np.inf, d)
        if abs(found - was) >= LEAST_SAID:
            by_model = f"by the model {100.0 * was:.2g} %"
            parts.append(f"at {d:.2f} m the wall {pull_words(found)}, {by_model}")
    if not parts:
        return "where it came nearest, lift and pull are within 0.1 % of the thrust of the model's"
    return "; ".join(parts)


EFFECT = Effect(
    name="surface_law",
    equation="dF = sum g F_model + T m(h/R, d/R), a gain g and a map m each for lift, pull and "
    "tilt (times R)",
    sign="lift > 0: more lift; pull, tilt > 0: towards the wall",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=(
        "range_down_m",
        "range_right_m",
        "range_left_m",
        "range_forward_m",
        "range_back_m",
        "rpm_1",
    ),
    excite="fly slowly to ground, wall and corner, at three heights and distances each",
    coefficients=tuple(
        Coefficient(name=name, unit="1", low=-math.inf, high=math.inf)
        for name in (
            *(f"{part}_of_model" for part in PARTS),
            *(cell_name(part, k) for part, k in CELLS),
        )
    ),
    wrenches=_wrenches,
    mixing=_mixing,
    shapes=tuple(
        Shape(name=f"{part}_spread", unit="1", continuous=False, tried=(0.5, 1.0, 2.0, 4.0))
        for part in PARTS
    ),
    lacking=_lacking,
    in_flight=FlightUse(
        use=InFlight.MODEL,
        of_model=LawCorrection.of,
        coverage=_seen,
        covered=tuple(cell_name("seen", k) for k in range(MEASURED.size)),
    ),
    law=True,
    search=SearchHints(
        remainder=True,
        exact=True,
        chance=CHANCE,
    ),
    aliases=("ground_effect", "wall_effect", "corner_effect"),
    shown=Shown(drawn=over_surfaces, in_words=_words),
)
