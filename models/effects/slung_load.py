"""A load on a rope: a pendulum that the vehicle's own motion drives, and its weight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.effects._base import Coefficient, Context, Effect, InFlight, Shape, columns, through
from models.wrench import GRAVITY, Array

DAMPING = 0.04


def _regressors(ctx: Context, shape: tuple[float, ...]) -> Array:
    weight = np.zeros((*ctx.state.time_s.shape, 6))
    weight[..., :3] = -ctx.state.specific_force
    swing = np.zeros_like(weight)
    if ctx.record:
        w0 = np.sqrt(GRAVITY / shape[0])
        world = np.einsum("...ij,...j->...i", ctx.state.rotation, ctx.state.specific_force)
        pull = np.zeros_like(world)
        pull[:, :2] = through(
            ctx, world[:, :2], lambda omega: -(w0**2) / (w0**2 - omega**2 + 2j * DAMPING * w0 * omega)
        )
        pull[:, :2] += world[:, :2]  # what a fixed load would pull is in the weight
        swing[:, :3] = np.einsum("...ji,...j->...i", ctx.state.rotation, pull)
    return columns(swing, weight)


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    return tuple((s,) for s in (0.25, 0.35, 0.45, 0.55, 0.7, 0.9, 1.2)) if ctx.record else ((1.0,),)


EFFECT = Effect(
    name="slung_load",
    equation="dF_xy = m w0^2 x, x'' + 2 z w0 x' + w0^2 x = -a_xy, w0 = sqrt(g/L); dF_z = m g",
    sign="mass > 0: hangs below",
    source="physics.md E24",
    valid="small angles of the rope",
    axes=("Fx", "Fy", "Fz"),
    channels=("ax_m_s2", "ay_m_s2", "roll_rad", "pitch_rad"),
    excite="sideways steps and stops, then hover and wait",
    coefficients=(Coefficient("swinging", "kg", 0.0, 1e3), Coefficient("mass", "kg", -1e3, 1e3)),
    regressors=_regressors,
    shapes=(Shape("rope_m", "m"),),
    shape_grid=_grid,
    aliases=("payload",),
    in_flight=InFlight.NONE,
    main=("swinging",),
)
