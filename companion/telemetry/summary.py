"""A flight, live or replayed, in numbers: decisions, commands, refusals with their durations, offsets."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from typing import Any

from companion.adaptation.adaptation import Adaptation
from companion.control.reasons import Reason
from companion.disturbance.records import Disturbance
from companion.state.decision import Decision

_GAP_S = 0.5
"""A longer gap between decisions is a pause of the stream, not time flown."""
_SHOWN_S = 0.05
"""Shorter ones have no line of their own."""
_SHOWN = ("thrust", "roll_deg", "pitch_deg", "h_m", "d_m", "trust", "lift_n", "side_n")
"""Offset, nearest h and d [m], trust, lift and side force [N]."""
_ORDER = {reason: place for place, reason in enumerate(Reason)}
"""Gravest first: those that hold back everything come before those that only fade the offsets."""


class _Range:
    """Least, mean and most of one quantity.

    In plain floats: to add a number to arrays takes longer than all else of a summary.
    """

    def __init__(self) -> None:
        self._low = math.inf
        self._high = -math.inf
        self._sum = 0.0
        self._count = 0

    def add(self, value: float) -> None:
        """Take in one number."""
        if value < self._low:
            self._low = value
        if value > self._high:
            self._high = value
        self._sum += value
        self._count += 1

    def as_json(self) -> dict[str, float] | None:
        """None where nothing was taken in."""
        if not self._count:
            return None
        return {"min": self._low, "mean": self._sum / self._count, "max": self._high}


class Summary:
    """Accumulates decisions. Durations are on the vehicle's boot axis [s]; a gap above 0.5 s counts for nothing.

    ``dry_run``: nothing of it was sent.
    """

    def __init__(self, dry_run: bool = False) -> None:
        self._dry_run = dry_run
        self.decisions = self.commands = self._gaps = 0
        self._seconds: dict[Reason, float] = defaultdict(float)
        self._gravest: dict[Reason, float] = defaultdict(float)
        self._compensated_s = self._total_s = self._gaps_s = 0.0
        self._last: Decision | None = None
        self._least_gain: float | None = None
        self._ranges = [_Range() for _ in _SHOWN]

    def add(self, decision: Decision) -> None:
        """Take in one decision."""
        last = self._last
        tuned = decision.tuned
        reasons = decision.reasons
        if last is None:
            dt = 0.0
        else:
            dt = decision.t_s - last.t_s
        if dt > _GAP_S:
            self._gaps_s += dt
            self._gaps += 1
        if not 0.0 <= dt <= _GAP_S:
            dt = 0.0
        self._last = decision
        self.decisions += 1
        self._total_s += dt
        self._compensated_s += dt * (decision.authority > 0.0 and not reasons)
        for reason in reasons:
            self._seconds[reason] += dt
        if reasons:
            self._gravest[min(reasons, key=_ORDER.__getitem__)] += dt
        if decision.command is not None:
            self.commands += 1
            if tuned is not None and (
                self._least_gain is None or tuned.margin.gain < self._least_gain
            ):
                self._least_gain = tuned.margin.gain
        for known, value in zip(self._ranges, _shown(decision), strict=True):
            if math.isfinite(value):
                known.add(value)

    @property
    def adaptation(self) -> Adaptation | None:
        """The newest."""
        if self._last is None:
            return None
        return self._last.adaptation

    def _margin_as_json(self) -> dict[str, Any] | None:
        if self._last is None:
            tuned = None
        else:
            tuned = self._last.tuned
        least = self._least_gain
        if tuned is None:
            return None
        return {
            "gain": _rounded(tuned.margin.gain),
            "phase_deg": round(tuned.margin.phase_deg, 1),
            "least_flown_gain": None if least is None else _rounded(least),
            "gain_share": round(tuned.share, 3),
            "attitude_lag_s": round(tuned.loop.lag_s, 3),
            "attitude_from": tuned.loop.source.value,
        }

    def as_json(self) -> dict[str, Any]:
        """Plain numbers; None where nothing was seen."""
        return {
            "decisions": self.decisions,
            "commands": self.commands,
            "duration_s": round(self._total_s, 3),
            "compensated_s": round(self._compensated_s, 3),
            "gaps_s": round(self._gaps_s, 3),
            "gravest_s": {r.name.lower(): round(s, 3) for r, s in _longest_first(self._gravest)},
            "refusals_s": {r.name.lower(): round(s, 3) for r, s in self.refusals()},
            "margin": self._margin_as_json(),
            **{name: known.as_json() for name, known in zip(_SHOWN, self._ranges, strict=True)},
            **({} if self.adaptation is None else {"adapted": self.adaptation.as_json()}),
        }

    @property
    def too_slow(self) -> str:
        """Why most of the flight counts for nothing, where attitudes come too slowly; else empty."""
        if self._gaps_s <= self._total_s:
            return ""
        apart = f"attitudes come {self._gaps_s / max(self._gaps, 1):.1f} s apart"
        return f"{apart}, and 0.2 s is what flight needs: stream ATTITUDE_QUATERNION at 50 Hz"

    def refusals(self) -> list[tuple[Reason, float]]:
        """Every reason with its seconds, the longest first."""
        return _longest_first(self._seconds)

    def as_text(self) -> str:
        """A few lines for a person."""
        sent = f"{self.commands} setpoints, compensated {self._compensated_s:.1f} s"
        if self._dry_run:
            sent = f"nothing sent (dry run); would have compensated {self._compensated_s:.1f} s"
        out = [f"{self.decisions} decisions over {self._total_s + self._gaps_s:.1f} s, {sent}"]
        if self.too_slow:
            out.append(f"  {self._gaps_s:7.1f} s  counted for nothing: {self.too_slow}")
        out += [
            f"  {s:7.1f} s  {reason.value}"
            for reason, s in _longest_first(self._gravest)
            if s >= _SHOWN_S
        ]
        hidden = [r.value for r in self._seconds if self._gravest[r] < _SHOWN_S]
        if hidden:
            out.append(f"  at the same time, less grave: {'; '.join(hidden)}")
        rows = [
            (name, n) for name, n in self.as_json().items() if isinstance(n, dict) and "mean" in n
        ]
        if rows:
            out.append(f"  {'':<10} {'min':>8} {'mean':>8} {'max':>8}")
        out += [
            f"  {name:<10} {n['min']:+z8.3f} {n['mean']:+z8.3f} {n['max']:+z8.3f}"
            for name, n in rows
        ]
        if self.adaptation is not None:
            out += adapted_text(self.adaptation)
        return "\n".join(out)


def _longest_first(seconds: Mapping[Reason, float]) -> list[tuple[Reason, float]]:
    return sorted(seconds.items(), key=lambda item: -item[1])


def _rounded(gain: float) -> float | None:
    """A gain margin for JSON, which knows no infinity."""
    if math.isfinite(gain):
        return round(gain, 2)
    return None


def adapted_text(known: Adaptation) -> list[str]:
    """A line for each size: value, sd, unit, and the share of the model that is compensated by it."""
    shares = known.share_by_name()
    out = [f"  sizes, measured over {known.learned_s:.0f} s of flight:"]
    for name, e in known.estimates().items():
        if name in shares:
            share = f", compensated {shares[name]:.2f}"
        else:
            share = ""
        out.append(
            f"  {name:<16} {e.value:+8.3f} +- {e.sd:.3f} "
            f"{'' if e.unit == '1' else e.unit}{share}".rstrip()
        )
    return out


def _shown(decision: Decision) -> tuple[float, ...]:
    """The numbers of ``_SHOWN``; NaN: not known."""
    offset = decision.offset
    return (
        offset.thrust,
        math.degrees(offset.roll),
        math.degrees(offset.pitch),
        *around(decision.disturbance),
    )


def around(disturbance: Disturbance | None) -> tuple[float, ...]:
    """Nearest h and d [m], trust, lift and side force [N]; NaN: not known."""
    if disturbance is None:
        return (math.nan,) * 5
    fx, fy, fz = disturbance.wrench[:3]
    return min(disturbance.h_m), min(disturbance.d_m), disturbance.trust, -fz, math.hypot(fx, fy)
