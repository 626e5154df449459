"""How long setpoints took, from the message that they answer to the send."""

from __future__ import annotations

from collections import Counter

_LONGEST_US = 100_000
"""Setpoints that took longer are counted as this."""
_BIN_US = 10


class Latencies:
    """Setpoints by how long they took, in bins of 10 us: the same memory after an hour as after a minute."""

    def __init__(self) -> None:
        self._bins: Counter[int] = Counter()

    def add(self, took_us: int) -> None:
        """One more setpoint."""
        self._bins[min(max(took_us, 0), _LONGEST_US) // _BIN_US] += 1

    def percentiles_ms(self) -> dict[str, float] | None:
        """Median and 99th percentile, as upper edges of their bins; None where no setpoint was sent."""
        took = sorted(self._bins.elements())
        if not took:
            return None
        return {
            f"p{share}": (took[(len(took) - 1) * share // 100] + 1) / 100.0 for share in (50, 99)
        }
