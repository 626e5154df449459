"""Thrust at speed: the faster a rotor moves through the air, the less it has to suck, and the more its blades lift.

Valid: level flight and climbs; not in its own wake (vortex ring).
Source: momentum theory in forward flight, v_i = T / (2 rho A sqrt(v_xy^2 + (v_up + v_i)^2)): Glauert 1926, ARC R&M
1026; Leishman 2006, Principles of Helicopter Aerodynamics, ch. 2.14.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.pictures import mean, over_speed, percent
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown
from models.vehicle import RHO_SEA_LEVEL
from models.vehicle_wrench import RPM_TO_RAD_S

ROUNDS = 20
"""Of the fixed point of the induced velocity."""
FAST_M_S = 5.0
"""Speed at which the effect is told."""


def induced(hover: Array, level: Array | float, climb: Array | float = 0.0) -> Array:
    """Induced velocity v (...) [m/s] at a level speed V and a climb c (...), of fans that have ``hover`` h in hover.

    v sqrt(V^2 + (c + v)^2) = h^2, as the fixed point of v = h^2 / sqrt(V^2 + (c + v)^2), every round half way. A fan
    that sinks faster than h is in its own wake, which momentum theory does not know: it counts as sinking with h.
    """
    through = np.maximum(climb, -hover)
    v = hover.copy()
    for _ in range(ROUNDS):
        v = 0.5 * (v + hover**2 / np.sqrt(level**2 + (through + v) ** 2 + 1e-9))
    return v


def _hover(ctx: Context) -> Array:
    disc = 2.0 * RHO_SEA_LEVEL * ctx.vehicle.disc_area_m2
    return np.sqrt(np.maximum(ctx.thrust, 0.0) / disc)


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    tip = np.maximum(ctx.rpm * RPM_TO_RAD_S * ctx.vehicle.rotor_radius_m, 1.0)
    level = np.linalg.norm(ctx.velocity[..., :2], axis=-1)[..., None]
    climb = -ctx.velocity[..., 2][..., None]
    hover = _hover(ctx)
    gained = hover - induced(hover, level, climb)
    # The force alone: single fans answer disturbances of the moment within the control loop.
    out = ctx.lift(ctx.thrust * gained / tip)
    out[..., 3:] = 0.0
    return (out,)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    hover = np.array(mean(_hover(ctx)))
    tip = mean(ctx.rpm) * RPM_TO_RAD_S * ctx.vehicle.rotor_radius_m
    gain = p["slope"] * float(hover - induced(hover, FAST_M_S)) / max(tip, 1.0)
    return f"at {FAST_M_S:.0f} m/s a fan lifts {percent(gain)} more at the same speed"


EFFECT = Effect(
    name="momentum_thrust",
    equation="dF_z = -c T (v_h - v_i) / (Omega R), v_i the induced velocity, v_h that of hover",
    sign="slope > 0: lift is gained in level flight",
    axes=("Fz",),
    channels=("vn_m_s", "ve_m_s", "rpm_1"),
    excite="fly level, faster than 5 m/s",
    coefficients=(
        Coefficient(name="slope", unit="1", low=0.2, high=20.0, typical=2.5, centre=4.0),
    ),
    wrenches=_wrenches,
    search=SearchHints(
        chance=0.01,
    ),
    aliases=("vertical_inflow",),
    shown=Shown(drawn=over_speed, in_words=_words),
)
