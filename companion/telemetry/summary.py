"""A flight, live or replayed, in numbers: decisions, commands, refusals with their durations, offsets."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import Any

import numpy as np

from companion.adaptation.adaptation import Adaptation
from companion.control.authority import Notice, Reason
from companion.control.plant import HoldTuning, Margin
from companion.control.state import Decision
from companion.estimation.disturbance import Disturbance

_GAP_S = 0.5
"""A longer gap between decisions is a pause of the stream, not time flown."""
_SHOWN_S = 0.05
"""Shorter ones have no line of their own."""
_ORDER = {reason: place for place, reason in enumerate(Reason)}
"""Gravest first: those that hold back everything come before those that only fade the offsets."""


class Summary:
    """Accumulates decisions. Durations are on the vehicle's boot axis [s]; a gap above 0.5 s counts for nothing.

    ``dry_run``: nothing of it was sent.
    """

    def __init__(self, dry_run: bool = False) -> None:
        self._dry_run = dry_run
        self.decisions = self.commands = 0
        self._seconds: dict[Reason, float] = defaultdict(float)
        self._gravest: dict[Reason, float] = defaultdict(float)
        self._compensated_s = self._total_s = self._gaps_s = 0.0
        self._gaps = 0
        self._last_s: float | None = None
        self._tuned: HoldTuning | None = None
        self._least_margin: Margin | None = None
        self.notices: dict[Notice, int] = {}
        self._noticed: tuple[Notice, float] | None = None
        self.adaptation: Adaptation | None = None
        """The newest."""
        self._disturbance: Disturbance | None = None
        self._around = around(None)
        """Of the newest disturbance, which most decisions share with the one before."""
        self._low, self._high = np.full(8, np.nan), np.full(8, np.nan)
        self._sum, self._count = np.zeros(8), np.zeros(8)

    def add(self, decision: Decision) -> None:
        """Take in one decision."""
        dt = 0.0 if self._last_s is None else decision.t_s - self._last_s
        if dt > _GAP_S:
            self._gaps_s += dt
            self._gaps += 1
        dt = dt if 0.0 <= dt <= _GAP_S else 0.0
        self._last_s = decision.t_s
        self.decisions += 1
        self.commands += decision.command is not None
        self._total_s += dt
        self._compensated_s += dt * (decision.authority > 0.0 and not decision.reasons)
        for reason in decision.reasons:
            self._seconds[reason] += dt
        if decision.reasons:
            self._gravest[min(decision.reasons, key=_ORDER.__getitem__)] += dt
        self._add_margin(decision)
        self.adaptation = decision.adaptation
        if decision.disturbance is not self._disturbance:
            self._disturbance, self._around = decision.disturbance, around(decision.disturbance)
        offset = decision.offset
        shown = np.array((offset.thrust, math.degrees(offset.roll), math.degrees(offset.pitch), *self._around))
        known = np.isfinite(shown)
        np.fmin(self._low, shown, where=known, out=self._low)
        np.fmax(self._high, shown, where=known, out=self._high)
        np.add(self._sum, shown, where=known, out=self._sum)
        self._count += known

    def _add_margin(self, decision: Decision) -> None:
        if decision.notice is not None and decision.notice != self._noticed:
            self._noticed = decision.notice
            self.notices[decision.notice[0]] = self.notices.get(decision.notice[0], 0) + 1
        tuned = decision.tuned
        if tuned is None or tuned is self._tuned:
            return
        self._tuned = tuned
        if decision.command is not None and (self._least_margin is None or tuned.margin.gain < self._least_margin.gain):
            self._least_margin = tuned.margin

    def _margin_as_json(self) -> dict[str, Any] | None:
        tuned, least = self._tuned, self._least_margin
        if tuned is None:
            return None
        return {
            "gain": _rounded(tuned.margin.gain),
            "phase_deg": round(tuned.margin.phase_deg, 1),
            "least_flown_gain": None if least is None else _rounded(least.gain),
            "gain_share": round(tuned.share, 3),
            "climb_gain_share": round(tuned.climb_share, 3),
            "attitude_lag_s": round(tuned.loop.lag_s, 3),
            "attitude_gain": tuned.loop.gain,
            "attitude_from": tuned.loop.source.value,
        }

    def as_json(self) -> dict[str, Any]:
        """Plain numbers; None where nothing was seen."""
        names = ("thrust", "roll_deg", "pitch_deg", "h_m", "d_m", "trust", "lift_n", "side_n")
        shown = np.stack([self._low, self._sum / np.maximum(self._count, 1), self._high], axis=1).tolist()
        ranges = {
            name: dict(zip(("min", "mean", "max"), row, strict=True)) if count else None
            for name, row, count in zip(names, shown, self._count, strict=True)
        }
        return {
            "decisions": self.decisions,
            "commands": self.commands,
            "duration_s": round(self._total_s, 3),
            "compensated_s": round(self._compensated_s, 3),
            "gaps_s": round(self._gaps_s, 3),
            "gravest_s": {r.name.lower(): round(s, 3) for r, s in sorted(self._gravest.items(), key=lambda x: -x[1])},
            "refusals_s": {r.name.lower(): round(s, 3) for r, s in self.refusals()},
            "margin": self._margin_as_json(),
            "notices": {notice.name.lower(): count for notice, count in self.notices.items()},
            **ranges,
            **({} if self.adaptation is None else {"adapted": self.adaptation.as_json()}),
        }

    @property
    def too_slow(self) -> str:
        """Why most of the flight counts for nothing, where attitudes come too slowly; else empty."""
        if self._gaps_s <= self._total_s:
            return ""
        apart = self._gaps_s / max(self._gaps, 1)
        return (
            f"attitudes come {apart:.1f} s apart, and 0.2 s is what flight needs: stream ATTITUDE_QUATERNION at 50 Hz"
        )

    def refusals(self) -> list[tuple[Reason, float]]:
        """Every reason with its seconds, the longest first."""
        return sorted(self._seconds.items(), key=lambda x: -x[1])

    def as_text(self) -> str:
        """A few lines for a person."""
        sent = f"{self.commands} setpoints, compensated {self._compensated_s:.1f} s"
        if self._dry_run:
            sent = f"nothing sent (dry run); would have compensated {self._compensated_s:.1f} s"
        out = [f"{self.decisions} decisions over {self._total_s + self._gaps_s:.1f} s, {sent}"]
        if self.too_slow:
            out.append(f"  {self._gaps_s:7.1f} s  counted for nothing: {self.too_slow}")
        for reason, seconds in sorted(self._gravest.items(), key=lambda x: -x[1]):
            if seconds >= _SHOWN_S:
                out.append(f"  {seconds:7.1f} s  {reason.value}")
        hidden = [r.value for r in self._seconds if self._gravest.get(r, 0.0) < _SHOWN_S]
        if hidden:
            out.append(f"  at the same time, less grave: {'; '.join(hidden)}")
        rows = [(name, n) for name, n in self.as_json().items() if isinstance(n, dict) and "mean" in n]
        if rows:
            out.append(f"  {'':<10} {'min':>8} {'mean':>8} {'max':>8}")
        out += [f"  {name:<10} {n['min']:+z8.3f} {n['mean']:+z8.3f} {n['max']:+z8.3f}" for name, n in rows]
        if self.adaptation is not None:
            out += adapted_text(self.adaptation)
        return "\n".join(out)


def _rounded(gain: float) -> float | None:
    """A gain margin for JSON, which knows no infinity."""
    return round(gain, 2) if math.isfinite(gain) else None


def adapted_text(known: Adaptation) -> list[str]:
    """A line for each size: value, sd, unit, and the share of the model that is compensated by it."""
    shares = known.share_by_name()
    out = [f"  sizes, measured over {known.learned_s:.0f} s of flight:"]
    for name, e in known.told().items():
        told = f", compensated {shares[name]:.2f}" if name in shares else ""
        out.append(f"  {name:<16} {e.value:+8.3f} +- {e.sd:.3f} {'' if e.unit == '1' else e.unit}{told}".rstrip())
    return out


def around(disturbance: Disturbance | None) -> tuple[float, ...]:
    """Nearest h and d [m], trust, lift and side force [N]; NaN: not known."""
    if disturbance is None:
        return (math.nan,) * 5
    fx, fy, fz = disturbance.wrench[:3]
    h_m, d_m = min(disturbance.h_m), min(disturbance.d_m)
    return h_m, d_m, disturbance.trust, -fz, math.hypot(fx, fy)
