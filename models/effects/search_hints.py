"""How the search looks for an effect, and when it is believed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effects.coefficient import Size
from models.effects.context import Context


@dataclass(frozen=True, kw_only=True)
class SearchHints:
    """What the search of a diagnosis must know of one effect besides its physics."""

    chance: Size = 0.05
    """Probability: how often such a thing is undeclared, before any flight was seen."""
    form: float = 0.12
    """What it may leave at most by an error of its form, as a share of its own: less is not believed beside it."""
    exact: bool = False
    """A law of mechanics: no error of its form stands beside it, which could pass for another effect's."""
    searched: tuple[str, ...] = ()
    """Axes by which it is looked for, where others would only answer disturbances; empty: all that it acts on."""
    needs_moments: bool = False
    """Without moments it cannot be distinguished from others."""
    halvings: int = 2
    """How often the grid of its shapes is halved about the best."""
    at_shape: bool = False
    """The one coefficient is a length at which the one shape linearises: both have to agree."""
    may_begin: bool = False
    """It may begin or end in flight: the search of one flight tries times at which the residual changes."""
    several: bool = False
    """A vehicle may have several of it, each in another first shape: two weak fans."""
    remainder: bool = False
    """Weighed after all others, for what they leave."""

    def log_odds(self, ctx: Context) -> float:
        """Log odds of its being there, before any flight was seen: log(p / (1 - p))."""
        if callable(self.chance):
            chance = self.chance(ctx)
        else:
            chance = self.chance
        return math.log(chance / (1.0 - chance))
