"""What surfaces near a rotor do, as factors and coefficients of its thrust.

Ground: the image method for a whole quadrotor with a fountain under the body (Sanchez-Cuevas, Heredia & Ollero 2017).
Ceiling: power gain (1 + sqrt(1 + (R/gap)^2 / 8)) / 2 at equal thrust, turned to thrust (Hsiao & Chirarattananon 2019).
Wall: powers of radius over distance to the hub, as an image of the rotor's sink gives far away; sizes of open rotors
near walls as CFD and wall-flight papers report them (some per cent of thrust).
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from .airframes import Airframe, Array

REACH_M = 50.0
"""Distances beyond count as infinite."""


def ground_gain(frame: Airframe, height: Array) -> Array:
    """Thrust in ground effect over thrust without, minus 1, at rotor height ``height`` [m] (inf allowed)."""
    radius, beside = frame.radius_m, np.sqrt(2.0) * frame.arm_m
    z = np.clip(height, 0.45 * radius, REACH_M)
    z2 = 4.0 * z * z
    loss = (radius / (4.0 * z)) ** 2
    loss = (
        loss
        + radius**2 * z / np.sqrt((beside**2 + z2) ** 3)
        + 0.5 * radius**2 * z / np.sqrt((2 * beside**2 + z2) ** 3)
    )
    loss = loss + 2.0 * radius**2 * z * 0.7 / np.sqrt((frame.arm_m**2 + z2) ** 3)
    return np.where(height < REACH_M, 1.0 / (1.0 - np.minimum(loss, 0.5)) - 1.0, 0.0)


def ceiling_gain(frame: Airframe, gap: Array) -> Array:
    """Thrust under a ceiling over thrust without, minus 1; ``gap`` = rotor to ceiling [m]."""
    ratio = frame.radius_m / np.clip(gap, 0.15 * frame.radius_m, REACH_M)
    power = 0.5 + 0.5 * np.sqrt(1.0 + ratio**2 / 8.0)
    return np.where(gap < REACH_M, power ** (2.0 / 3.0) - 1.0, 0.0)


def wall_terms(frame: Airframe, lip_gap: Array, height: Array) -> tuple[Array, Array, Array]:
    """Pull to the wall over T, tilting moment to the wall over T R, and loss of thrust over T; ``lip_gap`` = d [m]."""
    away = frame.radius_m / (np.clip(lip_gap, 0.0, REACH_M) + frame.lip_m)
    low = 1.0 + 0.6 / (1.0 + (height / (3.0 * frame.radius_m)) ** 2)
    near = np.where(lip_gap < REACH_M, 1.0, 0.0)
    return near * 0.045 * away**2 * low, near * 0.07 * away**3, near * 0.035 * away**2 * low


def corner_wrench(frame: Airframe, height: Array, lip_gap: Array, rpm: Array) -> Array:
    """The declared law of one rotor in its corner frame, (6, ...): what ``write_table`` samples."""
    free = frame.hover_thrust * (rpm / frame.hover_rpm) ** 2
    pull, tilt, loss = wall_terms(frame, lip_gap, height)
    zero = np.zeros(np.broadcast_shapes(np.shape(free), np.shape(pull), np.shape(height)))
    lift = free * (1.0 + ground_gain(frame, height)) * (1.0 - loss)
    return np.stack(
        [free * pull + zero, zero, lift + zero, zero, free * frame.radius_m * tilt + zero, zero]
    )


def write_table(frame: Airframe, path: Path) -> None:
    """The declared law as a data set of the contract, section 4."""
    r = frame.radius_m
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["h_m", "d_m", "rpm", "Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm"])
        for h in [
            *(r * np.array([0.5, 0.7, 0.9, 1.1, 1.4, 1.7, 2.1, 2.6, 3.2, 4.0, 5.0, 7.0])),
            np.inf,
        ]:
            for d in [
                *(r * np.array([0.05, 0.2, 0.4, 0.65, 0.9, 1.2, 1.6, 2.1, 2.7, 3.5, 4.5, 6.0])),
                np.inf,
            ]:
                for rpm in (0.6, 0.85, 1.0, 1.15, 1.4):
                    speed = round(rpm * frame.hover_rpm)
                    w = corner_wrench(frame, np.array(h), np.array(d), np.array(float(speed)))
                    out.writerow([f"{h:.6g}", f"{d:.6g}", speed, *(f"{v:.7g}" for v in w)])
