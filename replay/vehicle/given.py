"""What the command line says of a vehicle that is drafted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

INCH_M = 0.0254


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
