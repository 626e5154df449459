"""A vehicle as the text of a vehicle file, each number with where it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from models.vehicle import Rotor, Vehicle

_TABLES = {"fans", "vanes", "throttle", "rangefinders", "limits"}
"""Fields of a vehicle that are tables of their own."""
_SPINS = {1: "cw", -1: "ccw"}


def vehicle_text(vehicle: Vehicle, origin: Mapping[str, str] | None = None, head: str = "") -> str:
    """TOML that ``load_vehicle`` reads back as ``vehicle``. ``origin``: comments by key, ``{"ct": "a guess"}``."""
    said = {"assumed": "typical numbers; take out what you measured", **(origin or {})}
    lines = [f"# {line}" for line in head.splitlines()] + _keys(vehicle, said)
    # Every fan has the numbers of the first.
    notes = said
    for fan in vehicle.fans:
        lines += ["", "[[fan]]", *_keys(fan, notes)]
        notes = {}
    for vane in vehicle.vanes:
        lines += ["", "[[vane]]", *_keys(vane, {})]
    if vehicle.throttle is not None:
        lines += ["", "[throttle]", *_keys(vehicle.throttle, said)]
    for sensor in vehicle.rangefinders:
        lines += ["", "[[rangefinder]]", *_keys(sensor, {})]
    lines += ["", "[limits]", *_keys(vehicle.limits, said)]
    return "\n".join(lines) + "\n"


def _keys(table: Any, said: Mapping[str, str]) -> list[str]:
    """A line for every field that is no table of its own and has to be given or is not its default."""
    required = getattr(table, "REQUIRED", ())
    out = []
    for f in fields(table):
        value = getattr(table, f.name)
        if f.name not in _TABLES and (f.name in required or value != f.default):
            line = f"{f.name} = {_value(value)}"
            if f.name in said:
                line += f"  # {said[f.name]}"
            out.append(line)
    return out


def _value(value: Any) -> str:
    if isinstance(value, Rotor):
        if value.esc is None:
            number = f"servo = {value.servo}"
        else:
            number = f"esc = {value.esc}"
        return f'{{ {number}, spin = "{_SPINS[value.spin]}" }}'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        printed = "".join(c if c.isprintable() else " " for c in escaped)
        return f'"{printed}"'
    if isinstance(value, int):
        return str(value)
    return repr(float(value))
