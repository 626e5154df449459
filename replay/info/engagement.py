"""Whether ``companion`` would have engaged: the pipeline of flight over a log, of a long one over its first minutes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.config import PipelineConfig
from companion.control.authority import Reason
from companion.control.state import Decision
from companion.telemetry.summary import Summary
from models.progress import Bars
from replay.rerun.report import run

_DECIDED_S = 600.0
"""Of a longer log the pipeline decides on so much: some ten seconds of work, and a flight on one battery."""
_PAUSE_S = 1.0
"""Decisions further apart are of another stretch of the flight, or of another boot."""
_SHOWN_REASONS = 5
"""The longest ones; all are in the JSON."""


@dataclass(frozen=True)
class Engagement:
    """What the pipeline of flight decided."""

    summary: Summary
    log_s: float
    """Length of the log."""
    from_s: float
    """Boot time of the first decision."""
    from_arming: bool
    """Whether what came before the first arming was left out."""

    @property
    def whole(self) -> bool:
        """Whether it is of all of the log."""
        return self.log_s <= _DECIDED_S

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        numbers = self.summary.as_json()
        return {
            "engages": numbers["compensated_s"] > 0.0,
            "compensated_s": numbers["compensated_s"],
            "duration_s": numbers["duration_s"],
            "refusals_s": numbers["refusals_s"],
            "refusal": None,
            "from_s": round(self.from_s, 3),
            "whole_log": self.whole,
        }

    def as_text(self) -> list[str]:
        """Lines for a person; the first goes on from the name of the vehicle."""
        numbers = self.summary.as_json()
        done, duration_s = numbers["compensated_s"], numbers["duration_s"]
        stretch = f"the first {duration_s:.0f} s{' from arming on' if self.from_arming else ''}"
        if self.whole:
            head = f"would have compensated {done:.1f} of {duration_s:.1f} s" if done else "would not have engaged"
            out = [head]
        else:
            head = f"would have compensated {done:.1f} of" if done else "would not have engaged in"
            out = [f"{head} {stretch}", f"  replay run decides on all {self.log_s:.0f} s"]
        reasons = [(reason, s) for reason, s in self.summary.refusals() if s >= 0.05][:_SHOWN_REASONS]
        if self.summary.too_slow:
            out.append(f"  {self.summary.too_slow}")
        return [*out, *(f"  {s:7.1f} s held back: {reason.value}" for reason, s in reasons)]


def refused(why: str) -> dict[str, Any]:
    """The JSON of a log on which nothing can be decided."""
    return {
        "engages": False,
        "compensated_s": 0.0,
        "duration_s": 0.0,
        "refusals_s": {},
        "refusal": why,
        "from_s": None,
        "whole_log": False,
    }


def engagement(
    path: Path,
    config: PipelineConfig,
    log_s: float,
    target_system: int | None = None,
    assumed: Mapping[str, float] | None = None,
    *,
    armed: bool,
    quiet: bool = True,
) -> Engagement:
    """Decide on a log of ``log_s``; of a long one on its first minutes, from arming on where it is ``armed`` at all.

    Raises LogError where it lacks what every decision needs.
    """
    first: list[Decision] = []
    from_arming = armed and log_s > _DECIDED_S

    def watch(decisions: Iterable[Decision]) -> Iterator[Decision]:
        flown = itertools.dropwhile(lambda d: from_arming and Reason.NOT_ARMED in d.reasons, decisions)
        for decision in _first_minutes(flown, log_s, path.name, quiet=quiet):
            if not first:
                first.append(decision)
            yield decision

    report = run(path, config, "", target_system, assumed, watch=watch)
    return Engagement(report.summary, log_s, first[0].t_s if first else math.nan, from_arming)


def _first_minutes(decisions: Iterable[Decision], log_s: float, name: str, *, quiet: bool) -> Iterator[Decision]:
    """Passes decisions on, and shows how far they are."""
    bars, passed_s, last_s = Bars(quiet), 0.0, math.inf
    for decision in decisions:
        step_s, last_s = decision.t_s - last_s, decision.t_s
        passed_s += step_s if 0.0 < step_s < _PAUSE_S else 0.0
        if log_s > _DECIDED_S and passed_s > _DECIDED_S:
            break
        bars(f"{name}: deciding", round(passed_s), round(min(log_s, _DECIDED_S)))
        yield decision
    bars.close()
