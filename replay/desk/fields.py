"""The numbers of a drafted vehicle in the form: their words, units and hints."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from replay.vehicle.draft import INCH_M


@dataclass(frozen=True)
class Field:
    """A number that the form shows in a unit of people: ``scale`` times the vehicle file's."""

    key: str
    words: str
    unit: str
    option: str
    """Of ``replay diagnose``."""
    scale: float = 1.0

    def shown(self, value: Any) -> str:
        """In the form's unit; empty where it is no number."""
        return f"{self.scale * value:.4g}" if isinstance(value, int | float) else ""

    def hint(self, source: str) -> str:
        """Where the number comes from; a range in the form's unit, and no option of the command line."""
        said = re.sub(r"; --\w+ \w+ gives it(; an arm's length)?", "", source)
        return re.sub(
            r"^([\d.e-]+) to ([\d.e+-]+)", lambda m: " to ".join(map(self.shown, map(float, m.groups()))), said
        )


FIELDS = {
    field.key: field
    for field in (
        Field("mass_kg", "mass, with battery", "kg", "--mass"),
        Field("rotor_radius_m", "propeller, diameter", "inch", "--propeller", 2.0 / INCH_M),
        Field("position_m", "span, motor axis to the opposite one", "m", "--span", 2.0),
    )
}


def rows(facts: Sequence[Mapping[str, Any]]) -> list[tuple[Field, str, str]]:
    """The lines of the form for the facts of a draft: a field, what the draft says, a hint."""
    known = {fact["key"]: (fact["value"], fact["from"]) for fact in facts}
    shown = [(field, *known.get(key, (None, ""))) for key, field in FIELDS.items()]
    return [(field, field.shown(value), field.hint(source)) for field, value, source in shown]


def others(facts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Facts of a draft that the form has no field for, one line each."""
    return [f"{fact['key']} {fact['value']}: {fact['from']}" for fact in facts if fact["key"] not in FIELDS]
