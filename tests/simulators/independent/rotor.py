"""One open rotor: blade elements in an induced flow that has its own dynamics, and drag in the disc's plane.

Thrust: blade-element theory with linear lift and ideal twist, C_T = (sigma a / 2) (theta (1/3 + mu^2/2) - lambda/2)
(Leishman 2006, ch. 3 and 5). Inflow: rho 8/3 R^3 dv/dt = T - 2 rho A v sqrt(V^2 + (v + w)^2) (Carpenter & Fridovich
1953; Glauert 1935 in equilibrium), w the climb through the disc. Drag: -lambda_1 Omega V in the plane of the disc
(Martin & Salaun 2010). Torque: profile part with Omega^2, induced part T (v + w) / Omega.
"""

from __future__ import annotations

import numpy as np

from .airframes import RHO0, Airframe, Array


def pitch(frame: Airframe) -> float:
    """Collective angle [rad] that gives the hover thrust at the hover speed."""
    inflow = frame.hover_inflow / (frame.hover_speed * frame.radius_m)
    return 3.0 * (2.0 * frame.ct / frame.solidity_slope + inflow / 2.0)


def thrust(
    frame: Airframe, omega: Array, through: Array, across2: Array, rho: Array | float
) -> Array:
    """[N] at rotor speed ``omega`` [rad/s]; ``through`` = induced + climb [m/s]; ``across2``: in-plane speed^2."""
    tip = omega * frame.radius_m
    advance2 = across2 / np.maximum(tip * tip, 1.0)
    half = 0.5 * frame.solidity_slope
    return (
        rho
        * frame.area
        * half
        * (pitch(frame) * tip * tip * (1.0 / 3.0 + 0.5 * advance2) - 0.5 * through * tip)
    )


def next_inflow(
    frame: Airframe,
    omega: Array,
    induced: Array,
    climb: Array,
    across2: Array,
    rho: Array,
    dt: float,
) -> Array:
    """Induced velocity [m/s] after ``dt`` [s]: one step of the exponential Euler method.

    On a small rotor the inflow settles within a step (time constant 1 ms), so an explicit step would be unstable.
    """
    through = induced + climb
    speed = np.sqrt(across2 + through * through) + 1e-6
    tip = omega * frame.radius_m
    gap = thrust(frame, omega, through, across2, rho) - 2.0 * rho * frame.area * induced * speed
    stiff = (
        rho
        * frame.area
        * (0.25 * frame.solidity_slope * tip + 2.0 * (speed + induced * through / speed))
    )
    return induced + gap / stiff * -np.expm1(-dt * stiff / (8.0 / 3.0 * rho * frame.radius_m**3))


def settled_inflow(
    frame: Airframe, omega: Array, climb: Array, across2: Array, rho: Array | float
) -> Array:
    """Induced velocity [m/s] at which blades and momentum agree (bisection; lift falls and momentum grows with it)."""
    low = np.zeros(np.broadcast_shapes(np.shape(omega), np.shape(climb)))
    high = np.full_like(low, 60.0)
    for _ in range(40):
        v = 0.5 * (low + high)
        gap = thrust(frame, omega, v + climb, across2, rho) - 2.0 * rho * frame.area * v * np.sqrt(
            across2 + (v + climb) ** 2
        )
        low, high = np.where(gap > 0.0, v, low), np.where(gap > 0.0, high, v)
    return 0.5 * (low + high)


def settled_thrust(
    frame: Airframe, omega: Array, climb: Array, across2: Array, rho: Array | float
) -> Array:
    """[N] in settled inflow."""
    return thrust(
        frame, omega, settled_inflow(frame, omega, climb, across2, rho) + climb, across2, rho
    )


def profile_torque(frame: Airframe) -> float:
    """Torque per Omega^2 that is not induced power [N m s^2], from the figure of merit."""
    induced = frame.hover_thrust * frame.hover_inflow / frame.hover_speed
    return (frame.hover_torque - induced) / frame.hover_speed**2


def torque(
    frame: Airframe, omega: Array, force: Array, through: Array, rho: Array | float
) -> Array:
    """Shaft torque of the air [N m]."""
    return rho / RHO0 * profile_torque(frame) * omega**2 + force * through / np.maximum(omega, 1.0)
