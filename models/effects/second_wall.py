"""A second wall besides the one the model knows: its pull and tilt, and the loss of lift in the vertex."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.air_state import DIRECTIONS
from models.effects.effect import Coefficient, Context, Effect, Shape, columns, decay
from models.frames import Array

_BEAMS = (("forward", 0.0), ("right", np.pi / 2), ("back", np.pi), ("left", -np.pi / 2))
_ORIENTATION = {"forward": 0, "right": 2, "back": 4, "left": 6}


def _second(ctx: Context) -> tuple[Array, Array]:
    """Lip to the nearest wall that is not the model's, (..., fans), and its bearing (...)."""
    shape = ctx.state.time_s.shape
    best = np.full((*shape, len(ctx.vehicle.fans)), np.inf)
    bearing = np.zeros(shape)
    known = np.isfinite(ctx.state.d_m).any(axis=-1)
    mounts = {r.orientation: r.position_m for r in ctx.vehicle.rangefinders if r.target == "wall"}
    for name, angle in _BEAMS:
        if _ORIENTATION[name] not in mounts:
            continue
        toward = np.array([np.cos(angle), np.sin(angle), 0.0])
        reach = ctx.state.ranges_m[..., DIRECTIONS.index(name)] + float(toward @ mounts[_ORIENTATION[name]])
        off = np.abs(np.angle(np.exp(1j * (ctx.state.wall_bearing_rad - angle))))
        other = np.isfinite(reach) & ~(known & (off < 0.8))
        d = np.stack([reach - float(toward @ f.position_m) - f.lip_radius_m for f in ctx.vehicle.fans], axis=-1)
        nearer = other & (d.min(axis=-1) < best.min(axis=-1))
        best = np.where(nearer[..., None], d, best)
        bearing = np.where(nearer, angle, bearing)
    return best, bearing


def _regressors(ctx: Context, shape: tuple[float, ...]) -> Array:
    length = shape[0] * ctx.vehicle.rotor_radius_m
    d, bearing = _second(ctx)
    size = ctx.thrust * decay(d, length)
    both = ctx.thrust * decay(np.maximum(d, 0.0) + np.maximum(ctx.state.d_m, 0.0), 3.0 * length)
    return columns(
        ctx.corner((1.0, 0.0, 0.0, 0.0, 0.0, 0.0), size, bearing),
        ctx.corner((0.0, 0.0, 0.0, 0.0, 1.0, 0.0), ctx.vehicle.rotor_radius_m * size, bearing),
        ctx.corner((0.0, 0.0, 1.0, 0.0, 0.0, 0.0), size, bearing),
        ctx.corner((0.0, 0.0, -1.0, 0.0, 0.0, 0.0), both, bearing),
    )


def _grid(_: Context) -> Sequence[tuple[float, ...]]:
    return tuple((s,) for s in (0.5, 0.9, 1.4))


def _lacking(ctx: Context) -> str | None:
    return None if np.isfinite(_second(ctx)[0]).any() else "no second wall was seen by a second horizontal rangefinder"


EFFECT = Effect(
    name="second_wall",
    equation="at its bearing (pull, R tilt, lift) sum T exp(-d2/L); loss of lift in the vertex sum T exp(-(d+d2)/3L)",
    sign="pull, tilt > 0: towards the second wall; loss > 0: less lift in the vertex",
    source="wall attraction and tilt of the first wall, added for a second one; no closed form is published",
    valid="two walls at right angles",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=("range_forward_m", "range_right_m", "range_back_m", "range_left_m", "rpm_1"),
    excite="approach the second wall at several distances from the first",
    coefficients=(
        Coefficient("pull", "1", -1.0, 1.0),
        Coefficient("tilt", "1", -2.0, 2.0),
        Coefficient("lift", "1", -1.0, 1.0),
        Coefficient("loss", "1", -1.0, 1.0),
    ),
    regressors=_regressors,
    shapes=(Shape("length_radii", "1"),),
    shape_grid=_grid,
    lacking=_lacking,
    aliases=("wall_effect",),
)
