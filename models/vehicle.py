"""The vehicle file: one TOML file (docs/formats.md), read and checked."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from models.errors import ConfigError
from models.vehicle_plausibility import Severity, findings
from models.vehicle_types import (
    RHO_SEA_LEVEL,
    TARGETS,
    Fan,
    Limits,
    Rangefinder,
    Rotor,
    Throttle,
    Vane,
    Vector3,
    Vehicle,
)

__all__ = ["RHO_SEA_LEVEL", "Fan", "Limits", "Rangefinder", "Rotor", "Throttle", "Vane", "Vector3", "Vehicle"]
__all__ += ["load_vehicle", "parse_vehicle"]


def load_vehicle(path: Path | str) -> Vehicle:
    """Read and check a vehicle file.

    Raises ConfigError naming the file and the key: unreadable, not TOML, unknown or missing key, impossible value, a
    vehicle that cannot be (models/vehicle_plausibility.py, which also has the warnings about an odd one).
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"vehicle file {path}: cannot be read ({reason})") from None
    return parse_vehicle(text, str(path))


def parse_vehicle(text: str, file: str) -> Vehicle:
    """``load_vehicle`` of a text; ``file`` is what errors name."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"vehicle file {file}: not valid TOML: {error}") from None
    return _vehicle(_Table(table, file, ""))


_KEYS = frozenset(f.name for kind in (Rotor, Fan, Vane, Throttle, Rangefinder, Limits) for f in fields(kind)) | {
    "name", "mass_kg", "inertia_kgm2", "hover_thrust", "rotor_radius_m",
    "fan", "vane", "throttle", "rangefinder", "limits",
}  # fmt: skip
"""Every key of a vehicle file."""


class _Table:
    """One TOML table whose keys are taken one by one; what is left at the end is unknown."""

    def __init__(self, values: Mapping[str, Any], file: str, prefix: str) -> None:
        self._left = dict(values)
        self._file = file
        self._prefix = prefix

    def fail(self, key: str, problem: str) -> ConfigError:
        return ConfigError(f"vehicle file {self._file}: key '{self._prefix}{key}' {problem}")

    def _take(self, key: str) -> Any:
        if key not in self._left:
            # A key spelt otherwise is the usual reason: name it too.
            meant = get_close_matches(key, [k for k in self._left if k not in _KEYS], 1, 0.5)
            raise self.fail(key, f"is missing; '{self._prefix}{meant[0]}' is not known" if meant else "is missing")
        return self._left.pop(key)

    def __contains__(self, key: str) -> bool:
        return key in self._left

    def number(self, key: str, low: float = -math.inf, high: float = math.inf, *, above: bool = False) -> float:
        return self._number(key, self._take(key), low, high, above)

    def _number(self, key: str, value: Any, low: float, high: float, above: bool = False) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.fail(key, f"must be a finite number, not {value!r}")
        if not low <= value <= high or (above and value == low):
            bound = f"above {low:g}" if above else f"at least {low:g}"
            if math.isfinite(high):
                bound += f" and at most {high:g}"
            raise self.fail(key, f"must be {bound}, not {value:g}")
        return float(value)

    def optional(self, key: str, default: float, high: float) -> float:
        """A number above 0 and at most ``high``, or the default where the key is absent."""
        return self.number(key, 0.0, high, above=True) if key in self._left else default

    def whole(self, key: str, low: int, high: int) -> int:
        value = self._take(key)
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.fail(key, f"must be a whole number from {low} to {high}, not {value!r}")
        return value

    def text(self, key: str, choices: Sequence[str] = ()) -> str:
        value = self._take(key)
        if not isinstance(value, str) or (choices and value not in choices):
            expected = f"one of {', '.join(choices)}" if choices else "text"
            raise self.fail(key, f"must be {expected}, not {value!r}")
        return value

    def vector(self, key: str, limit: float = 100.0) -> Vector3:
        value = self._take(key)
        if not isinstance(value, list) or len(value) != 3:
            raise self.fail(key, f"must be three numbers, not {value!r}")
        x, y, z = (self._number(f"{key}[{i}]", v, -limit, limit) for i, v in enumerate(value))
        return (x, y, z)

    def tables(self, key: str, *, required: bool) -> list[_Table]:
        if key not in self._left and not required:
            return []
        value = self._take(key)
        if not isinstance(value, list) or (required and not value) or not all(isinstance(v, dict) for v in value):
            raise self.fail(key, "must be one or more tables")
        return [_Table(v, self._file, f"{self._prefix}{key}[{i}].") for i, v in enumerate(value, 1)]

    def table(self, key: str) -> _Table:
        value = self._take(key)
        if not isinstance(value, dict):
            raise self.fail(key, "must be a table")
        return _Table(value, self._file, f"{self._prefix}{key}.")

    def done(self) -> None:
        if self._left:
            key = next(iter(self._left))
            meant = get_close_matches(key, sorted(_KEYS), 1, 0.6)
            raise self.fail(key, f"is not known; did you mean '{meant[0]}'?" if meant else "is not known")


def _vehicle(table: _Table) -> Vehicle:
    fans = tuple(_fan(t) for t in table.tables("fan", required=True))
    vehicle = Vehicle(
        name=table.text("name"),
        mass_kg=table.number("mass_kg", 0.0, 1e4, above=True),
        inertia_kgm2=_inertia(table),
        hover_thrust=table.number("hover_thrust", 0.0, 1.0, above=True),
        rotor_radius_m=table.number("rotor_radius_m", 0.0, 10.0, above=True),
        fans=fans,
        vanes=tuple(_vane(t, len(fans)) for t in table.tables("vane", required=False)),
        throttle=_throttle(table.table("throttle")) if "throttle" in table else None,
        rangefinders=tuple(_rangefinder(t) for t in table.tables("rangefinder", required=False)),
        limits=_limits(table.table("limits")) if "limits" in table else Limits(),
    )
    table.done()
    _check_rotors(table, vehicle)
    for i, fan in enumerate(vehicle.fans, 1):
        if fan.lip_radius_m < vehicle.rotor_radius_m - 1e-9:
            raise table.fail(f"fan[{i}].lip_radius_m", "is smaller than rotor_radius_m; is that the diameter?")
    for finding in findings(vehicle):
        if finding.severity is Severity.ERROR:
            raise table.fail(finding.key, finding.text)
    return vehicle


def _inertia(table: _Table) -> Vector3:
    inertia = table.vector("inertia_kgm2", 1e4)
    if min(inertia) <= 0.0:
        raise table.fail("inertia_kgm2", f"must be positive, not {list(inertia)}")
    if 2.0 * max(inertia) > sum(inertia) * (1.0 + 1e-9):
        raise table.fail("inertia_kgm2", "is impossible: no body has one moment of inertia above the sum of the others")
    return inertia


def _fan(table: _Table) -> Fan:
    fan = Fan(
        position_m=table.vector("position_m"),
        lip_radius_m=table.number("lip_radius_m", 0.0, 10.0, above=True),
        rotors=tuple(_rotor(t) for t in table.tables("rotors", required=True)),
        ct=table.number("ct", 0.0, 1.0, above=True) if "ct" in table else None,
        cq=table.number("cq", 0.0, 1.0, above=True) if "cq" in table else None,
    )
    table.done()
    return fan


def _rotor(table: _Table) -> Rotor:
    rotor = Rotor(
        spin=1 if table.text("spin", ("cw", "ccw")) == "cw" else -1,
        esc=table.whole("esc", 1, 32) if "esc" in table else None,
        servo=table.whole("servo", 1, 16) if "servo" in table else None,
    )
    table.done()
    if (rotor.esc is None) == (rotor.servo is None):
        raise table.fail("esc", "or 'servo' is needed, one of the two")
    return rotor


def _vane(table: _Table, fans: int) -> Vane:
    vane = Vane(
        servo=table.whole("servo", 1, 16),
        fan=table.whole("fan", 1, fans),
        position_m=table.vector("position_m"),
        axis=table.vector("axis", 1.0),
        force_per_thrust_rad=table.number("force_per_thrust_rad", 0.0, 10.0),
        neutral_us=table.number("neutral_us", 500.0, 2500.0),
        rad_per_us=table.number("rad_per_us", -0.1, 0.1),
    )
    table.done()
    if abs(math.hypot(*vane.axis) - 1.0) > 1e-3:
        raise table.fail("axis", "must be a direction of length 1")
    return vane


def _throttle(table: _Table) -> Throttle:
    throttle = Throttle(
        max_thrust_n=table.number("max_thrust_n", 0.0, 1e5, above=True),
        expo=table.number("expo", -1.0, 1.0),
        pwm_min_us=table.number("pwm_min_us", 0.0, 3000.0),
        pwm_max_us=table.number("pwm_max_us", 0.0, 3000.0),
        voltage_v=table.number("voltage_v", 0.0, 1000.0, above=True),
    )
    table.done()
    if throttle.pwm_max_us <= throttle.pwm_min_us:
        raise table.fail("pwm_max_us", "must be above pwm_min_us")
    return throttle


def _rangefinder(table: _Table) -> Rangefinder:
    sensor = Rangefinder(
        orientation=table.whole("orientation", 0, 255),
        target=table.text("target", TARGETS),
        position_m=table.vector("position_m"),
    )
    table.done()
    return sensor


def _limits(table: _Table) -> Limits:
    limits = Limits(
        thrust=table.number("thrust", 0.0, 0.5),
        tilt_deg=table.number("tilt_deg", 0.0, 30.0),
        slew_thrust_per_s=table.number("slew_thrust_per_s", 0.0, 100.0, above=True),
        slew_tilt_deg_per_s=table.number("slew_tilt_deg_per_s", 0.0, 3600.0, above=True),
        speed_m_s=table.optional("speed_m_s", Limits.speed_m_s, 20.0),
        climb_m_s=table.optional("climb_m_s", Limits.climb_m_s, 10.0),
        acceleration_m_s2=table.optional("acceleration_m_s2", Limits.acceleration_m_s2, 10.0),
    )
    table.done()
    return limits


def _check_rotors(table: _Table, vehicle: Vehicle) -> None:
    by_esc = [r.esc for r in vehicle.rotors if r.esc is not None]
    by_servo = [r.servo for r in vehicle.rotors if r.servo is not None]
    if by_esc and by_servo:
        raise table.fail("fan", "mixes rotors named by 'esc' and by 'servo': use one of the two")
    if by_servo and vehicle.throttle is None:
        raise table.fail("throttle", "is missing, and the rotors are named by 'servo'")
    if by_esc and vehicle.throttle is not None:
        raise table.fail("throttle", "is given, but the rotors are named by 'esc'")
    for key, ids in (("esc", by_esc), ("servo", by_servo + [v.servo for v in vehicle.vanes])):
        if len(set(ids)) != len(ids):
            raise table.fail(key, f"{max(ids, key=ids.count)} is used twice")
