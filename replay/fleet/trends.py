"""What a fleet's logs have in common: how often an effect is found, how its size varies, whether it drifts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from models.frames import Array

_DAY_S = 86_400.0
_ENOUGH = 5
"""Logs from which on a drift is looked for."""
_MOMENTS = ("from_s",)
"""When something began in one flight: no property of the vehicle."""
_DRIFT_Z = 3.0
"""Slope over its standard error; several effects are tried, so 2 would find too many."""


@dataclass(frozen=True)
class Point:
    """A size of one parameter on one log, with the half width of its 95 % interval (NaN: not given)."""

    vehicle: str
    """As ``craft`` in the answers: the logs' own folder, or the system id."""
    day: float
    """Since 1970, UTC."""
    value: float
    half: float


@dataclass(frozen=True)
class Trend:
    """One parameter of one effect over the logs that show it."""

    effect: str
    parameter: str
    unit: str
    points: tuple[Point, ...]
    logs: int
    """Logs that were judged, with or without the effect."""

    @property
    def values(self) -> Array:
        """Sizes (n,)."""
        return np.array([p.value for p in self.points])

    @property
    def median(self) -> float:
        """Of all logs."""
        return float(np.median(self.values))

    @property
    def varies(self) -> bool:
        """Whether the sizes differ by more than their own intervals explain (chi-square over its freedom above 3)."""
        sd = np.array([p.half / 1.96 for p in self.points])
        known = np.isfinite(sd) & (sd > 0.0)
        if known.sum() < 2:
            return False
        v, w = self.values[known], 1.0 / sd[known] ** 2
        mean = float((w * v).sum() / w.sum())
        return bool((w * (v - mean) ** 2).sum() / (known.sum() - 1) > 3.0)

    @property
    def drift_per_day(self) -> float | None:
        """Slope over the days, where there are logs enough and it stands out of their scatter; else None.

        One slope for all vehicles, each about its own mean: vehicles that were flown in turn are no drift.
        """
        x, y = self._within(np.array([p.day for p in self.points])), self._within(self.values)
        freedom = len(x) - len(self.vehicles) - 1
        if freedom < _ENOUGH - 2 or np.ptp(x) < 1.0:
            return None
        slope = float(x @ y / (x @ x))
        left = y - slope * x
        se = math.sqrt(float(left @ left) / freedom / float(x @ x))
        return slope if abs(slope) > _DRIFT_Z * se else None

    def _within(self, numbers: Array) -> Array:
        """Numbers (n,) of the points, less the mean of each vehicle."""
        out = np.array(numbers, dtype=float)
        for vehicle in self.vehicles:
            own = [p.vehicle == vehicle for p in self.points]
            out[own] -= out[own].mean()
        return out

    def in_words(self) -> str:
        """One sentence."""
        text = f"{len(self.points)} of {self.logs} logs, median {self._size(self.median)}"
        text += "; differs between logs by more than its own uncertainty" if self.varies else ""
        by_vehicle = {v: np.median([p.value for p in self.points if p.vehicle == v]) for v in self.vehicles}
        if len(by_vehicle) > 1:
            text += "; by vehicle: " + ", ".join(f"{v} {self._size(m)}" for v, m in by_vehicle.items())
        drift = self.drift_per_day
        return text if drift is None else f"{text}; drifts by {self._size(30.0 * drift, '+.2g')} in 30 days"

    def _size(self, value: float, form: str = ".3g") -> str:
        return f"{value:{form}}" + ("" if self.unit == "1" else f" {self.unit}")

    @property
    def vehicles(self) -> list[str]:
        """In order of first appearance."""
        return list(dict.fromkeys(p.vehicle for p in self.points))


def trends(answers: Sequence[Mapping[str, Any]]) -> list[Trend]:
    """Of all effects and parameters in the answers of ``replay diagnose``, the most frequent first."""
    judged = [a for a in answers if "verdict" in a]
    points: dict[tuple[str, str, str], list[Point]] = {}
    for a in judged:
        day = datetime.fromisoformat(a["date"]).timestamp() / _DAY_S if a.get("date") else 0.0
        for effect in a["effects"]:
            for name, estimate in effect["parameters"].items():
                if name in _MOMENTS:
                    continue
                low, high = estimate.get("ci95") or (math.nan, math.nan)
                half = 0.5 * (high - low) if low is not None and high is not None else math.nan
                point = Point(str(a.get("craft", "")), day, estimate["value"], half)
                points.setdefault((effect["name"], name, estimate.get("unit", "")), []).append(point)
    out = [Trend(effect, name, unit, tuple(p), len(judged)) for (effect, name, unit), p in points.items()]
    return sorted(out, key=lambda t: -len(t.points))
