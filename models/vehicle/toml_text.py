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
    tables: list[tuple[str, Any, Mapping[str, str]]] = [
        *(("[[fan]]", fan, {} if k else said) for k, fan in enumerate(vehicle.fans)),
        *(("[[vane]]", vane, {}) for vane in vehicle.vanes),
        *([("[throttle]", vehicle.throttle, said)] if vehicle.throttle is not None else []),
        *(("[[rangefinder]]", sensor, {}) for sensor in vehicle.rangefinders),
        ("[limits]", vehicle.limits, said),
    ]
    for name, table, notes in tables:
        lines += ["", name, *_keys(table, notes)]
    return "\n".join(lines) + "\n"


def _keys(table: Any, said: Mapping[str, str]) -> list[str]:
    """A line for every field that is no table of its own and has to be given or is not its default."""
    required = getattr(table, "REQUIRED", ())
    out = []
    for f in fields(table):
        value = getattr(table, f.name)
        if f.name not in _TABLES and (f.name in required or value != f.default):
            out.append(
                f"{f.name} = {_value(value)}" + (f"  # {said[f.name]}" if f.name in said else "")
            )
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
        return '"' + "".join(c if c.isprintable() else " " for c in escaped) + '"'
    if isinstance(value, int):
        return str(value)
    return repr(float(value))
