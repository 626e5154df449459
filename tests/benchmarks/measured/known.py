"""The table of what is known of every flight, read from ``flights.toml``, which explains its keys."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

TABLE = Path(__file__).with_name("flights.toml")
FORCES = ("Fx", "Fy", "Fz")
KINDS = ("measured", "autopilot", "simulated")
VERDICTS = frozenset({"nothing_missing", "explained", "partly_explained", "unexplained"})
CATALOGUE = frozenset(
    {
        "ceiling", "second_wall", "partial_ground", "wind", "rotor_drag", "body_drag", "vertical_inflow", "air_density",
        "thrust_scale", "thrust_curve", "fan_imbalance", "payload", "cg_offset", "range_offset", "imu_bias",
        "thermal_derating", "battery_sag", "gyroscopic", "ground_effect", "wall_effect", "corner_effect",
        "surface_law", "motor_lag", "contact",
        "slung_load", "mounting_tilt",
    }
)  # fmt: skip
"""Names that the tables judge. A name that an answer adds to them is unknown: no table could foresee it."""
YOUNGER = frozenset(
    {"rate_damping", "flapping_moment", "trim_moment", "rotor_inertia", "momentum_thrust"}
)
"""Names of the catalogue that came after the tables. A table that is written from now on may ask for them."""
FORESEEN = CATALOGUE | YOUNGER
"""Names that a table may use."""


@dataclass(frozen=True)
class Range:
    """Where a parameter of an effect is known to lie."""

    effect: str
    parameter: str
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Whether ``value`` lies in it."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Flight:
    """One flight and what is known of it."""

    source: str
    kind: str
    log: str
    vehicle: str
    axes: tuple[str, ...]
    model: str = "none"
    table: str = ""
    """Data set that the declared model is trained on, where ``model`` is ``table``."""
    left_share: float = 0.03
    must: tuple[frozenset[str], ...] = ()
    may: frozenset[str] = frozenset()
    unknown: frozenset[str] = frozenset()
    never: frozenset[str] = frozenset()
    open: bool = False
    verdicts: frozenset[str] = VERDICTS
    best: tuple[tuple[str, float], ...] = ()
    """RMS in newtons that the best published fit leaves, per axis."""
    limits: tuple[Range, ...] = ()
    sizes: tuple[Range, ...] = ()
    short: bool = False
    again: bool = False
    known: str = ""
    other_logs: tuple[str, ...] = ()
    """Logs that are diagnosed together with ``log``."""

    @property
    def name(self) -> str:
        """The log's name without folder and ending, and the vehicle file's where the log is judged twice."""
        stem = f"{len(self.logs)} logs together" if self.other_logs else Path(self.log).stem
        return f"{stem} [{Path(self.vehicle).stem}]" if self.again or self.other_logs else stem

    @property
    def logs(self) -> tuple[str, ...]:
        """All logs of one diagnosis."""
        return (self.log, *self.other_logs)

    @property
    def true(self) -> frozenset[str]:
        """Names that are right."""
        return self.may | frozenset(n for group in self.must for n in group if n in FORESEEN)

    def missing(self, data: Path) -> list[str]:
        """Files of this flight that are not below ``data``."""
        return [f for f in (*self.logs, self.vehicle, self.table) if f and not (data / f).is_file()]


@dataclass(frozen=True)
class Known:
    """All flights, and the sets of names that one flight may not be able to tell apart."""

    flights: tuple[Flight, ...]
    aliases: tuple[frozenset[str], ...]


def read(path: Path = TABLE) -> Known:
    """Read and check the table. Raises ValueError that names the flight and the key."""
    raw = tomllib.loads(path.read_text(encoding="utf-8"))
    aliases = tuple(_names(a["names"], "alias") for a in raw["alias"])
    return Known(tuple(_flight(s, f) for s in raw["source"] for f in s["flight"]), aliases)


def together(flights: Iterable[Flight]) -> list[Flight]:
    """Flights of one vehicle file as one data set, where there are two or more.

    What must be named on every one of them must be named; what is true of any of them may be. A name is wrong, and a
    size out of its limits, only where it is so on all of them.
    """
    groups: dict[tuple[str, str], list[Flight]] = {}
    for f in flights:
        groups.setdefault((f.source, f.vehicle), []).append(f)
    return [_joined(group) for group in groups.values() if len(group) > 1]


def _joined(group: list[Flight]) -> Flight:
    first = group[0]
    return replace(
        first,
        must=tuple(g for g in first.must if all(g in f.must for f in group)),
        may=frozenset().union(*(f.true for f in group)),
        unknown=frozenset().union(*(f.unknown for f in group)),
        never=frozenset.intersection(*(f.never for f in group)),
        open=any(f.open for f in group),
        verdicts=frozenset().union(*(f.verdicts for f in group)),
        best=(),
        limits=tuple(r for r in first.limits if all(r in f.limits for f in group)),
        sizes=tuple(r for r in first.sizes if all(r in f.sizes for f in group)),
        short=False,
        again=first.again,
        other_logs=tuple(f.log for f in group[1:]),
    )


def _flight(source: Mapping[str, Any], flight: Mapping[str, Any]) -> Flight:
    where = f"{source['name']}: {flight['log']}"
    both = {k: v for k, v in source.items() if k not in ("flight", "name")} | dict(flight)
    unknown_keys = sorted(set(both) - {f.name for f in fields(Flight)})
    if unknown_keys or both["kind"] not in KINDS:
        raise ValueError(f"{where}: unknown key or kind: {unknown_keys or both['kind']}")

    def joined(key: str) -> frozenset[str]:
        return _names([*source.get(key, []), *flight.get(key, [])], where)

    def ranges(key: str) -> tuple[Range, ...]:
        return tuple(Range(*r) for r in [*source.get(key, []), *flight.get(key, [])])

    must = tuple(frozenset(group) for group in flight.get("must", []))
    _names((n for group in must for n in group if ":" not in n), where)
    _names((r.effect for r in ranges("limits") + ranges("sizes")), where)
    verdicts = frozenset(flight.get("verdicts", VERDICTS))
    if not verdicts <= VERDICTS:
        raise ValueError(f"{where}: verdicts {sorted(verdicts - VERDICTS)}")
    made = {k: joined(k) for k in ("unknown", "never")} | {
        k: ranges(k) for k in ("limits", "sizes")
    }
    made |= {
        "may": joined("may") - joined("never"),
        "must": must,
        "verdicts": verdicts,
        "axes": tuple(both["axes"]),
        "best": tuple(both.get("best", {}).items()),
    }
    return Flight(source=source["name"], **{**both, **made})


def _names(names: Iterable[str], where: str) -> frozenset[str]:
    out = frozenset(names)
    if not out <= FORESEEN:
        raise ValueError(f"{where}: no such effect: {sorted(out - FORESEEN)}")
    return out
