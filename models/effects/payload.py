"""More (or less) mass than declared, from the start or picked up in flight.

Valid: a load that moves with the vehicle.
Source: Newton's second law with a mass that is not declared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import Array
from models.effects.effect import BelongsTo, Coefficient, Context, Effect, Quantity, Shape, Shown
from models.effects.pictures import percent

MISSING = 0.25
"""Share of the mass that may be missing: a smaller pack and no camera. Some pack, a quarter of most, is on board."""
BESIDE_S = 8.0
"""Flight before and after a load is picked up: right after the start the ground lifts, and the pack is not settled."""


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    (start,) = shape
    # The declared lift stands for the specific force: the accelerometer's noise is in the residual as well.
    out = np.zeros((*ctx.state.time_s.shape, 6))
    out[..., 2] = ctx.thrust.sum(axis=-1) / ctx.vehicle.mass_kg
    return (out * (ctx.state.time_s >= start)[..., None],)


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    first, last = ctx.judged_s or (ctx.state.time_s[0], ctx.state.time_s[-1])
    inner = np.arange(first + BESIDE_S, last - BESIDE_S, max(2.0, (last - first) / 150.0))
    return ((0.0,), *((float(s),) for s in inner))


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    mass = p["mass_kg"]
    way = "heavier" if mass > 0.0 else "lighter"
    share = percent(mass / ctx.vehicle.mass_kg)
    start = f", from {p['from_s']:.0f} s on" if p["from_s"] > 0.0 else ""
    if ctx.vehicle.mass_assumed:
        return f"the vehicle is {share} {way} than its lift says{start}"
    size = f"the vehicle is {abs(mass):.2g} kg {way} than in its file"
    return f"{size} ({share} of {ctx.vehicle.mass_kg:.2g} kg){start}"


EFFECT = Effect(
    name="payload",
    belongs_to=BelongsTo.LOAD,
    equation="dF = -dm f, f the specific force, from a time on",
    sign="mass > 0: heavier than declared",
    axes=("Fz",),
    channels=("az_m_s2", "rpm_1", "rpm_2", "rpm_3", "rpm_4"),
    excite="weigh the vehicle, or pick the load up in flight",
    # Loads are added more often than taken off.
    coefficients=(
        Coefficient(
            "mass",
            "kg",
            low=lambda ctx: -MISSING * ctx.vehicle.mass_kg,
            high=lambda ctx: ctx.most_load_kg,
            typical=lambda ctx: 0.15 * ctx.vehicle.mass_kg,
            centre=lambda ctx: 0.1 * ctx.vehicle.mass_kg,
        ),
    ),
    wrenches=_wrenches,
    shapes=(Shape("from_s", "s", kinds=(0.0,)),),
    grid=_grid,
    halvings=4,
    aliases=("thrust_scale", "air_density"),
    exact=True,
    chance=0.045,
    shown=Shown(
        in_words=_words,
        quantities=(Quantity(instead_of="mass", name="mass_kg", unit="kg"),),
    ),
)
