"""What the command line says of a vehicle that is drafted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from models.common.errors import ConfigError

INCH_M = 0.0254
MOST_KG = 1e4
MOST_INCH = 200.0
MOST_SPAN_M = 20.0
"""Largest mass, propeller and span that are believed."""


@dataclass(frozen=True)
class Given:
    """What the command line says."""

    mass_kg: float | None = None
    propeller_m: float | None = None
    """Diameter."""
    span_m: float | None = None
    """Motor axis to the opposite motor's axis."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """Instance to read, by quantity (``--set``)."""


def check_size(name: str, number: float | None, most: float) -> None:
    """Raises ConfigError, which names it, where a number cannot be that of a vehicle."""
    if number is not None and not 0.0 < number <= most:
        raise ConfigError(f"{name} {number:g}: must be above 0 and at most {most:g}")
