"""From answers to a checked vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from models.vehicle import Fan, Limits, Rangefinder, Rotor, Throttle, Vehicle
from models.vehicle_plausibility import direction
from models.vehicle_setup.estimate import (
    OPEN_ROTOR_CT,
    inertia,
    max_thrust,
    pwm_range,
    throttle_output,
)
from models.vehicle_setup.frames import Motor, outputs

COMMON_PROPELLERS, USUAL_PULSES = "0.4 to 0.9 for common propellers", "usual pulses, from 1000 us"
_LOOKS_DOWN = 25
_SEEN = {"down": "ground", "up": "ceiling", "to the side": "wall"}


@dataclass(frozen=True)
class Answers:
    """What a person or a parameter file says."""

    name: str
    mass_kg: float
    propeller_m: float
    """Diameter."""
    motors: tuple[Motor, ...]
    arm_m: float
    """Centre to motor axis."""
    numbers: Mapping[int, int] = field(default_factory=dict)
    """Motor number to ESC or output; empty: by the parameters."""
    telemetered: bool = True
    voltage_v: float = 0.0
    """Of the battery in hover."""
    ranges: tuple[Rangefinder, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)


def build(a: Answers) -> tuple[Vehicle, dict[str, str]]:
    """The vehicle, and by key where its numbers came from."""
    motors, arm = a.motors, a.arm_m
    said = {"position_m": f"from the CG, forward right down; motor {motors[0].number}"}
    hover, said["hover_thrust"] = _hover(a)
    radius = a.propeller_m / 2.0
    said["rotor_radius_m"] = "half the propeller's diameter"
    said["lip_radius_m"] = "open rotor: the rotor's radius"
    said["inertia_kgm2"] = "estimated from mass and arm, +-30 %; only moments need it"
    ct, throttle = None, None
    if a.telemetered:
        ct, said["ct"] = OPEN_ROTOR_CT * (len(motors) // len(places(motors))), "a guess, +-30 %"
    else:
        throttle = _throttle(a, len(motors), hover, said)
    vehicle = Vehicle(
        name=a.name,
        mass_kg=a.mass_kg,
        inertia_kgm2=inertia(a.mass_kg, arm, motors),
        hover_thrust=hover,
        rotor_radius_m=radius,
        fans=_fans(a, motors, arm, radius, ct),
        throttle=throttle,
        rangefinders=a.ranges or parameter_ranges(a.parameters),
        limits=Limits(),
    )
    said["rotors"] = "esc counts from 1 as in the telemetry; spin seen from above"
    return vehicle, said


def _hover(a: Answers) -> tuple[float, str]:
    for name in ("MOT_THST_HOVER", "MPC_THR_HOVER"):
        if 0.05 < a.parameters.get(name, 0.0) < 0.95:
            return round(a.parameters[name], 3), name
    return 0.5, "a guess"


def _throttle(a: Answers, rotors: int, hover: float, said: dict[str, str]) -> Throttle:
    expo, output = throttle_output(a.parameters, hover)
    low, high, pwm = pwm_range(a.parameters, min(_numbers(a, rotors).values()))
    said["pwm_max_us"] = pwm or USUAL_PULSES
    said["max_thrust_n"] = "of one rotor, so that hover_thrust hovers"
    said["expo"] = next((n for n in ("MOT_THST_EXPO", "THR_MDL_FAC") if a.parameters.get(n)), COMMON_PROPELLERS)
    said["voltage_v"] = "of the battery in hover"
    return Throttle(max_thrust(a.mass_kg, rotors, expo, output), expo, low, high, a.voltage_v)


def _numbers(a: Answers, count: int) -> Mapping[int, int]:
    """Motor number to ESC or output."""
    ardupilot = any(name.startswith("SERVO") and name.endswith("_FUNCTION") for name in a.parameters)
    if a.numbers or (a.telemetered and not ardupilot):  # ArduPilot counts ESCs by output, PX4 by motor
        return a.numbers or {motor: motor for motor in range(1, count + 1)}
    return outputs(a.parameters, count)


def places(motors: tuple[Motor, ...]) -> dict[tuple[float, float], list[Motor]]:
    """Motors by place: two in one place are a coaxial fan."""
    out: dict[tuple[float, float], list[Motor]] = {}
    for motor in motors:
        out.setdefault((round(motor.forward, 6), round(motor.right, 6)), []).append(motor)
    return out


def _fans(a: Answers, motors: tuple[Motor, ...], arm: float, radius: float, ct: float | None) -> tuple[Fan, ...]:
    number = _numbers(a, len(motors))

    def rotor(motor: Motor) -> Rotor:
        if not a.telemetered:
            return Rotor(motor.spin, servo=number[motor.number])
        return Rotor(motor.spin, esc=number[motor.number])

    return tuple(
        Fan(
            (round(x * arm, 4), round(y * arm, 4), round(min(m.down for m in here) * arm, 4)),
            radius,
            tuple(rotor(m) for m in here),
            ct,
        )
        for (x, y), here in places(motors).items()
    )


def target_of(orientation: int) -> str:
    """What a rangefinder of this MAV_SENSOR_ORIENTATION looks at, as a rule."""
    return _SEEN.get(direction(orientation), "none")


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
