"""An effect that a model has besides its own answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

FROM_S = "from_s"
UNTIL_S = "until_s"
"""Shapes of what begins or ends in flight: the times from and until which it acts [s]."""


@dataclass(frozen=True)
class AdoptedEffect:
    """An effect that the diagnosis found missing and added: its catalogue name and fitted parameters, SI."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    """Axes (body FRD about the CG) on which it does not act: there it made the error of the flights larger."""


def when(parameters: Mapping[str, float]) -> str:
    """``, from 12 s on`` and ``, until 40 s`` of an effect that begins or ends in flight; empty for always."""
    start = parameters.get(FROM_S, 0.0)
    end = parameters.get(UNTIL_S, 0.0)
    words = []
    if start > 0.0:
        words.append(f", from {start:.0f} s on")
    if end > 0.0:
        words.append(f", until {end:.0f} s")
    return "".join(words)
