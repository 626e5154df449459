"""What the pictures and words of effects share: the quantity on the x axis, and numbers as a pilot says them."""

from __future__ import annotations

import numpy as np

from models.common.frames import AXES, Array
from models.effects.context import Context
from models.effects.shown import Drawn

_WORDS = {
    "Fx": "extra force forward [N]",
    "Fy": "extra force to the right [N]",
    "Fz": "extra lift [N]",
    "Mx": "extra moment, right side down [N m]",
    "My": "extra moment, nose up [N m]",
    "Mz": "extra moment, nose right [N m]",
}
"""What the residual of an axis is to a pilot; lift is up, Fz down."""
_NEAR = 5.0
"""Percentile that stands for "as near as it flew": single readings may be wrong."""
_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def along(axis: str) -> Array:
    """Direction (6,) in which an axis is drawn."""
    out = np.zeros(6)
    out[AXES.index(axis)] = -1.0 if axis == "Fz" else 1.0
    return out


def over(label: str, values: Array, axis: str) -> Drawn:
    """An axis over a quantity (n,)."""
    return Drawn(label, np.asarray(values, dtype=float), _WORDS[axis], along(axis))


def over_time(ctx: Context, axis: str) -> Drawn:
    """For what has no quantity of its own."""
    return over("time since boot [s]", ctx.state.time_s, axis)


def over_height(ctx: Context, axis: str) -> Drawn:
    """Mean height of the fans over ground."""
    return over("height over ground [m]", fan_mean(ctx.state.h_m), axis)


def over_speed(ctx: Context, axis: str) -> Drawn:
    """Speed along the axis of the force, or for the moment that goes with it."""
    side = axis in ("Fy", "Mx")
    if side:
        label = "speed to the right [m/s]"
    else:
        label = "speed forward [m/s]"
    return over(label, ctx.velocity[..., 1 if side else 0], axis)


def over_thrust(ctx: Context, axis: str) -> Drawn:
    """Declared thrust of all fans."""
    return over("declared thrust / weight", ctx.thrust.sum(axis=-1) / ctx.weight, axis)


def over_wall(label: str, distance: Array, bearing: Array, axis: str) -> Drawn:
    """Force towards a wall at ``bearing`` [rad] (n,), or the moment that tilts to it, over its distance (n, fans)."""
    c = np.cos(bearing)
    s = np.sin(bearing)
    out = np.zeros((len(bearing), 6))
    if axis in ("Mx", "My"):
        # Towards the wall ahead is nose down, towards the wall on the right is right side down.
        out[:, 3] = s
        out[:, 4] = -c
        return Drawn(label, fan_mean(distance), "extra moment towards the wall [N m]", out)
    if axis == "Fz":
        return over(label, fan_mean(distance), axis)
    out[:, 0] = c
    out[:, 1] = s
    return Drawn(label, fan_mean(distance), "extra force towards the wall [N]", out)


def over_surfaces(ctx: Context, axis: str) -> Drawn:
    """Lift over the height, all else over the distance to the wall."""
    if axis == "Fz":
        return over_height(ctx, axis)
    return over_first_wall(ctx, axis)


def over_first_wall(ctx: Context, axis: str) -> Drawn:
    """Over the distance to the wall."""
    return over_wall("distance to the wall [m]", ctx.state.d_m, ctx.state.wall_bearing_rad, axis)


def over_second_wall(ctx: Context, axis: str) -> Drawn:
    """Over the distance to the second wall."""
    return over_wall(
        "distance to the second wall [m]", ctx.state.second_d_m, ctx.state.second_bearing_rad, axis
    )


def fan_mean(distance: Array) -> Array:
    """Mean over the fans (n,) of distances (n, fans); NaN where nothing is seen."""
    known = np.where(np.isfinite(distance), distance, np.nan)
    total = np.nansum(known, axis=-1)
    count = np.isfinite(known).sum(axis=-1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def nearest(values: Array) -> float:
    """As near as the vehicle flew; NaN where nothing was seen."""
    known = values[np.isfinite(values)]
    if known.size:
        return float(np.percentile(known, _NEAR))
    return float("nan")


def pull_words(share: float) -> str:
    """What a wall does that pulls with this share of the thrust, or pushes where it is negative."""
    if share > 0.0:
        verb = "pulls"
    else:
        verb = "pushes"
    return f"{verb} with {percent(share)} of the thrust"


def percent(share: float) -> str:
    """``9 %``, without sign."""
    if abs(share) < 0.1:
        return f"{abs(share) * 100.0:.2g} %"
    return f"{abs(share) * 100.0:.0f} %"


def force_words(ctx: Context, newton: float) -> str:
    """A force; without a known mass, as a share of the weight."""
    if ctx.vehicle.mass_assumed:
        return f"{percent(newton / ctx.weight)} of the weight"
    return f"{newton:.2g} N"


def mass_words(ctx: Context, kg: float) -> str:
    """A mass; without a known mass of the vehicle, as a share of it."""
    if ctx.vehicle.mass_assumed:
        return f"{percent(kg / ctx.vehicle.mass_kg)} of the weight"
    return f"{abs(kg):.2g} kg"


def more(share: float, positive: str = "more", negative: str = "less") -> str:
    """A share in words: ``9 % more``."""
    return f"{percent(share)} {positive if share >= 0.0 else negative}"


def compass(north: float, east: float) -> str:
    """Name of the direction towards which a level vector points."""
    return _POINTS[round(float(np.degrees(np.arctan2(east, north))) / 45.0) % 8]


def mean(values: Array) -> float:
    """Of the finite ones; NaN without any."""
    known = values[np.isfinite(values)]
    if known.size:
        return float(known.mean())
    return float("nan")
