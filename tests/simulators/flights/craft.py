"""The two simulated vehicles and the vehicle files that declare them (SI units, body FRD about the declared CG)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.80665
RHO0 = 1.225


@dataclass(frozen=True)
class Craft:
    """One vehicle. ``fans`` are lifting units; each has ``rotors_per_fan`` rotors that turn alike."""

    name: str
    mass_kg: float
    inertia: tuple[float, float, float]
    radius_m: float
    lip_m: float
    fan_position: tuple[tuple[float, float, float], ...]
    rotors_per_fan: int
    spin: tuple[int, ...]  # of each rotor, +1 clockwise from above
    hover_rpm: float
    cq: float  # torque coefficient of a fan that the vehicle file declares; 0 where none
    vane_position: tuple[tuple[float, float, float], ...]
    vane_gain: float  # side force / (lift x deflection)
    max_rotor_thrust_n: float
    voltage_v: float
    down_ranger_m: float  # below the CG
    side_ranger_m: float  # to the right of the CG
    reynolds: float  # C_T ~ rpm^reynolds

    @property
    def area(self) -> float:
        """Area of one disc [m^2]."""
        return float(np.pi * self.radius_m**2)

    @property
    def hover_fan_thrust(self) -> float:
        """Thrust of one fan in hover [N]."""
        return self.mass_kg * GRAVITY / len(self.fan_position)

    @property
    def ct(self) -> float:
        """Free-air thrust coefficient of a fan, T/(rho A Omega^2 R^2)."""
        tip = self.hover_rpm * np.pi / 30.0 * self.radius_m
        return float(self.hover_fan_thrust / (RHO0 * self.area * tip**2))


TANDEM = Craft(
    name="tandem",
    mass_kg=4.6,
    inertia=(0.092, 0.283, 0.245),
    radius_m=0.165,
    lip_m=0.21,
    fan_position=((0.32, 0.0, 0.0), (-0.32, 0.0, 0.0)),
    rotors_per_fan=2,
    spin=(1, -1, 1, -1),
    hover_rpm=4000.0,
    cq=0.0,
    vane_position=((0.32, 0.0, 0.15), (-0.32, 0.0, 0.15)),
    vane_gain=0.5,
    max_rotor_thrust_n=18.0,
    voltage_v=24.0,
    down_ranger_m=0.05,
    side_ranger_m=0.21,
    reynolds=0.03,
)

QUAD = Craft(
    name="quad",
    mass_kg=2.8,
    inertia=(0.055, 0.061, 0.098),
    radius_m=0.14,
    lip_m=0.14,
    fan_position=(
        (0.22, 0.22, -0.05),
        (-0.22, -0.22, -0.05),
        (0.22, -0.22, -0.05),
        (-0.22, 0.22, -0.05),
    ),
    rotors_per_fan=1,
    spin=(-1, -1, 1, 1),
    hover_rpm=5600.0,
    cq=0.0016,
    vane_position=(),
    vane_gain=0.0,
    max_rotor_thrust_n=15.0,
    voltage_v=16.0,
    down_ranger_m=0.05,
    side_ranger_m=0.10,
    reynolds=0.0,
)

EXPO = 0.65
PWM_MIN, PWM_MAX = 1000.0, 2000.0
VANE_NEUTRAL, VANE_RAD_PER_US = 1500.0, 0.001


@dataclass(frozen=True)
class Ranger:
    """One declared rangefinder: wire orientation, what it looks at, where it sits."""

    orientation: int
    target: str
    position_m: tuple[float, float, float]


def rangers(craft: Craft, *, ceiling: bool, front: bool) -> tuple[Ranger, ...]:
    """The rangefinders of a flight: down and right always, up where there is a ceiling, forward for a second wall."""
    out = [
        Ranger(25, "ground", (0.0, 0.0, craft.down_ranger_m)),
        Ranger(2, "wall", (0.0, craft.side_ranger_m, 0.0)),
    ]
    if ceiling:
        out.append(Ranger(24, "ceiling", (0.0, 0.0, -0.06)))
    if front:
        out.append(Ranger(0, "wall", (0.0, 0.0, 0.0)))
    return tuple(out)


def vehicle_toml(
    craft: Craft, sensors: tuple[Ranger, ...], *, by_servo: bool, mass_factor: float = 1.0
) -> str:
    """The vehicle file of the contract, section 3. ``mass_factor`` other than 1 declares a wrong mass."""
    lines = [
        f'name = "{craft.name}"',
        f"mass_kg = {craft.mass_kg * mass_factor:.6g}",
        f"inertia_kgm2 = [{', '.join(f'{v:g}' for v in craft.inertia)}]",
        "hover_thrust = 0.50",
        f"rotor_radius_m = {craft.radius_m:g}",
    ]
    per = craft.rotors_per_fan
    channel = "servo" if by_servo else "esc"
    for i, position in enumerate(craft.fan_position):
        rotors = ", ".join(
            f'{{ {channel} = {k + 1}, spin = "{"cw" if craft.spin[k] > 0 else "ccw"}" }}'
            for k in range(i * per, (i + 1) * per)
        )
        lines += [
            "",
            "[[fan]]",
            f"position_m = {list(position)}",
            f"lip_radius_m = {craft.lip_m:g}",
        ]
        if craft.cq:
            lines += [f"ct = {craft.ct:.6g}", f"cq = {craft.cq:g}"]
        lines.append(f"rotors = [{rotors}]")
    for i, position in enumerate(craft.vane_position):
        lines += [
            "", "[[vane]]", f"servo = {5 + i}", f"fan = {i + 1}", f"position_m = {list(position)}",
            "axis = [0.0, 1.0, 0.0]", f"force_per_thrust_rad = {craft.vane_gain:g}",
            f"neutral_us = {VANE_NEUTRAL:g}", f"rad_per_us = {VANE_RAD_PER_US:g}",
        ]  # fmt: skip
    if by_servo:
        lines += [
            "", "[throttle]", f"max_thrust_n = {craft.max_rotor_thrust_n:g}", f"expo = {EXPO:g}",
            f"pwm_min_us = {PWM_MIN:g}", f"pwm_max_us = {PWM_MAX:g}", f"voltage_v = {craft.voltage_v:g}",
        ]  # fmt: skip
    for sensor in sensors:
        lines += [
            "", "[[rangefinder]]", f"orientation = {sensor.orientation}", f'target = "{sensor.target}"',
            f"position_m = {list(sensor.position_m)}",
        ]  # fmt: skip
    lines += [
        "", "[limits]", "thrust = 0.10", "tilt_deg = 8.0", "slew_thrust_per_s = 0.5", "slew_tilt_deg_per_s = 60.0", "",
    ]  # fmt: skip
    return "\n".join(lines)
