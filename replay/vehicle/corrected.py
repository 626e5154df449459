"""Numbers of a drafted vehicle that a person knows better: ``--set KEY=VALUE``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace

from models.errors import ConfigError
from models.frames import GRAVITY
from models.vehicle import RHO_SEA_LEVEL, Throttle, Vehicle, parse_vehicle
from models.vehicle_setup.toml_text import vehicle_text

HOVER_RPM = "hover_rpm"
"""Rotor speed at which the vehicle hovers: ct in other words."""


def corrected(vehicle: Vehicle, numbers: Mapping[str, float]) -> Vehicle:
    """The vehicle with these ``numbers``. ConfigError where it has no such number, or one is impossible."""
    if not numbers:
        return vehicle
    curve = vehicle.throttle
    known = tuple(f.name for f in fields(Throttle)) if curve else ("ct", HOVER_RPM) if vehicle.fans[0].ct else ()
    fans, hover = vehicle.fans, vehicle.hover_thrust
    for key, value in numbers.items():
        if key not in ("hover_thrust", *known):
            raise ConfigError(
                f"--set {key}: this vehicle has no such number; it has {', '.join(('hover_thrust', *known))}"
            )
        if value <= 0.0 and key != "expo":
            raise ConfigError(f"--set {key}={value:g}: must be above 0")
        if key == "hover_thrust":
            hover = value
        elif curve is not None:
            curve = replace(curve, **{key: value})
        else:
            ct = value if key == "ct" else (fans[0].ct or 0.0) * (hover_rpm(vehicle) / value) ** 2
            fans = tuple(replace(fan, ct=ct) for fan in fans)
    out = replace(vehicle, hover_thrust=hover, throttle=curve, fans=fans)
    parse_vehicle(vehicle_text(out), "--set")
    return out


def hover_rpm(vehicle: Vehicle) -> float:
    """Mean rotor speed [rpm] that carries the vehicle: sum(ct) rho A Omega^2 R^2 = m g, A = pi R^2."""
    per_speed2 = sum(fan.ct or 0.0 for fan in vehicle.fans) * RHO_SEA_LEVEL * math.pi * vehicle.rotor_radius_m**4
    return 60.0 / (2.0 * math.pi) * math.sqrt(vehicle.mass_kg * GRAVITY / per_speed2)
