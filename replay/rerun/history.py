"""What a replay decided over time: a few numbers ten times a second (less often over hours), for plots."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from companion.control.authority import Reason
from companion.control.state import Decision
from models.frames import Array

_PERIOD_S = 0.1
"""Finer than a plot of minutes can show."""
_MOST_ROWS = 36_000
"""An hour. In a longer flight every second row is dropped, and the period is doubled: memory stays at some 20 MB."""
_NAMES = ("t_s", "h_m", "d_m", "thrust", "roll_deg", "pitch_deg", "lift_n", "side_n", "trust", "authority")
_SHORTEST_S = 0.3
"""Shorter interruptions are joined with what surrounds them."""


@dataclass(frozen=True)
class Span:
    """A time over which offsets acted, or over which one reason held them back."""

    start_s: float
    end_s: float
    reason: Reason | None
    """None: offsets acted."""


class History:
    """Accumulates decisions. Columns are NaN where a quantity is not known."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._reasons: list[Reason | None] = []
        self._period_s = _PERIOD_S

    def add(self, decision: Decision) -> None:
        """Keep a decision where the last one kept is a period old."""
        if self._rows and 0.0 <= decision.t_s - self._rows[-1][0] < self._period_s:
            return
        if len(self._rows) >= _MOST_ROWS:
            del self._rows[1::2], self._reasons[1::2]
            self._period_s *= 2.0
        self._rows.append(_row(decision))
        acts = decision.authority > 0.0 and not decision.reasons
        gravest = min(decision.reasons, key=list(Reason).index, default=Reason.LANDED)
        self._reasons.append(None if acts else gravest)

    def column(self, name: str) -> Array:
        """One quantity (n,), infinity as NaN."""
        values = np.array([row[_NAMES.index(name)] for row in self._rows], dtype=float)
        return np.where(np.isfinite(values), values, np.nan)

    def spans(self) -> list[Span]:
        """The flight in intervals of one reason each (None: compensating)."""
        out: list[Span] = []
        for (t_s, *_), reason in zip(self._rows, self._reasons, strict=True):
            if out and (out[-1].reason is reason or t_s - out[-1].start_s < _SHORTEST_S):
                out[-1] = Span(out[-1].start_s, t_s, reason)
            else:
                out.append(Span(out[-1].end_s if out else t_s, t_s, reason))
        return out

    def watch(self, decisions: Iterable[Decision]) -> Iterable[Decision]:
        """Pass decisions on and keep them."""
        for decision in decisions:
            self.add(decision)
            yield decision


def _row(decision: Decision) -> tuple[float, ...]:
    """In the order of the names: nearest height and wall distance [m], offsets, lift and side force [N], trust."""
    offset, seen = decision.offset, decision.disturbance
    own = (offset.thrust, math.degrees(offset.roll), math.degrees(offset.pitch))
    if seen is None:
        nan = math.nan
        return (decision.t_s, nan, nan, *own, nan, nan, nan, decision.authority)
    fx, fy, fz = seen.wrench[:3]
    near = min(seen.h_m), min(seen.d_m)
    return (decision.t_s, *near, *own, -fz, math.hypot(fx, fy), seen.trust, decision.authority)
