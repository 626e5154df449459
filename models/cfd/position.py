"""Where the fan stands in one case."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.cfd.config import Setup
from models.common.errors import ConfigError
from models.common.frames import Array

# Cells need room: a gap below this share of R cannot be meshed with these counts.
LEAST_GAP = 0.1

Place = tuple[float, float]
"""(h, d) over R."""
FREE: Place = (math.inf, math.inf)
"""Free air."""


def near(place: Place) -> Array:
    """Coordinates (2,) in which the effect of ground and wall is about linear: 1 / (0.5 + distance)."""
    return np.array([1.0 / (0.5 + v) for v in place])


MODELS = {"half": False, "full": True}
"""Name of a model -> with swirl or without."""


@dataclass(frozen=True, kw_only=True)
class Position:
    """One case. ``h`` and ``d`` over R, ``inf`` without ground or wall; ``level`` multiplies the mesh's cell counts.

    ``swirl`` False: half model, mirror plane y = 0, rotors without swirl (each disc half this way, half that way
    round), so Fy = Mx = Mz = 0 by symmetry. True: whole fan, upper rotor turns clockwise seen from above, the lower
    one against it.
    """

    h: float
    d: float
    rpm: float
    swirl: bool = False
    level: float = 1.0
    approach: str = "near"
    """The start: ``near`` (nearest finished case), ``wall`` (one nearer to the wall), ``far`` (no ground)."""

    @property
    def model(self) -> str:
        """``half`` or ``full``."""
        if self.swirl:
            return "full"
        return "half"

    @property
    def key(self) -> str:
        """Name of the case's folder and of its row."""
        if self.approach == "near":
            start = ""
        else:
            start = f"_from_{self.approach}"
        return f"{self.model}_h{self.h:g}_d{self.d:g}_l{self.level:g}{start}_n{self.rpm:g}"

    @property
    def place(self) -> Place:
        """(h, d) over R."""
        return self.h, self.d


def check(setup: Setup, position: Position) -> None:
    """Refuse, before meshing, a fan that touches the ground or the wall. Raises ConfigError."""
    lowest = -setup.fan.exit_height
    if not position.h > lowest + LEAST_GAP:
        raise ConfigError(
            f"case {position.key}: no room above the ground: h = {position.h:g} R must exceed "
            f"{lowest + LEAST_GAP:g} R, as the duct's exit is {lowest:g} R below the reference "
            "point"
        )
    if not position.d > LEAST_GAP:
        raise ConfigError(
            f"case {position.key}: no room beside the wall: d = {position.d:g} R must exceed "
            f"{LEAST_GAP:g} R"
        )
