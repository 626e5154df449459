"""Momentum (Glauert) and blade-element theory of one fan in a relative wind: drag, inflow, translational lift.

The disc sees the air moving at (u, w): ``u`` in the plane, ``w`` along the axis, positive when the fan climbs. Induced
velocity follows from T = 2 rho A v sqrt(u^2 + (v + w)^2); thrust at fixed speed from the mean blade angle that gives
the hover thrust, C_T = (sigma a / 2)(theta/3 (1 + 1.5 mu^2) - lambda/2). The stream that leaves the fan has lost a
share of its sideways momentum (turned by the duct, or by the discs), and the blades drag it too.
"""

from __future__ import annotations

import numpy as np

from .craft import RHO0, Array, Craft

_LIFT_SLOPE = 5.7
_PROFILE_DRAG = 0.012


def solidity(craft: Craft) -> float:
    """Blade area over disc area of one unit."""
    return 0.417 if craft.rotors_per_fan == 2 else 0.12


def induced(craft: Craft, thrust: Array, u: Array, w: Array) -> Array:
    """Induced velocity [m/s] at the disc, by damped fixed-point iterations of Glauert's equation."""
    hover2 = np.maximum(thrust, 0.1) / (2.0 * RHO0 * craft.area)
    v = np.sqrt(hover2)
    for _ in range(6):
        v = 0.5 * v + 0.5 * hover2 / np.sqrt(u * u + (v + w) ** 2 + 1e-6)
    return v


def thrust_ratio(craft: Craft, rpm: Array, u: Array, w: Array) -> Array:
    """Thrust at fixed rotor speed in a relative wind over thrust in still air."""
    tip = rpm * np.pi / 30.0 * craft.radius_m
    sa = solidity(craft) * _LIFT_SLOPE
    disc = RHO0 * craft.area * tip * tip
    still = craft.ct * disc
    # Collective that makes still air give the declared thrust.
    inflow0 = np.sqrt(still / (2.0 * RHO0 * craft.area)) / tip
    pitch = 3.0 * (2.0 * craft.ct / sa + 0.5 * inflow0)
    mu2 = (u / tip) ** 2
    thrust = still
    for _ in range(5):
        inflow = (w + induced(craft, thrust, u, w)) / tip
        new = disc * 0.5 * sa * (pitch / 3.0 * (1.0 + 1.5 * mu2) - 0.5 * inflow)
        thrust = 0.5 * thrust + 0.5 * np.maximum(new, 0.05 * still)
    return thrust / still


def side_force(
    craft: Craft, thrust: Array, rpm: Array, ux: Array, uy: Array, w: Array, turned: Array
) -> Array:
    """In-plane force (2, ...) [N] on a fan moving at (ux, uy) through air; ``turned`` = share of momentum lost."""
    u = np.hypot(ux, uy)
    v = induced(craft, thrust, u, w)
    flow = RHO0 * craft.area * np.sqrt(u * u + (v + w) ** 2)
    tip = rpm * np.pi / 30.0 * craft.radius_m
    blades = 0.25 * solidity(craft) * _PROFILE_DRAG * RHO0 * craft.area * tip
    return -(turned * flow + blades) * np.stack([ux, uy])
