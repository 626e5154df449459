"""What is due by time alone, however many messages come."""

from __future__ import annotations

import math


class Timers:
    """When each thing was last done [s], on the clock of arrivals."""

    def __init__(self) -> None:
        self._done_s: dict[str, float] = {}

    def due(self, what: str, period_s: float, now_s: float) -> bool:
        """Whether the last time is that long ago; then this is the last time."""
        if now_s - self._done_s.get(what, -math.inf) < period_s:
            return False
        self._done_s[what] = now_s
        return True

    def start_over(self, what: str) -> None:
        """It is due at once."""
        self._done_s.pop(what, None)
