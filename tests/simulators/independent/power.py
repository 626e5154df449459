"""Battery, speed controllers, motors and their heat.

Motor: V duty = R I + K Omega, torque K I, copper 0.39 %/K, magnets in the cooled bell. Battery: open-circuit curve of a
lithium polymer cell, ohmic resistance, one RC branch, charge drawn by Peukert's law. Winding: one heat node.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .airframes import Airframe, Array, ThrottleCurve

CHARGE = np.array([-0.2, 0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.85, 0.95, 1.0])
CELL_V = np.array([2.6, 3.2, 3.5, 3.64, 3.73, 3.78, 3.85, 3.97, 4.08, 4.15, 4.19])
PEUKERT = 1.06
COPPER = 0.0039
MAGNET = -0.0002
"""Per kelvin of the windings: magnets lose 0.1 %/K, and in the bell, in the rotor's stream, warm up a fifth as much."""


@lru_cache
def motor_constant(frame: Airframe) -> float:
    """K [V s = N m/A]: chosen so that the nominal voltage at the hover duty turns the rotor at hover speed."""
    volts, load = frame.hover_duty * frame.nominal_v, frame.hover_torque
    k = volts / frame.hover_speed
    for _ in range(50):
        k = (volts - frame.motor_ohm * load / k) / frame.hover_speed
    return k


def motor_current(frame: Airframe, volts: Array, omega: Array, warm_k: Array | float) -> Array:
    """[A] through the winding; ESCs let no current flow back (no active braking)."""
    k = motor_constant(frame) * (1.0 + MAGNET * np.asarray(warm_k))
    return np.maximum(
        (volts - k * omega) / (frame.motor_ohm * (1.0 + COPPER * np.asarray(warm_k))), 0.0
    )


def motor_torque(frame: Airframe, current: Array, warm_k: Array | float) -> Array:
    """[N m] on the shaft."""
    return motor_constant(frame) * (1.0 + MAGNET * np.asarray(warm_k)) * current


def steady_speed(
    frame: Airframe, volts: Array, warm_k: Array | float = 0.0, drag: Array | float = 1.0
) -> Array:
    """Rotor speed [rad/s] at which motor and air (hover inflow, torque ~ Omega^2) agree."""
    k = motor_constant(frame) * (1.0 + MAGNET * np.asarray(warm_k))
    ohm = frame.motor_ohm * (1.0 + COPPER * np.asarray(warm_k))
    c = drag * frame.hover_torque / frame.hover_speed**2 * ohm / k
    return (-k + np.sqrt(k * k + 4.0 * c * np.maximum(volts, 0.0))) / (2.0 * c)


def steady_thrust(
    frame: Airframe, duty: Array, pack_v: Array, warm_k: Array | float = 0.0
) -> Array:
    """Free-air hover thrust [N] that an output ends in."""
    return (
        frame.hover_thrust * (steady_speed(frame, duty * pack_v, warm_k) / frame.hover_speed) ** 2
    )


@lru_cache
def calibrated(frame: Airframe) -> ThrottleCurve:
    """The curve that a thrust stand at the nominal voltage would give: least squares over 25...80 % output."""
    u = np.linspace(0.25, 0.80, 40)
    basis = np.stack([u, u * u], axis=1)
    a, b = np.linalg.lstsq(
        basis, steady_thrust(frame, u, np.full(40, frame.nominal_v)), rcond=None
    )[0]
    return ThrottleCurve(float(a + b), float(b / (a + b)))


def bent(frame: Airframe, slope: float) -> ThrottleCurve:
    """The calibrated curve through the same hover thrust, with its slope there off by the share ``slope``."""
    true = calibrated(frame)
    u = float(true.output(np.array(frame.hover_thrust)))
    wanted = true.max_n * ((1.0 - true.expo) + 2.0 * true.expo * u) * (1.0 + slope)
    a, b = np.linalg.solve([[u, u * u], [1.0, 2.0 * u]], [frame.hover_thrust, wanted])
    return ThrottleCurve(float(a + b), float(b / (a + b)))


@dataclass
class Pack:
    """Batteries of several flights, arrays (n,)."""

    cells: int
    capacity_as: Array
    ohm: Array
    charge: Array
    branch_v: Array

    def volts(self, current: Array) -> Array:
        """Terminal voltage [V]."""
        return (
            self.cells * np.interp(self.charge, CHARGE, CELL_V) - self.ohm * current - self.branch_v
        )

    def draw(self, current: Array, dt: float) -> None:
        """Take ``current`` [A] for ``dt`` [s]."""
        one_hour = self.capacity_as / 3600.0
        self.charge = self.charge - dt * current / self.capacity_as * np.maximum(
            current / one_hour, 0.05
        ) ** (PEUKERT - 1)
        self.branch_v = self.branch_v + dt / 12.0 * (0.6 * self.ohm * current - self.branch_v)


def hover_current(frame: Airframe) -> float:
    """Battery current in hover [A]."""
    one = motor_current(
        frame, np.array(frame.hover_duty * frame.nominal_v), np.array(frame.hover_speed), 0.0
    )
    return float(frame.count * one * frame.hover_duty)
