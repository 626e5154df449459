"""The simulated vehicles and the files that declare them. SI units, body FRD about the declared CG."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G = 9.80665
RHO0 = 1.225
NOMINAL_CELL_V = 3.85


@dataclass(frozen=True)
class Beam:
    """One rangefinder: MAVLink orientation, unit vector and place (body FRD), what it is declared to look at."""

    orientation: int
    axis: tuple[float, float, float]
    position_m: tuple[float, float, float]
    target: str


DOWN = Beam(25, (0.0, 0.0, 1.0), (0.02, 0.0, 0.04), "ground")
FRONT = Beam(0, (1.0, 0.0, 0.0), (0.06, 0.0, 0.0), "wall")
RIGHT = Beam(2, (0.0, 1.0, 0.0), (0.0, 0.06, 0.0), "wall")
UP = Beam(24, (0.0, 0.0, -1.0), (0.0, 0.0, -0.05), "ceiling")


@dataclass(frozen=True)
class Airframe:
    """One multirotor with single open or guarded rotors."""

    name: str
    mass_kg: float
    inertia: tuple[float, float, float]
    radius_m: float
    lip_m: float
    arms: tuple[tuple[float, float, float], ...]
    spin: tuple[int, ...]
    """+1 turns clockwise seen from above."""
    hover_rpm: float
    solidity_slope: float
    """Solidity times lift-curve slope, sigma a."""
    figure_of_merit: float
    cells: int
    motor_ohm: float
    rotor_inertia: float
    """Of propeller and bell [kg m^2]."""
    hover_duty: float
    """Share of the nominal voltage that hover takes."""
    declares: str
    """``esc`` (rotor speeds are telemetered) or ``servo`` (thrust from outputs)."""
    table: bool
    """Declared by a surrogate of ground and wall instead of free air only."""
    autopilot: int
    """MAV_AUTOPILOT: 3 ArduPilot, 12 PX4."""
    home_m: float

    @property
    def count(self) -> int:
        """Number of rotors."""
        return len(self.spin)

    @property
    def area(self) -> float:
        """Disc area [m^2]."""
        return math.pi * self.radius_m**2

    @property
    def hover_thrust(self) -> float:
        """Of one rotor [N]."""
        return self.mass_kg * G / self.count

    @property
    def hover_speed(self) -> float:
        """Rotor speed in hover [rad/s]."""
        return self.hover_rpm * math.pi / 30.0

    @property
    def ct(self) -> float:
        """T/(rho A Omega^2 R^2) in free-air hover."""
        return self.hover_thrust / (RHO0 * self.area * (self.hover_speed * self.radius_m) ** 2)

    @property
    def hover_inflow(self) -> float:
        """Induced velocity of hover [m/s], momentum theory."""
        return math.sqrt(self.hover_thrust / (2.0 * RHO0 * self.area))

    @property
    def hover_torque(self) -> float:
        """Of one rotor in hover [N m]: ideal induced power over the figure of merit."""
        return self.hover_thrust * self.hover_inflow / self.figure_of_merit / self.hover_speed

    @property
    def cq(self) -> float:
        """Q/(rho A Omega^2 R^3) in free-air hover."""
        return self.hover_torque / (RHO0 * self.area * self.hover_speed**2 * self.radius_m**3)

    @property
    def nominal_v(self) -> float:
        """Pack voltage at which the outputs are calibrated."""
        return NOMINAL_CELL_V * self.cells

    @property
    def arm_m(self) -> float:
        """Horizontal distance of a rotor from the CG."""
        return float(np.mean([math.hypot(x, y) for x, y, _ in self.arms]))


def _x(reach: float, up: float) -> tuple[tuple[float, float, float], ...]:
    a = reach / math.sqrt(2.0)
    return ((a, a, -up), (-a, -a, -up), (a, -a, -up), (-a, a, -up))


def _hexagon(reach: float, up: float) -> tuple[tuple[float, float, float], ...]:
    angles = np.radians([90.0, -90.0, -30.0, 150.0, 30.0, -150.0])
    return tuple((float(reach * np.cos(b)), float(reach * np.sin(b)), -up) for b in angles)


RACER = Airframe(
    "racer 250", 0.62, (0.0026, 0.0029, 0.0047), 0.0635, 0.0635, _x(0.125, 0.015), (-1, -1, 1, 1), 13500.0, 0.85, 0.58,
    4, 0.25, 5.5e-6, 0.47, "servo", False, 12, 1.25,
)  # fmt: skip
LIFTER = Airframe(
    "lifter 3 kg", 3.0, (0.052, 0.060, 0.101), 0.165, 0.165, _x(0.30, 0.04), (-1, -1, 1, 1), 4650.0, 0.50, 0.64,
    6, 0.09, 1.3e-4, 0.50, "esc", False, 3, 1.9,
)  # fmt: skip
HEXA = Airframe(
    "hexarotor 6 kg", 6.2, (0.19, 0.20, 0.35), 0.19, 0.19, _hexagon(0.43, 0.05), (1, -1, 1, -1, -1, 1), 4100.0, 0.48,
    0.66, 6, 0.07, 2.4e-4, 0.50, "esc", False, 3, 2.2,
)  # fmt: skip
GUARDED = Airframe(
    "guarded inspection quad", 2.4, (0.031, 0.034, 0.058), 0.128, 0.150, _x(0.235, 0.03), (-1, -1, 1, 1), 5900.0, 0.55,
    0.62, 4, 0.08, 6.0e-5, 0.50, "esc", True, 3, 1.3,
)  # fmt: skip
AIRFRAMES = {"racer": RACER, "lifter": LIFTER, "hexa": HEXA, "guarded": GUARDED}


@dataclass(frozen=True)
class ThrottleCurve:
    """Thrust of a rotor over its output, as a vehicle file declares it: max ((1 - expo) u + expo u^2)."""

    max_n: float
    expo: float

    def thrust(self, u: Array) -> Array:
        """[N] at output share ``u``."""
        return self.max_n * ((1.0 - self.expo) * u + self.expo * u * u)

    def output(self, thrust: Array) -> Array:
        """Output share that gives ``thrust`` [N], limited to 0.05...1."""
        y = np.maximum(thrust, 0.0) / self.max_n
        if abs(self.expo) < 1e-6:
            return np.clip(y, 0.05, 1.0)
        b = 1.0 - self.expo
        return np.clip((-b + np.sqrt(b * b + 4.0 * self.expo * y)) / (2.0 * self.expo), 0.05, 1.0)


def vehicle_toml(frame: Airframe, curve: ThrottleCurve, beams: tuple[Beam, ...]) -> str:
    """The vehicle file of the contract, section 3."""
    lines = [
        f'name = "{frame.name}"', f"mass_kg = {frame.mass_kg:g}", f"inertia_kgm2 = {list(frame.inertia)}",
        f"hover_thrust = {float(curve.output(np.array(frame.hover_thrust))):.3f}",
        f"rotor_radius_m = {frame.radius_m:g}",
    ]  # fmt: skip
    for k, (arm, spin) in enumerate(zip(frame.arms, frame.spin, strict=True), 1):
        lines += [
            "",
            "[[fan]]",
            f"position_m = {[round(c, 5) for c in arm]}",
            f"lip_radius_m = {frame.lip_m:g}",
        ]
        lines += [f"ct = {frame.ct:.6g}", f"cq = {frame.cq:.6g}"]
        lines.append(
            f'rotors = [{{ {frame.declares} = {k}, spin = "{"cw" if spin > 0 else "ccw"}" }}]'
        )
    if frame.declares == "servo":
        lines += [
            "", "[throttle]", f"max_thrust_n = {curve.max_n:.5g}", f"expo = {curve.expo:.4g}", "pwm_min_us = 1000.0",
            "pwm_max_us = 2000.0", f"voltage_v = {frame.nominal_v:g}",
        ]  # fmt: skip
    for beam in beams:
        lines += [
            "",
            "[[rangefinder]]",
            f"orientation = {beam.orientation}",
            f'target = "{beam.target}"',
        ]
        lines.append(f"position_m = {list(beam.position_m)}")
    return "\n".join([*lines, ""])
