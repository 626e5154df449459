"""An effect that a model has adopted: part of what flies, and of what the catalogue describes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class AdoptedEffect:
    """An effect that the diagnosis found missing and added: its catalogue name and fitted parameters, SI."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    """Axes (body FRD about the CG) on which it does not act: there it made the error of the flights larger."""
