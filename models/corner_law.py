"""A closed form of the corner effect for one coaxial ducted fan: fidelity 0, an engineering estimate, not CFD.

Every increment is a share of the free-air lift T0 (forces), of T0 R (moments) or of the pair's torque Q0 (yaw).
Sources: the cut-offs, signs and hover point are the paper's (section 2, table 1); the ground gain near 2 R, the duct's
share of the thrust and the re-ingestion loss are anchored on published ducted-fan data; all other constants are
engineering choices. Valid for h/R 0.3...4, d/R 0.05...3.8.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from models.common.frames import GRAVITY, Array
from models.dataset import DataSet

FIDELITY = {"level": 0, "label": "closed form, not CFD"}


@dataclass(frozen=True, kw_only=True)
class ClosedForm:
    """Constants of the closed form; lengths over R, gains as shares of the free-air lift unless said otherwise."""

    radius_m: float = 0.165
    hover_lift_n: float = 0.5 * 4.6 * GRAVITY
    hover_rpm: float = 4000.0
    density_kg_m3: float = 1.225
    reynolds_exponent: float = 0.04
    """C_T grows as (rpm / hover_rpm)^this."""
    duct_share: float = 0.40
    """Share of the free-air thrust that the duct's lip carries."""
    rotor_gain: float = 0.60
    rotor_length: float = 0.85
    duct_loss: float = 0.45
    duct_length: float = 0.40
    ground_fade: tuple[float, float] = (3.0, 4.0)
    wall_lift: float = 0.018
    wall_pull: float = 0.022
    wall_length: float = 0.90
    lip_asymmetry: float = 0.30
    lip_length: float = 1.10
    wall_fade: tuple[float, float] = (2.8, 3.8)
    ridge_height: float = 1.3
    ridge_slope: float = 0.75
    ridge_width: float = 0.45
    ridge_length: float = 1.6
    """Flow off the wall is drawn in again where h/R is near ridge_height + ridge_slope d/R."""
    ridge_lift: float = 0.085
    ridge_pull: float = 0.012
    ridge_tilt: float = 0.90
    cushion_length: float = 0.60
    cushion_lift: float = 0.045
    cushion_pull: float = 0.070
    cushion_tilt: float = 0.035
    """Air trapped between ground, wall and fan."""
    swirl: float = 0.08
    """Side force and moment per lateral ones; sign of the upper rotor."""
    figure_of_merit: float = 0.60
    ground_torque: float = 0.05
    ridge_torque: float = 0.03

    def lift(self, rpm: ArrayLike) -> Array:
        """Free-air lift T0 [N]."""
        speed = np.asarray(rpm, dtype=float) / self.hover_rpm
        return np.asarray(self.hover_lift_n * speed ** (2.0 + self.reynolds_exponent))

    def torque(self, rpm: ArrayLike) -> Array:
        """Sum of both rotors' torque magnitudes Q0 [N m], from ideal duct power over the figure of merit."""
        area = math.pi * self.radius_m**2
        power = (
            self.hover_lift_n**1.5
            / math.sqrt(4.0 * self.density_kg_m3 * area)
            / self.figure_of_merit
        )
        hover = power / (self.hover_rpm * 2.0 * math.pi / 60.0)
        return np.asarray(self.lift(rpm) * (hover / self.hover_lift_n))

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """Total wrench (..., 6) in N and N m, corner frame, at h, d [m] (``inf`` allowed) and rpm."""
        eta = np.clip(np.asarray(h, dtype=float) / self.radius_m, 0.3, 50.0)
        delta = np.clip(np.asarray(d, dtype=float) / self.radius_m, 0.05, 50.0)
        ground = fade(eta, *self.ground_fade)
        wall = fade(delta, *self.wall_fade)
        rotor = (1 - self.duct_share) * self.rotor_gain * np.exp(-eta / self.rotor_length)
        duct = self.duct_share * self.duct_loss * np.exp(-eta / self.duct_length)
        offset = np.log(eta / (self.ridge_height + self.ridge_slope * delta)) / self.ridge_width
        ridge = np.exp(-(offset**2) - delta / self.ridge_length) * ground * wall
        cushion = np.exp(-(eta + delta) / self.cushion_length) * ground * wall
        near_wall = np.exp(-delta / self.wall_length) * wall
        tilt = 0.5 * self.duct_share * self.lip_asymmetry * np.exp(-delta / self.lip_length) * wall
        lift = (
            (rotor - duct) * ground
            + self.wall_lift * near_wall
            - self.ridge_lift * ridge
            + self.cushion_lift * cushion
        )
        pull = self.wall_pull * near_wall - self.ridge_pull * ridge - self.cushion_pull * cushion
        moment = tilt * (1 + self.ridge_tilt * ridge) - self.cushion_tilt * cushion
        yaw = self.ground_torque * np.exp(-eta / 0.8) * ground + self.ridge_torque * ridge
        t0 = self.lift(rpm)
        q0 = self.torque(rpm)
        arm = t0 * self.radius_m
        parts = (
            t0 * pull,
            t0 * self.swirl * pull,
            t0 * (1 + lift),
            -arm * self.swirl * moment,
            arm * moment,
            q0 * yaw,
        )
        return np.stack(np.broadcast_arrays(*parts), axis=-1)

    def data_set(self) -> DataSet:
        """A grid: h/R 0.3...5.5, d/R 0.05...4.5, inf, and five speeds; denser close by."""
        h = np.append(self.radius_m * _graded(0.3, 5.5, 21), np.inf)
        d = np.append(self.radius_m * _graded(0.05, 4.5, 20), np.inf)
        rpm = np.array([2500.0, 3200.0, 4000.0, 4800.0, 5600.0])
        hh, dd, nn = (a.ravel() for a in np.meshgrid(h, d, rpm, indexing="ij"))
        wrench = self.wrench(hh, dd, nn)
        table = np.column_stack([hh, dd, nn, wrench]).round(9)
        return DataSet(
            h=hh,
            d=dd,
            rpm=nn,
            wrench=wrench,
            source="closed form",
            sha256=hashlib.sha256(table.tobytes()).hexdigest(),
        )


def fade(x: Array, start: float, end: float) -> Array:
    """1 below ``start``, 0 above ``end``, a quintic with continuous curvature between."""
    t = np.clip((x - start) / (end - start), 0.0, 1.0)
    return np.asarray(1.0 - t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def _graded(low: float, high: float, count: int) -> Array:
    """Points from ``low`` to ``high`` whose spacing grows linearly."""
    t = np.linspace(0.0, 1.0, count)
    return low + (high - low) * (0.45 * t + 0.55 * t**2)
