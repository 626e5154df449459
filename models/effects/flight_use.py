"""What the flight program does with an adopted effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from models.air_state import AirState
from models.effects.context import Context
from models.surface_map import LawCorrection


class InFlight(Enum):
    """What the flight program may do about an adopted effect."""

    WRENCH = "compensated as a wrench of the air"
    MEASUREMENT = "corrects a measurement"
    MODEL = "part of the model's own answer"
    NONE = "not compensated in flight"


class Reach(Enum):
    """Near what an effect says all there is."""

    ANYWHERE = "anywhere"
    WALL = "a wall in the open"
    CORNER = "ground and wall together"


@dataclass(frozen=True, kw_only=True)
class FlightUse:
    """What the flight program does with an adopted effect."""

    use: InFlight = InFlight.WRENCH
    gain: bool = False
    """A gain on it is measured (``--adapt``): it comes with a place, so nothing steady is taken for it."""
    reach: Reach = Reach.ANYWHERE
    """A law of walls alone is sent near the ground as far as it was measured there."""
    of_model: Callable[[Mapping[str, float], float], LawCorrection] | None = None
    """Of a part of the model's own answer: its correction, by adopted parameters and the fan's radius [m]."""
    corrected: Callable[[AirState, Mapping[str, float]], AirState] | None = None
    """Of what corrects a measurement: the state without the instrument's error, by adopted parameters."""
    covered: tuple[str, ...] = ()
    """Parameters that say where flights have measured it; empty: it holds everywhere."""
    coverage: Callable[[Sequence[Context]], Mapping[str, float]] | None = None
    """Those parameters by flights."""


NOT_FLOWN = FlightUse(use=InFlight.NONE)
