"""The box of heights and wall distances that a pilot gives to ``--survey``."""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.common.errors import ConfigError

NEAR_M = 0.10
"""No box may ask for less height or wall distance than this."""
TRAVEL_M = 8.0
"""No survey goes further than this."""


@dataclass(frozen=True)
class SurveyBox:
    """Heights over ground and distances to the wall [m]; without a wall both of the latter are inf."""

    height_min_m: float
    height_max_m: float
    wall_min_m: float = math.inf
    wall_max_m: float = math.inf

    @property
    def with_wall(self) -> bool:
        """Whether wall distances are flown."""
        return math.isfinite(self.wall_min_m)


def read_box(text: str) -> SurveyBox:
    """``HEIGHT_MIN:HEIGHT_MAX`` or ``HEIGHT_MIN:HEIGHT_MAX:WALL_MIN:WALL_MAX`` in metres.

    Raises ConfigError where it is no box, or one that nobody should fly.
    """
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 4) or not all(map(math.isfinite, numbers)):
        raise ConfigError(
            f"--survey {text}: give HEIGHT_MIN:HEIGHT_MAX or "
            "HEIGHT_MIN:HEIGHT_MAX:WALL_MIN:WALL_MAX [m]"
        )
    for name, low, high in zip(("HEIGHT", "WALL"), numbers[::2], numbers[1::2], strict=False):
        if low < NEAR_M:
            raise ConfigError(
                f"--survey {text}: {name}_MIN {low:g} m is too close; {NEAR_M:g} m at least"
            )
        if high - low < 0.1:
            raise ConfigError(
                f"--survey {text}: {name}_MAX must be 0.1 m above {name}_MIN at least"
            )
        if high - low > TRAVEL_M:
            raise ConfigError(f"--survey {text}: {name} spans more than {TRAVEL_M:g} m")
    return SurveyBox(*numbers)
