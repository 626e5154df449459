"""Vehicle files of sources: their keys, and those as text."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

LIMITS = {
    "thrust": 0.1,
    "tilt_deg": 8.0,
    "slew_thrust_per_s": 0.5,
    "slew_tilt_deg_per_s": 60.0,
}
"""A diagnosis does not use them."""

CRAZYFLIE_PLACES = (
    (1, 1, "ccw"),
    (-1, 1, "cw"),
    (-1, -1, "ccw"),
    (1, -1, "cw"),
)
"""Of four rotors, over the arm, ahead and to the right, in order of the motors of a Crazyflie."""
PARROT_PLACES = (
    (1, -1, "cw"),
    (1, 1, "ccw"),
    (-1, 1, "cw"),
    (-1, -1, "ccw"),
)
"""The same of an AR.Drone and a Mambo."""
HEXAROTOR_X_PLACES = (
    (0.0, 1.0, "cw"),
    (0.0, -1.0, "ccw"),
    (0.866, -0.5, "cw"),
    (-0.866, 0.5, "ccw"),
    (0.866, 0.5, "ccw"),
    (-0.866, -0.5, "cw"),
)
"""The same of the six motors of PX4's hexarotor x."""


def vehicle(
    *,
    name: str,
    mass_kg: float,
    inertia: Sequence[float],
    hover_thrust: float,
    radius_m: float,
    **tables: Any,
) -> dict[str, Any]:
    """The keys of a vehicle file; ``tables``: ``fan`` and, without telemetered speeds, ``throttle``."""
    plain = {
        "name": name,
        "mass_kg": mass_kg,
        "inertia_kgm2": list(inertia),
        "hover_thrust": hover_thrust,
        "rotor_radius_m": radius_m,
    }
    return plain | tables | {"limits": LIMITS}


def fans(
    places: Iterable[tuple[float, float, str]],
    arm_m: float,
    radius_m: float,
    *,
    output: str = "servo",
    height_m: float = 0.0,
) -> list[dict[str, Any]]:
    """One rotor a fan: ``places`` ahead and to the right over the arm with its spin, in order of the outputs."""
    return [
        {
            "position_m": [x * arm_m, y * arm_m, height_m],
            "lip_radius_m": radius_m,
            "rotors": [{output: number, "spin": spin}],
        }
        for number, (x, y, spin) in enumerate(places, 1)
    ]


def throttle(max_thrust_n: float, expo: float, voltage_v: float) -> dict[str, float]:
    """The keys of ``[throttle]`` for outputs from 1000 to 2000."""
    return {
        "max_thrust_n": max_thrust_n,
        "expo": expo,
        "voltage_v": voltage_v,
        "pwm_min_us": 1000.0,
        "pwm_max_us": 2000.0,
    }


def vehicle_toml(keys: Mapping[str, Any]) -> str:
    """A vehicle file of ``keys``: numbers, texts and lists first, then lists of tables, then tables."""
    plain = ""
    lists = ""
    tables = ""
    for key, value in keys.items():
        if isinstance(value, Mapping):
            tables += f"\n[{key}]\n{vehicle_toml(value)}"
        elif _tables(value):
            for item in value:
                lists += f"\n[[{key}]]\n{vehicle_toml(item)}"
        else:
            plain += f"{key} = {_value(value)}\n"
    return plain + lists + tables


def _tables(value: Any) -> bool:
    """Whether ``value`` is a list of tables; rotors stand in one line."""
    return (
        isinstance(value, list)
        and bool(value)
        and isinstance(value[0], Mapping)
        and "spin" not in value[0]
    )


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        pairs = (f"{k} = {_value(v)}" for k, v in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value)
