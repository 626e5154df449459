"""How long answers took, counted in bins: the same memory after an hour as after a minute."""

from __future__ import annotations

from collections import Counter

_BIN_US = 10
_BINS = 100_000 // _BIN_US
"""Up to 100 ms; what took longer is counted in the last bin."""


class LatencyHistogram:
    """Counts of latencies in bins of 10 us."""

    def __init__(self) -> None:
        self._bins: Counter[int] = Counter()
        self.count = 0

    def add(self, latency_us: int) -> None:
        """Count one; a negative one counts as 0."""
        self._bins[min(max(latency_us // _BIN_US, 0), _BINS)] += 1
        self.count += 1

    def as_json(self) -> dict[str, float] | None:
        """Median and 99th percentile [ms]; None where nothing was counted."""
        return {"p50": self.percentile_ms(50.0), "p99": self.percentile_ms(99.0)} if self.count else None

    def percentile_ms(self, percent: float) -> float:
        """Upper edge of the bin [ms] that this many percent do not exceed; 0 where nothing was counted."""
        left = self.count * percent / 100.0
        for i, n in sorted(self._bins.items()):
            left -= n
            if left <= 0.0:
                return (i + 1) * _BIN_US / 1000.0
        return 0.0
