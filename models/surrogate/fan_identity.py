"""Which fan a model is of, and whether that is the fan of a vehicle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from models.common.frames import GRAVITY
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.free_air import FreeAir
from models.vehicle import RHO_SEA_LEVEL, Vehicle
from models.vehicle.lift_ratio import BY_COEFFICIENT

_RADIUS_SHARE = 0.05
_LIP_SHARE = 0.10
"""Sizes further apart than this share are of two fans; drawings and rulers agree better."""


@dataclass(frozen=True)
class FanIdentity:
    """Rotor radius [m], outer lip radius [m] and free-air C_T = T/(rho A Omega^2 R^2) of the whole fan."""

    radius_m: float
    lip_radius_m: float
    ct: float

    def as_info(self) -> dict[str, float]:
        """What ``model.json`` keeps under ``fan``."""
        return {name: float(f"{value:.6g}") for name, value in asdict(self).items()}


def identity(free_air: FreeAir, radius_m: float, lip_radius_m: float) -> FanIdentity:
    """The fan of a free-air law, given its sizes."""
    omega = free_air.rpm_ref * 2.0 * math.pi / 60.0
    unit_n = RHO_SEA_LEVEL * math.pi * radius_m**2 * (omega * radius_m) ** 2
    return FanIdentity(radius_m, lip_radius_m, free_air.lift_n / unit_n)


def identity_of(info: Mapping[str, Any]) -> FanIdentity | None:
    """The fan that a model's ``info`` names, or None where it names none (or not in numbers)."""
    fan = info.get("fan")
    try:
        if fan is None:
            return None
        return FanIdentity(float(fan["radius_m"]), float(fan["lip_radius_m"]), float(fan["ct"]))
    except (TypeError, KeyError, ValueError):
        return None


def contradictions(vehicle: Vehicle, model: FanSurrogate) -> tuple[str, ...]:
    """How ``vehicle`` and ``model`` contradict each other, a few words each; empty where they may be of one fan.

    Compared are the sizes that the model names, and, where the vehicle file gives ``ct``, the model's lift at the rotor
    speed at which the vehicle hovers with the vehicle's weight.
    """
    out = []
    fan = identity_of(model.info)
    if fan is not None:
        rotors = [vehicle.rotor_radius_m]
        lips = sorted({declared.lip_radius_m for declared in vehicle.fans})
        out += _apart("rotor", fan.radius_m, rotors, _RADIUS_SHARE)
        out += _apart("lip", fan.lip_radius_m, lips, _LIP_SHARE)
    ratio = lift_over_weight(vehicle, model)
    low, high = BY_COEFFICIENT
    if ratio is not None and not low <= ratio <= high:
        out.append(f"modelled lift at hover is {ratio:.2g} times the weight")
    return tuple(out)


def _apart(what: str, own: float, declared: Sequence[float], share: float) -> list[str]:
    """What is said of a radius of the model that one of the vehicle's is not near."""
    if not any(abs(own - radius) > share * max(own, radius) for radius in declared):
        return []
    listed = " and ".join(f"{radius:g}" for radius in declared)
    return [f"{what} radius {own:g} m in the model, {listed} m in the vehicle file"]


def lift_over_weight(vehicle: Vehicle, model: FanSurrogate) -> float | None:
    """Modelled lift over weight where the rotors turn as fast as ``ct`` says they do in hover; None without ``ct``."""
    unit = RHO_SEA_LEVEL * vehicle.disc_area_m2 * vehicle.rotor_radius_m**2
    known = [fan.ct for fan in vehicle.fans if fan.ct is not None]
    if len(known) < len(vehicle.fans):
        return None
    weight = vehicle.mass_kg * GRAVITY
    rpm = math.sqrt(weight / (sum(known) * unit)) * 60.0 / (2.0 * math.pi)
    return float(model.free_air_law.lift(rpm)) * len(vehicle.fans) / weight
