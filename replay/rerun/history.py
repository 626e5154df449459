"""What a replay decided over time: a few numbers ten times a second (less often over hours), for plots."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from companion.state.decision import Decision
from companion.telemetry.summary import around
from models.common.frames import Array

_PERIOD_S = 0.1
"""Finer than a plot of minutes can show."""
_MOST_ROWS = 36_000
"""An hour. In a longer flight every second row is dropped, and the period is doubled: memory stays at some 20 MB."""
_NAMES = (
    "t_s",
    "thrust",
    "roll_deg",
    "pitch_deg",
    "h_m",
    "d_m",
    "trust",
    "lift_n",
    "side_n",
    "authority",
    "compensating",
)


class History:
    """Accumulates decisions. Columns are NaN where a quantity is not known."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._period_s = _PERIOD_S

    def watch(self, decisions: Iterable[Decision]) -> Iterable[Decision]:
        """Pass decisions on; keep one where the last one kept is a period old."""
        for decision in decisions:
            if not self._rows or not 0.0 <= decision.t_s - self._rows[-1][0] < self._period_s:
                self._keep(decision)
            yield decision

    def _keep(self, decision: Decision) -> None:
        if len(self._rows) >= _MOST_ROWS:
            del self._rows[1::2]
            self._period_s *= 2.0
        offset = decision.offset
        own = (offset.thrust, math.degrees(offset.roll), math.degrees(offset.pitch))
        acts = decision.authority > 0.0 and not decision.reasons
        self._rows.append(
            (decision.t_s, *own, *around(decision.disturbance), decision.authority, acts)
        )

    def column(self, name: str) -> Array:
        """One quantity (n,), infinity as NaN."""
        values = np.array([row[_NAMES.index(name)] for row in self._rows], dtype=float)
        return np.where(np.isfinite(values), values, np.nan)
