"""The rotors are flywheels whose spins do not cancel.

Valid: rigid rotors.
Source: Euler's equations of a gyrostat; Mahony, Kumar & Corke 2012, IEEE Robotics & Automation Magazine 19(3), 20-32.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.pictures import mean, over
from models.effects.search_hints import SearchHints
from models.effects.shown import Drawn, Shown
from models.vehicle_wrench import RPM_TO_RAD_S


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    if abs(shape[0]) < 0.5:
        signs = np.array([rotor.spin for rotor in ctx.vehicle.rotors])
    else:
        signs = np.full(len(ctx.vehicle.rotors), np.sign(shape[0]))
    total = spin(ctx, signs)
    out = np.zeros((*total.shape, 6))
    out[..., 3] = -ctx.state.rates[..., 1] * total
    out[..., 4] = ctx.state.rates[..., 0] * total
    out[..., 5] = -spin_change(ctx, total)
    return (out,)


def spin(ctx: Context, signs: Array) -> Array:
    """Sum of the rotor speeds (...) [rad/s], each with its sign."""
    return np.asarray((ctx.rotor_rpm * signs).sum(axis=-1) * RPM_TO_RAD_S)


def spin_change(ctx: Context, total: Array) -> Array:
    """Change of a sum of rotor speeds (...) [rad/s^2]; 0 of one instant."""
    if ctx.record:
        return np.asarray(np.gradient(total, ctx.state.time_s))
    return np.zeros_like(total)


def likely_inertia(ctx: Context) -> float:
    """Moment of inertia of a rotor [kg m^2]: half a percent of a disc with the vehicle's mass."""
    return 0.005 * ctx.vehicle.mass_kg * ctx.vehicle.rotor_radius_m**2


def _drawn(ctx: Context, axis: str) -> Drawn:
    pitch = axis == "Mx"
    if pitch:
        label = "pitch rate [deg/s]"
    else:
        label = "roll rate [deg/s]"
    return over(label, np.degrees(ctx.state.rates[..., 1 if pitch else 0]), axis)


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    spin = mean(ctx.rotor_rpm) * RPM_TO_RAD_S * abs(p["inertia"])
    moment = spin * np.radians(90.0)
    size = f"{moment:.2g} N m"
    if ctx.vehicle.mass_assumed:
        size = f"{moment / ctx.weight * 1000.0:.2g} mm times the weight"
    return f"turned at 90 deg/s, one rotor gives a gyroscopic moment of {size}"


EFFECT = Effect(
    name="gyroscopic",
    equation="dM = -w x H - dH/dt, H = J sum s_i Omega_i (s_i the declared spins, or all alike)",
    sign="all_alike 1: all clockwise seen from above, -1: all against it, 0: as declared",
    axes=("Mx", "My", "Mz"),
    channels=("p_rad_s", "q_rad_s", "rpm_1", "rpm_2"),
    excite="quick roll and pitch steps, and steps of the thrust",
    coefficients=(
        Coefficient(name="inertia", unit="kg m^2", low=0.0, high=0.1, typical=likely_inertia),
    ),
    wrenches=_wrenches,
    shapes=(Shape(name="all_alike", unit="1", continuous=False, tried=(0.0, 1.0, -1.0)),),
    contains=("rotor_inertia",),
    in_flight=NOT_FLOWN,
    shown=Shown(drawn=_drawn, in_words=_words),
    search=SearchHints(
        needs_moments=True,
    ),
)
