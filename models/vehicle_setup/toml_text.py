"""A vehicle as the text of a vehicle file, each number with where it came from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields

from models.vehicle import Limits, Vehicle

_OPTIONAL_LIMITS = ("speed_m_s", "climb_m_s", "acceleration_m_s2")


def vehicle_text(vehicle: Vehicle, origin: Mapping[str, str] | None = None, head: str = "") -> str:
    """TOML that ``load_vehicle`` reads back as ``vehicle``. ``origin``: comments by key, ``{"ct": "a guess"}``."""
    said = origin or {}
    lines = [f"# {line}" for line in head.splitlines()]
    lines += [f"name = {_string(vehicle.name)}"]
    for key in ("mass_kg", "inertia_kgm2", "hover_thrust", "rotor_radius_m"):
        lines.append(_line(key, getattr(vehicle, key), said))
    if vehicle.assumed:
        lines.append(f"assumed = {_list(map(_string, vehicle.assumed))}  # typical numbers; take out what you measured")
    lines += [*_fans(vehicle, said), *_tables("vane", vehicle.vanes)]
    if vehicle.throttle is not None:
        lines += ["", "[throttle]"]
        lines += [_line(f.name, getattr(vehicle.throttle, f.name), said) for f in fields(vehicle.throttle)]
    lines += _tables("rangefinder", vehicle.rangefinders)
    lines += ["", "[limits]"]
    for f in fields(Limits):
        if f.name not in _OPTIONAL_LIMITS or getattr(vehicle.limits, f.name) != f.default:
            lines.append(_line(f.name, getattr(vehicle.limits, f.name), said))
    return "\n".join(lines) + "\n"


def _fans(vehicle: Vehicle, said: Mapping[str, str]) -> Iterator[str]:
    for k, fan in enumerate(vehicle.fans):
        notes = said if k == 0 else {}
        yield ""
        yield "[[fan]]"
        yield _line("position_m", fan.position_m, notes)
        yield _line("lip_radius_m", fan.lip_radius_m, notes)
        if fan.ct is not None:
            yield _line("ct", fan.ct, notes)
        if fan.cq is not None:
            yield _line("cq", fan.cq, notes)
        rotors = [
            f"{{ {'esc' if r.esc is not None else 'servo'} = {r.esc if r.esc is not None else r.servo}, "
            f'spin = "{"cw" if r.spin > 0 else "ccw"}" }}'
            for r in fan.rotors
        ]
        yield f"rotors = [{', '.join(rotors)}]{_note('rotors', notes)}"


def _tables(name: str, items: tuple[object, ...]) -> Iterator[str]:
    for item in items:
        yield ""
        yield f"[[{name}]]"
        for f in fields(item):  # type: ignore[arg-type]
            value = getattr(item, f.name)
            if value != f.default or f.name in getattr(item, "REQUIRED", ()):
                yield _line(f.name, value, {})


def _line(key: str, value: object, said: Mapping[str, str]) -> str:
    return f"{key} = {_value(value)}{_note(key, said)}"


def _note(key: str, said: Mapping[str, str]) -> str:
    return f"  # {said[key]}" if key in said else ""


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return _list(map(_value, value))
    if isinstance(value, str):
        return _string(value)
    if isinstance(value, int):
        return str(value)
    return repr(float(value))  # type: ignore[arg-type]


def _list(items: Iterable[str]) -> str:
    return f"[{', '.join(items)}]"


def _string(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else " " for c in escaped) + '"'
