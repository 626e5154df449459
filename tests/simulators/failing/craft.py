"""Vehicles drawn at random: sizes of real multirotors of 0.8 to 6 kg, with their vehicle files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G = 9.80665
CCW = -1
CW = 1

# Angle clockwise from the nose [deg] and sense of turning, by motor number, as ArduPilot counts.
_RINGS: dict[str, tuple[tuple[float, int], ...]] = {
    "quad-x": ((45, CCW), (-135, CCW), (-45, CW), (135, CW)),
    "hexa-x": ((90, CW), (-90, CCW), (-30, CW), (150, CCW), (30, CCW), (-150, CW)),
    "octo-x": (
        (22.5, CW),
        (-157.5, CW),
        (67.5, CCW),
        (157.5, CCW),
        (-22.5, CCW),
        (-112.5, CCW),
        (-67.5, CW),
        (112.5, CW),
    ),
}
FRAMES = tuple(_RINGS)
FRAME_CLASS = {"quad-x": 1, "hexa-x": 2, "octo-x": 3}
"""FRAME_CLASS of ArduPilot; FRAME_TYPE is 1 (X)."""
MAV_TYPE = {"quad-x": 2, "hexa-x": 13, "octo-x": 14}


@dataclass(frozen=True, kw_only=True)
class Craft:
    """One vehicle: SI units, body FRD about its CG; thrust at full command and at ``volts``."""

    frame: str
    mass_kg: float
    arm_m: float
    inertia: tuple[float, float, float]
    rotor_radius_m: float
    max_thrust_n: float
    torque_m: float
    """Torque over thrust of a rotor."""
    expo: float
    motor_tau_s: float
    volts: float
    top_speed_rad_s: float
    inflow: float
    """Share of the thrust that axial speed over tip speed takes."""
    drag_per_s: float
    rotors_above_m: float

    @property
    def count(self) -> int:
        """Motors."""
        return len(_RINGS[self.frame])

    @property
    def places(self) -> Array:
        """Rotor hubs from the CG [m], (motors, 3)."""
        angles = np.radians([angle for angle, _ in _RINGS[self.frame]])
        above = np.full(self.count, -self.rotors_above_m)
        return np.stack([self.arm_m * np.cos(angles), self.arm_m * np.sin(angles), above], axis=1)

    @property
    def spins(self) -> Array:
        """+1 clockwise from above, (motors,)."""
        return np.array([float(spin) for _, spin in _RINGS[self.frame]])


def draw(frame: str, rng: np.random.Generator) -> Craft:
    """A vehicle of that frame."""
    count = len(_RINGS[frame])
    mass = float(np.exp(rng.uniform(np.log(0.8), np.log(6.0))))
    arm = 0.2 * (mass / 1.5) ** 0.4 * rng.uniform(0.85, 1.2)
    gap = 2.0 * arm * np.sin(np.pi / count)
    radius = 0.47 * gap * rng.uniform(0.8, 0.98)
    inertia = rng.uniform(0.18, 0.32) * mass * arm**2
    lift = rng.uniform(1.8, 2.7)
    tip_m_s = rng.uniform(120.0, 180.0)
    return Craft(
        frame=frame,
        mass_kg=mass,
        arm_m=float(arm),
        inertia=(inertia, inertia * rng.uniform(0.95, 1.25), inertia * rng.uniform(1.6, 1.9)),
        rotor_radius_m=float(radius),
        max_thrust_n=lift * mass * G / count,
        torque_m=float(rng.uniform(0.11, 0.16) * radius),
        expo=float(rng.uniform(0.5, 0.75)),
        motor_tau_s=float(rng.uniform(0.02, 0.06)),
        volts=float(rng.choice([11.1, 14.8, 22.2])),
        top_speed_rad_s=tip_m_s / float(radius),
        inflow=float(rng.uniform(3.0, 6.0)),
        drag_per_s=float(rng.uniform(0.12, 0.3)),
        rotors_above_m=float(rng.uniform(0.0, 0.06)),
    )


def vehicle_toml(craft: Craft, rng: np.random.Generator, *, speeds: bool) -> str:
    """A vehicle file as people write it: mass within 3 %, inertia within 30 %."""
    inertia = np.array(craft.inertia) * rng.uniform(0.75, 1.3, 3)
    inertia[2] = min(inertia[2], 0.98 * (inertia[0] + inertia[1]))
    lines = [
        f'name = "failing {craft.frame}"',
        f"mass_kg = {craft.mass_kg * rng.uniform(0.97, 1.03):.5g}",
        f"inertia_kgm2 = [{', '.join(f'{v:.4g}' for v in inertia)}]",
        "hover_thrust = 0.45",
        f"rotor_radius_m = {craft.rotor_radius_m:.4g}",
    ]
    area = np.pi * craft.rotor_radius_m**2
    tip = craft.top_speed_rad_s * craft.rotor_radius_m
    ct = craft.max_thrust_n / (1.225 * area * tip**2)
    for k, place in enumerate(craft.places):
        spin = "cw" if craft.spins[k] > 0.0 else "ccw"
        channel = "esc" if speeds else "servo"
        lines += [
            "",
            "[[fan]]",
            f"position_m = [{', '.join(f'{v:.5g}' for v in place)}]",
            f"lip_radius_m = {craft.rotor_radius_m:.4g}",
            f'rotors = [{{ {channel} = {k + 1}, spin = "{spin}" }}]',
        ]
        if speeds:
            lines.append(f"ct = {ct:.5g}")
            lines.append(f"cq = {ct * craft.torque_m / craft.rotor_radius_m:.5g}")
    if not speeds:
        lines += [
            "",
            "[throttle]",
            f"max_thrust_n = {craft.max_thrust_n * rng.uniform(0.97, 1.03):.5g}",
            f"expo = {np.clip(craft.expo + rng.uniform(-0.1, 0.1), 0.0, 1.0):.3g}",
            "pwm_min_us = 1000",
            "pwm_max_us = 2000",
            f"voltage_v = {craft.volts:g}",
        ]
    lines += ["", "[limits]", "thrust = 0.10", "tilt_deg = 8.0"]
    lines += ["slew_thrust_per_s = 0.5", "slew_tilt_deg_per_s = 60.0", ""]
    return "\n".join(lines)
