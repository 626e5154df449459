"""Linear coefficients and shapes of an effect: what physics expects of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from models.effects.context import Context


class BelongsTo(Enum):
    """What an effect, or one coefficient of it, is a property of: whether the next flight has it, too."""

    VEHICLE = "vehicle"
    """Thrust, drag, centre of gravity, the law of ground and walls."""
    WEATHER = "weather"
    """Wind and density: every flight has its own."""
    LOAD = "load"
    """Battery and load: every flight has its own."""
    INSTRUMENT = "instrument"
    """Offset of a sensor: corrects what that sensor reads, and is no force."""
    PLACE = "place"
    """Of surroundings that a range measures: there only where they are seen."""

    @property
    def of_day(self) -> bool:
        """Every flight has its own; the next one starts from the prior."""
        return self in (BelongsTo.WEATHER, BelongsTo.LOAD)


Size = float | Callable[["Context"], float]
"""A number, or one that follows from the vehicle and the flight."""


@dataclass(frozen=True, kw_only=True)
class Coefficient:
    """One linear coefficient: name, unit, the range in which physics expects it, and its prior.

    The prior is a Gaussian about ``centre`` with standard deviation ``typical`` (before any flight was seen), cut off
    at ``low`` and ``high``. ``belongs_to`` is given where it is not what its effect belongs to.
    """

    name: str
    unit: str
    low: Size
    high: Size
    typical: Size = 1.0
    centre: Size = 0.0
    belongs_to: BelongsTo | None = None
    optional: bool = False
    """A model directory may lack it: 0 there."""
    foretold: bool = False
    """What it multiplies is a motion that no sensor saw, foretold with errors: the fit comes out too small."""

    def spread(self, ctx: Context) -> float:
        """Standard deviation of the prior."""
        if callable(self.typical):
            return self.typical(ctx)
        return self.typical

    def least(self, ctx: Context) -> float:
        """Lower end of what physics expects."""
        if callable(self.low):
            return self.low(ctx)
        return self.low

    def most(self, ctx: Context) -> float:
        """Upper end of what physics expects."""
        if callable(self.high):
            return self.high(ctx)
        return self.high

    def mean(self, ctx: Context) -> float:
        """Mean of the prior."""
        if callable(self.centre):
            return self.centre(ctx)
        return self.centre


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One non-linear parameter, profiled on a grid; ``kinds`` are values that have nothing in between.

    A parameter without ``continuous`` is a kind (a fan's number) or a reference, and never moves off its grid.
    """

    name: str
    unit: str
    continuous: bool = True
    kinds: tuple[float, ...] = ()
    typical: float | None = None
    """Standard deviation of the prior about zero; None: all values are as likely."""
    free_at_zero: bool = False
    """Zero is a value like others (there is no dead time), not the edge of what was tried."""
    tried: tuple[float, ...] = ()
    """Its values on the grid, where they are the same on every flight."""
