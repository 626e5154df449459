"""A load on a rope: a pendulum that the vehicle's own motion drives, and its weight.

Valid: small angles of the rope.
Source: Bisgaard, la Cour-Harbo & Bendtsen 2010, Control Engineering Practice 18(7): pendulum under a hook.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import GRAVITY, Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context, through
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.pictures import mass_words
from models.effects.shown import Quantity, Shown

DAMPING = 0.04
DIED_DOWN = 2.0
"""Time constants of the swing that a flight has to last."""
DENSITY_KG_M3 = 1000.0
DENSITY_SPREAD = 0.5
"""Of a load: water; and the standard deviation of its logarithm."""
DRAWN = 0
"""Seed: the same interval for the same answer."""
ROPES_M = (0.25, 0.35, 0.45, 0.55, 0.7, 0.9, 1.2, 1.5, 2.0)


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    # What hangs is pulled down, not along the body; climbing, it is lifted as the vehicle is.
    down = ctx.state.rotation[..., 2, :]
    weight = np.zeros((*ctx.state.time_s.shape, 6))
    weight[..., :3] = (
        down * (down[..., 2] * ctx.thrust.sum(axis=-1) / ctx.vehicle.mass_kg)[..., None]
    )
    swing = np.zeros_like(weight)
    if ctx.record:
        w0 = np.sqrt(GRAVITY / shape[0])
        # The hook's acceleration from the velocity, not from the accelerometer, whose noise is in the residual.
        level = ctx.state.velocity_ned[:, :2]
        pull = through(
            ctx, level, lambda w: -1j * w * w0**2 / (w0**2 - w**2 + 2j * DAMPING * w0 * w)
        )
        swing[:, :3] = np.einsum("nji,nj->ni", ctx.state.rotation[:, :2], pull)
    # The rope pulls at a hook below the CG.
    hook = np.zeros_like(weight)
    hook[..., 3] = -(weight + swing)[..., 1]
    hook[..., 4] = (weight + swing)[..., 0]
    return swing, weight, hook


def _likely(ctx: Context) -> float:
    return 0.1 * ctx.vehicle.mass_kg


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    # How the load swung when the flight began is not known: that has to die down, exp(-DAMPING w0 t), to be no matter.
    first, last = ctx.judged_s or (ctx.state.time_s[0], ctx.state.time_s[-1])
    longest = GRAVITY * (DAMPING * (last - first) / DIED_DOWN) ** 2
    return tuple((rope,) for rope in ROPES_M if rope <= longest)


def _lacking(ctx: Context) -> str | None:
    if _grid(ctx):
        return None
    return "the flight is too short for a swing to show"


def _length(ctx: Context, draws: Mapping[str, Array]) -> Array:
    """Length of the rope (m,) by that of the pendulum, L = l (1 + D / (m g)): the wash pulls the load down, too.

    In the wash, of twice the induced velocity (momentum theory), a load of cross-section S and drag coefficient 1 has
    D = (M + m) g S / A, A the rotors' area. S = (m / rho)^(2/3). How much of the wash meets it is not known: 0 to 1;
    a single draw has the middle of both.
    """
    load = np.maximum(draws["swinging"], 1e-6 * ctx.vehicle.mass_kg)
    density = np.full(len(load), DENSITY_KG_M3)
    met = np.full(len(load), 0.5)
    if len(load) > 1:
        rng = np.random.default_rng(DRAWN)
        density *= np.exp(DENSITY_SPREAD * rng.standard_normal(len(load)))
        met = rng.uniform(size=len(load))
    rotors_m2 = ctx.vehicle.disc_area_m2 * len(ctx.vehicle.fans)
    section_m2 = (load / density) ** (2.0 / 3.0)
    pulled = met * (1.0 + ctx.vehicle.mass_kg / load) * section_m2 / rotors_m2
    return np.asarray(draws["rope_m"] * (1.0 + pulled))


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    load = mass_words(ctx, p["mass_kg"])
    return f"a load of {load} swings on a rope of {p['length_m']:.2f} m"


EFFECT = Effect(
    name="slung_load",
    belongs_to=BelongsTo.LOAD,
    equation="dF_xy = m w0^2 x, x'' + 2 z w0 x' + w0^2 x = -a_xy, w0 = sqrt(g/L); dF_z = m g; dM "
    "= b z x dF",
    sign="mass > 0: hangs below",
    axes=("Fx", "Fy", "Fz", "Mx", "My"),
    channels=("vn_m_s", "ve_m_s", "roll_rad", "pitch_rad"),
    excite="sideways steps and stops, then hover and wait",
    coefficients=(
        Coefficient(
            name="swinging",
            unit="kg",
            low=0.0,
            high=lambda ctx: ctx.most_load_kg,
            typical=_likely,
            centre=_likely,
            foretold=True,
        ),
        Coefficient(
            name="mass",
            unit="kg",
            low=0.0,
            high=lambda ctx: ctx.most_load_kg,
            typical=_likely,
            centre=_likely,
        ),
        Coefficient(
            name="hook", unit="kg m", low=-1e3, high=1e3, typical=lambda ctx: 0.3 * ctx.lever
        ),
    ),
    wrenches=_wrenches,
    shapes=(Shape(name="rope_m", unit="m", tried=ROPES_M),),
    grid=_grid,
    lacking=_lacking,
    aliases=("payload",),
    in_flight=NOT_FLOWN,
    main=("swinging",),
    contains=("payload",),
    shown=Shown(
        in_words=_words,
        quantities=(
            # What swings is the load; what hangs still is told from the level of the thrust by nothing.
            Quantity(instead_of="swinging", name="mass_kg", unit="kg"),
            Quantity(instead_of="mass", name="hanging_kg", unit="kg"),
            Quantity(instead_of="rope_m", name="length_m", unit="m", of=_length),
        ),
    ),
)
