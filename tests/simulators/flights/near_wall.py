"""The declared air: what ground, wall and corner do to one fan, and the table the surrogate is trained on.

Assumed: rational (algebraic) decays with distance over a quintic fade to zero at 4 radii over ground and 3.8 from the
wall, and one re-ingestion ridge in the corner; increments scale with the free-air thrust at the same speed. The law is
arbitrary but smooth, of the size the paper reports. Corner frame: X to the wall, Z up, Y = Z x X.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from .craft import Array, Craft


def fade(x: Array, low: float, high: float) -> Array:
    """1 below ``low``, 0 above ``high``, quintic between."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return 1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0))


def free_thrust(craft: Craft, rpm: Array) -> Array:
    """Thrust of one fan in free, still air [N]."""
    ratio = rpm / craft.hover_rpm
    return craft.hover_fan_thrust * ratio ** (2.0 + craft.reynolds)


def fan_wrench(craft: Craft, h: Array, d: Array, rpm: Array) -> Array:
    """Corner-frame wrench (6, ...) of one fan at height ``h`` and lip distance ``d`` [m], ``inf`` allowed."""
    thrust = free_thrust(craft, rpm)
    if craft.cq:  # the quadrotor is declared without a surrogate: rotors in free air
        zero = np.zeros_like(thrust)
        return np.stack([zero, zero, thrust, zero, zero, zero])
    e = np.clip(h / craft.radius_m, 0.3, 20.0)
    w = np.clip(d / craft.radius_m, 0.05, 20.0)
    over, beside = fade(e, 2.8, 4.0), fade(w, 2.4, 3.8)
    near = beside / (1.0 + w) ** 2
    ridge = over * beside / ((1.0 + ((e - 1.2 - 0.6 * w) / 0.7) ** 2) * (1.0 + w * w))
    ground = over * (0.17 / (1.0 + (e / 1.05) ** 3) - 0.07 * np.exp(-((e / 0.5) ** 2)))
    lift = 1.0 + ground + 0.02 * near - 0.06 * ridge
    pull = 0.02 * beside / (1.0 + 1.4 * w) ** 2 - 0.01 * ridge
    tilt = 0.032 * near * (1.0 + ridge)
    torque = 0.012 * over / (1.0 + e * e) + 0.01 * ridge
    arm = thrust * craft.radius_m
    return np.stack(
        [
            thrust * pull,
            0.06 * thrust * pull,
            thrust * lift,
            -0.06 * arm * tilt,
            arm * tilt,
            arm * torque,
        ]
    )


def to_body(corner: Array, bearing: Array) -> Array:
    """Corner frame to body FRD for a wall at ``bearing`` from the nose, positive to the right; (6, ...)."""
    c, s = np.cos(bearing), np.sin(bearing)
    fx, fy, fz, mx, my, mz = corner
    return np.stack([c * fx + s * fy, s * fx - c * fy, -fz, c * mx + s * my, s * mx - c * my, -mz])


def write_table(craft: Craft, path: Path) -> None:
    """Sample the law on a grid, in the data-set format of the contract, section 4."""
    r = craft.radius_m
    heights = [
        *(
            r
            * np.array(
                [
                    0.3,
                    0.5,
                    0.65,
                    0.8,
                    1.0,
                    1.2,
                    1.4,
                    1.6,
                    1.8,
                    2.0,
                    2.3,
                    2.6,
                    3.0,
                    3.4,
                    3.8,
                    4.2,
                    5.0,
                ]
            )
        )
    ]
    walls = [
        *(
            r
            * np.array(
                [0.05, 0.2, 0.35, 0.5, 0.7, 0.9, 1.1, 1.4, 1.7, 2.0, 2.4, 2.8, 3.2, 3.8, 4.5]
            )
        )
    ]
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["h_m", "d_m", "rpm", "Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm"])
        for h in [*heights, np.inf]:
            for d in [*walls, np.inf]:
                for rpm in (2600.0, 3200.0, 3800.0, 4400.0, 5000.0):
                    w = fan_wrench(craft, np.array(h), np.array(d), np.array(rpm))
                    out.writerow([f"{h:.6g}", f"{d:.6g}", f"{rpm:.6g}", *(f"{v:.8g}" for v in w)])
