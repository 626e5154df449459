"""First numbers for what nobody has measured: inertia, thrust at hover, rotor coefficient, and typical sizes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from models.common.frames import GRAVITY, Array
from models.vehicle import RHO_SEA_LEVEL, Vector3
from models.vehicle.motor_layouts import Motor
from models.vehicle.motor_outputs import AUX, CAN, MAIN

OPEN_ROTOR_CT = 0.0130
"""C_T = T/(rho A Omega^2 R^2) of an open two-blade propeller in hover; 0.010 to 0.017 were measured on propellers of
drones (static data of Brandt and Selig 2011 in these units)."""
EXPO = 0.65
"""Thrust over throttle of an ESC with a common propeller: ArduPilot's default of MOT_THST_EXPO."""
_ARDUPILOT_DSHOT = range(4, 8)
"""MOT_PWM_TYPE of DShot 150 to 1200, which ArduPilot logs as pulses of 1000 to 2000 us."""
_PX4_DSHOT = range(-5, -1)
"""PWM_MAIN_TIMn and PWM_AUX_TIMn of DShot 150 to 1200."""
_DSHOT_FULL = 1999.0
_CAN_FULL = 8191.0
"""Full throttle of the outputs that PX4 logs for DShot and for CAN."""
_TIMERS = 16
_RC = ("RC3_MIN", "RC3_MAX")
_AT_ROTORS = 0.35
"""Share of the mass that sits at the arms' ends: motors, propellers, ESCs and the outer halves of the arms."""
_BODY_RADIUS = 0.40
"""Of the rest, a flat disc of this share of the arm's length, and ``_BODY_HEIGHT`` high."""
_BODY_HEIGHT = 0.30

_DISC_LOADING = 70.0
"""Weight over disc area [N/m^2]: Crazyflie 40, camera quadrotors 50 to 100."""
_SPACING = 1.25
"""Distance of neighbouring rotors over their diameter: 1.05 to 1.6."""
_RADIUS_M = 0.127
"""A propeller of ten inches."""


def inertia(mass_kg: float, arm_m: float, motors: Sequence[Motor]) -> Vector3:
    """Ixx, Iyy, Izz [kg m^2]: points at the rotors and a flat disc in the middle. Right to about 30 %.

    Moments of inertia only matter for moments; forces do not need them.
    """
    point = _AT_ROTORS * mass_kg / len(motors)
    body = (1.0 - _AT_ROTORS) * mass_kg
    radius = _BODY_RADIUS * arm_m
    height = _BODY_HEIGHT * arm_m
    side = body * (radius**2 / 4.0 + height**2 / 12.0)
    xx = side + point * sum((m.right * arm_m) ** 2 for m in motors)
    yy = side + point * sum((m.forward * arm_m) ** 2 for m in motors)
    zz = body * radius**2 / 2.0 + point * sum(
        (m.right**2 + m.forward**2) * arm_m**2 for m in motors
    )
    return (_round(xx), _round(yy), _round(zz))


def throttle_output(parameters: Mapping[str, float], hover: float) -> tuple[float, float]:
    """(expo, output 0...1 at hover) of the curve between output and thrust, by the autopilot's own parameters.

    ArduPilot linearises: thrust command = e x^2 + (1 - e) x, output = SPIN_MIN + (SPIN_MAX - SPIN_MIN) x. PX4:
    THR_MDL_FAC in the place of e, from 0; at 0 it commands the output itself, and a common propeller is assumed.
    """
    if "MOT_THST_EXPO" in parameters:
        expo = min(max(parameters["MOT_THST_EXPO"], 0.0), 1.0)
        low = parameters.get("MOT_SPIN_MIN", 0.15)
        high = parameters.get("MOT_SPIN_MAX", 0.95)
        return expo, low + (high - low) * _inverse(expo, hover)
    factor = parameters.get("THR_MDL_FAC", 0.0)
    if factor > 0.0:
        return (factor, _inverse(factor, hover))
    return (EXPO, hover)


def _inverse(expo: float, thrust: float) -> float:
    return float(thrust_to_output(np.asarray(thrust), expo))


def thrust_to_output(thrust: Array, expo: float) -> Array:
    """Output x of expo x^2 + (1 - expo) x = thrust, both 0...1, elementwise (PX4's THR_MDL_FAC as ``expo``)."""
    if expo < 1e-3:
        return thrust
    root = np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * thrust)
    return np.asarray((root - (1.0 - expo)) / (2.0 * expo))


def max_thrust(mass_kg: float, rotors: int, expo: float, output: float) -> float:
    """Thrust [N] of one rotor at full output, where ``output`` carries the vehicle."""
    return _round(mass_kg * GRAVITY / rotors / ((1.0 - expo) * output + expo * output**2))


def pwm_range(
    parameters: Mapping[str, float], output: int = 1, group: str = ""
) -> tuple[float, float, str]:
    """Outputs at zero and at full thrust, and the parameter that says the latter (empty: none does).

    MOT_PWM_MIN and MAX (0: RC3_MIN and MAX) of ArduPilot, whose DShot is logged as 1000 to 2000. On PX4 by ``group``:
    PWM_MAIN_MINn and MAXn of an ``output`` with a motor, 0 to 1999 where a timer is set to DShot, 0 to 8191 on CAN.
    """
    if int(parameters.get("MOT_PWM_TYPE", 0)) in _ARDUPILOT_DSHOT:
        return 1000.0, 2000.0, "MOT_PWM_TYPE"
    if group == CAN:
        return 0.0, _CAN_FULL, f"UAVCAN_EC_FUNC{output}"
    sides = [side for side in (MAIN, AUX) if group in ("", side)]
    digital = _px4_dshot(parameters, sides)
    if digital:
        return 0.0, _DSHOT_FULL, digital
    px4 = [(f"PWM_{side}_MIN{output}", f"PWM_{side}_MAX{output}") for side in sides]
    for low, high in (("MOT_PWM_MIN", "MOT_PWM_MAX"), *px4, _RC):
        if parameters.get(high, 0.0) > parameters.get(low, 0.0) > 0.0:
            return float(parameters[low]), float(parameters[high]), high
    return 1000.0, 2000.0, ""


def _px4_dshot(parameters: Mapping[str, float], sides: Sequence[str]) -> str:
    """The parameter of PX4 that sets outputs to DShot; empty where none does."""
    if parameters.get("DSHOT_CONFIG", 0.0) > 0.0:
        return "DSHOT_CONFIG"
    for side in sides:
        for timer in range(_TIMERS):
            name = f"PWM_{side}_TIM{timer}"
            if int(parameters.get(name, 0)) in _PX4_DSHOT:
                return name
    return ""


def _round(value: float) -> float:
    return float(f"{value:.4g}")


@dataclass(frozen=True)
class Guess:
    """A number that was given, or is typical: then ``low`` and ``high`` are the range in which most vehicles lie."""

    value: float
    source: str = ""
    low: float = math.nan
    high: float = math.nan

    @property
    def assumed(self) -> bool:
        """Whether nobody gave it."""
        return math.isfinite(self.low)

    @property
    def spread(self) -> float:
        """Factor between ``value`` and ``high``; 1 where it was given."""
        if self.assumed:
            return self.high / self.value
        return 1.0


def typical_sizes(
    mass_kg: float | None,
    radius_m: float | None,
    arm_m: float | None,
    motors: Sequence[Motor],
    hover_rpm: float | None,
) -> dict[str, Guess]:
    """Mass, rotor radius R and arm by their keys in a vehicle file; what is None follows from the others.

    W = n C_T rho pi R^4 Omega^2 where the rotor speed Omega in hover is known, else W = (disc loading) pi R^2 per
    place; neighbouring places are ``_SPACING`` diameters apart.
    """
    places = {(m.forward, m.right) for m in motors}
    apart = min((math.dist(a, b) for a, b in combinations(places, 2)), default=1.0)
    per_r2 = _DISC_LOADING * math.pi * len(places)
    omega = (hover_rpm or 0.0) * 2.0 * math.pi / 60.0
    per_r4 = len(motors) * OPEN_ROTOR_CT * RHO_SEA_LEVEL * math.pi * omega**2
    if mass_kg is None:
        weight = None
    else:
        weight = mass_kg * GRAVITY
    if radius_m is not None:
        radius = Guess(radius_m)
    elif weight is not None and per_r4:
        radius = _typical((weight / per_r4) ** 0.25, 1.1, "typical for mass and rotor speed")
    elif arm_m is not None:
        radius = _typical(arm_m * apart / (2.0 * _SPACING), 1.25, "typical for rotors so far apart")
    elif weight is not None:
        radius = _typical(math.sqrt(weight / per_r2), 1.4, "typical for the mass")
    elif per_r4:
        radius = _typical(math.sqrt(per_r2 / per_r4), 1.4, "typical for this rotor speed")
    else:
        radius = _typical(_RADIUS_M, 2.0, "ten inches")
    if mass_kg is not None:
        mass = Guess(mass_kg)
    elif per_r4:
        mass = _typical(
            per_r4 * radius.value**4 / GRAVITY,
            1.3 * radius.spread**4,
            "typical for this rotor speed",
        )
    else:
        mass = _typical(
            per_r2 * radius.value**2 / GRAVITY, 2.0 * radius.spread**2, "typical for these rotors"
        )
    arm = Guess(arm_m or 0.0)
    if arm_m is None:
        arm = _typical(
            2.0 * radius.value * _SPACING / apart, 1.4 * radius.spread, "typical for these rotors"
        )
    return {"mass_kg": mass, "rotor_radius_m": radius, "position_m": arm}


def _typical(value: float, factor: float, source: str) -> Guess:
    return Guess(_round(value), source, value / factor, value * factor)
