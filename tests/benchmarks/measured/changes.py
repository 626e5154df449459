"""Real flights whose vehicle file is wrong on purpose: what is hidden by it is known exactly, in measured data."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .known import Flight, Range

LIGHTER = 0.9
"""Declared over true mass."""
WEAKER = 0.85
"""True over declared thrust of the third fan."""
SHIFT = 0.1
"""Distance by which all fans are declared ahead of their places, over the farthest fan's arm."""
LEVEL = ("payload", "thrust_scale")
UNEVEN = ("fan_imbalance", "cg_offset")


@dataclass(frozen=True)
class Change:
    """One wrong entry of a vehicle file and what has to be said of it."""

    edit: Callable[[str, Mapping[str, Any]], str]
    """The file's text and content to its wrong text."""
    must: tuple[frozenset[str], ...]
    touches: tuple[str, ...]
    """Effects whose limits and exclusions are of the right file alone."""
    sizes: Callable[[Mapping[str, Any]], tuple[Range, ...]]
    limits: tuple[Range, ...] = ()
    speeds: bool = False
    """Only where rotor speeds are telemetered: by outputs the battery's level hides it."""


def _lighter(text: str, vehicle: Mapping[str, Any]) -> str:
    return re.sub(
        r"(?m)^mass_kg = .*$", f"mass_kg = {LIGHTER * vehicle['mass_kg']:.6g}", text, count=1
    )


def _weaker(text: str, vehicle: Mapping[str, Any]) -> str:
    blocks = text.split("[[fan]]")
    blocks[3] = re.sub(r"(?m)^ct = .*$", f"ct = {vehicle['fan'][2]['ct'] / WEAKER:.6g}", blocks[3])
    return "[[fan]]".join(blocks)


def _shifted(text: str, vehicle: Mapping[str, Any]) -> str:
    ahead = SHIFT * _arm(vehicle)
    blocks = text.split("[[fan]]")
    for k, fan in enumerate(vehicle["fan"], 1):
        x, y, z = fan["position_m"]
        blocks[k] = re.sub(
            r"position_m = .*", f"position_m = [{x + ahead:.6g}, {y}, {z}]", blocks[k], count=1
        )
    return "[[fan]]".join(blocks)


def _exchanged(text: str, vehicle: Mapping[str, Any]) -> str:
    blocks = text.split("[[fan]]")
    one, two = (re.findall(r"(?m)^rotors = .*$", blocks[k])[0] for k in (1, 2))
    numbers = [re.findall(r"(?:esc|servo) = \d+", line) for line in (one, two)]
    for k, (line, old, new) in enumerate(((one, *numbers), (two, *numbers[::-1])), 1):
        for a, b in zip(old, new, strict=True):
            line = line.replace(a, b)
        blocks[k] = re.sub(r"(?m)^rotors = .*$", line, blocks[k])
    return "[[fan]]".join(blocks)


def _arm(vehicle: Mapping[str, Any]) -> float:
    return max(float(sum(v * v for v in fan["position_m"])) ** 0.5 for fan in vehicle["fan"])


CHANGES = {
    "lighter": Change(
        _lighter, (frozenset(LEVEL),), LEVEL,
        lambda v: (
            Range("payload", "mass_kg", 0.04 * v["mass_kg"], 0.16 * v["mass_kg"]),
            Range("thrust_scale", "scale", -0.16, -0.04),
        ),
        speeds=True,
    ),
    "weak_fan": Change(
        _weaker, (frozenset({"fan_imbalance"}),), UNEVEN,
        lambda _: (Range("fan_imbalance", "scale", -0.25, -0.08),),
        limits=(Range("fan_imbalance", "fan", 3, 3),),
        speeds=True,
    ),
    "shifted": Change(
        _shifted, (frozenset({"cg_offset"}),), UNEVEN,
        lambda v: (Range("cg_offset", "x", 0.5 * SHIFT * _arm(v), 1.5 * SHIFT * _arm(v)),),
    ),
    "exchanged": Change(_exchanged, (frozenset({"fault:vehicle file"}),), (), lambda _: ()),
}  # fmt: skip


def changed(flight: Flight, name: str, data: Path, folder: Path) -> Flight | None:
    """``flight`` with its vehicle file changed, written into ``folder``; None where the change says nothing there."""
    change = CHANGES[name]
    file = data / flight.vehicle
    text = file.read_text(encoding="utf-8")
    vehicle = tomllib.loads(text)
    telemetered = "throttle" not in vehicle and all("ct" in fan for fan in vehicle["fan"])
    if len(vehicle["fan"]) < 3 or (change.speeds and not telemetered):
        return None
    wrong = folder / f"{file.parent.name}-{file.stem}-{name}.toml"
    wrong.write_text(change.edit(text, vehicle), encoding="utf-8")
    kept = tuple(r for r in flight.limits if r.effect not in change.touches)
    return replace(
        flight,
        source=f"{flight.source}, {name}",
        vehicle=str(wrong.resolve()),
        must=(*flight.must, *change.must),
        may=flight.may
        | frozenset(n for n in change.touches if {n} & frozenset().union(*change.must)),
        unknown=flight.unknown - frozenset().union(*change.must),
        never=flight.never - frozenset(change.touches),
        limits=(*kept, *change.limits),
        sizes=(
            *(r for r in flight.sizes if r.effect not in change.touches),
            *change.sizes(vehicle),
        ),
        again=False,
    )
