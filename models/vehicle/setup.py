"""From answers to a checked vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from models.vehicle import Fan, Rangefinder, Rotor, Throttle, Vehicle
from models.vehicle.estimate import (
    OPEN_ROTOR_CT,
    inertia,
    max_thrust,
    pwm_range,
    throttle_output,
)
from models.vehicle.motor_layouts import Motor
from models.vehicle.plausibility import target_of

COMMON_PROPELLERS = "0.4 to 0.9 for common propellers"
USUAL_PULSES = "usual pulses, from 1000 us"
_LOOKS_DOWN = 25


@dataclass(frozen=True, kw_only=True)
class Answers:
    """What logs, their parameters and a person say of a vehicle."""

    name: str
    mass_kg: float
    propeller_m: float
    """Diameter."""
    motors: tuple[Motor, ...]
    arm_m: float
    """Centre to motor axis."""
    numbers: Mapping[int, int]
    """Motor number to ESC or output."""
    port: int = 0
    """SERVO_OUTPUT_RAW.port of the outputs."""
    group: str = ""
    """PX4's driver of the outputs: ``MAIN``, ``AUX``, ``CAN``."""
    telemetered: bool = True
    voltage_v: float = 0.0
    """Of the battery in hover."""
    ranges: tuple[Rangefinder, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)


def build(a: Answers) -> tuple[Vehicle, dict[str, str]]:
    """The vehicle, and by key where its numbers came from."""
    said = {"position_m": f"from the CG, forward right down; motor {a.motors[0].number}"}
    hover, said["hover_thrust"] = _hover(a)
    said["rotor_radius_m"] = "half the propeller's diameter"
    said["lip_radius_m"] = "open rotor: the rotor's radius"
    said["inertia_kgm2"] = "estimated from mass and arm, +-30 %; only moments need it"
    if a.telemetered:
        said["ct"] = "a guess, +-30 %"
    vehicle = Vehicle(
        name=a.name,
        mass_kg=a.mass_kg,
        inertia_kgm2=inertia(a.mass_kg, a.arm_m, a.motors),
        hover_thrust=hover,
        rotor_radius_m=a.propeller_m / 2.0,
        fans=tuple(_fan(a, motors) for motors in places(a.motors)),
        throttle=None if a.telemetered else _throttle(a, hover, said),
        rangefinders=a.ranges,
    )
    said["rotors"] = "esc counts from 1 as in the telemetry; spin seen from above"
    return vehicle, said


def _hover(a: Answers) -> tuple[float, str]:
    for name in ("MOT_THST_HOVER", "MPC_THR_HOVER"):
        if 0.05 < a.parameters.get(name, 0.0) < 0.95:
            return round(a.parameters[name], 3), name
    return 0.5, "a guess"


def _throttle(a: Answers, hover: float, said: dict[str, str]) -> Throttle:
    expo, output = throttle_output(a.parameters, hover)
    low, high, pwm = pwm_range(a.parameters, min(a.numbers.values()), a.group)
    said["pwm_max_us"] = pwm or USUAL_PULSES
    said["max_thrust_n"] = "of one rotor, so that hover_thrust hovers"
    said["expo"] = next(
        (n for n in ("MOT_THST_EXPO", "THR_MDL_FAC") if a.parameters.get(n)), COMMON_PROPELLERS
    )
    said["voltage_v"] = "of the battery in hover"
    return Throttle(
        max_thrust_n=max_thrust(a.mass_kg, len(a.motors), expo, output),
        expo=expo,
        pwm_min_us=low,
        pwm_max_us=high,
        voltage_v=a.voltage_v,
        port=a.port,
    )


def places(motors: tuple[Motor, ...]) -> list[list[Motor]]:
    """Motors by place: two in one place are a coaxial fan."""
    out: dict[tuple[float, float], list[Motor]] = {}
    for motor in motors:
        out.setdefault((round(motor.forward, 6), round(motor.right, 6)), []).append(motor)
    return list(out.values())


def _fan(a: Answers, motors: list[Motor]) -> Fan:
    """An open fan of the motors in one place."""
    x, y, z = (
        round(v * a.arm_m, 4)
        for v in (motors[0].forward, motors[0].right, min(m.down for m in motors))
    )
    if a.telemetered:
        key = "esc"
    else:
        key = "servo"
    rotors = tuple(Rotor(m.spin, **{key: a.numbers[m.number]}) for m in motors)
    return Fan(
        (x, y, z),
        a.propeller_m / 2.0,
        rotors,
        OPEN_ROTOR_CT * len(motors) if a.telemetered else None,
    )


def parameter_ranges(parameters: Mapping[str, float]) -> tuple[Rangefinder, ...]:
    """Rangefinders that ArduPilot's RNGFNDn_TYPE, _ORIENT and _POS_X, Y, Z name."""
    out = []
    for k in (*map(str, range(1, 10)), "A"):
        if parameters.get(f"RNGFND{k}_TYPE", 0.0) > 0.0:
            orientation = int(parameters.get(f"RNGFND{k}_ORIENT", _LOOKS_DOWN))
            place = (parameters.get(f"RNGFND{k}_POS_{axis}", 0.0) for axis in "XYZ")
            x, y, z = (float(p) if math.isfinite(p) else 0.0 for p in place)
            out.append(Rangefinder(orientation, target_of(orientation), (x, y, z)))
    return tuple(out)
