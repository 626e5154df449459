"""The clock of the receiver of a .tlog, whose steps are told from the delays of the link, and taken out.

A link delays a message and then catches up. A clock that is set keeps its new difference from the autopilot's clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import Whole
from replay.logs.tlog import places_of
from replay.spill import Spool, spans, spilled

_STEP_US = 500_000
"""Links seldom hold messages back for half a second."""
_LASTING_US = 10_000_000
"""Links never delay by ten seconds."""


@dataclass(frozen=True)
class ClockStep:
    """Before the frame ``place`` of a .tlog the receiver's clock was set, ahead where ``by_us`` is above 0."""

    place: int
    by_us: int


def clock_steps(arrival_us: Whole, place: Whole, stamp_us: Whole) -> list[ClockStep]:
    """Steps of the receiver's clock in file order.

    ``arrival_us``: stamps of the receiver, shape (n,). ``place``: indices (m,) of the autopilot's stamped frames.
    ``stamp_us``: their boot times, shape (m,). A step is a jump of the smallest (arrival - stamp) that lasts.
    A clock that is set back shows it, unless the link paused for longer; otherwise the link has caught up.
    """
    latency = Spool(np.int64)
    for rows in spans(place):
        latency.append(arrival_us[place[rows]] - stamp_us[rows])
    latency_us = latency.array()
    newest_us = spilled(np.maximum.accumulate(stamp_us))
    starts = [0]
    jumps = places_of(latency_us, lambda steps: np.abs(steps) > _STEP_US)
    for start in (jumps + 1).tolist():
        end = _end_of_window(newest_us, start)
        by_us = _change(latency_us, newest_us, starts[-1], start, end)
        between_us = arrival_us[place[start - 1] : place[start] + 1]
        gone_back = np.diff(between_us).min() < 0
        if by_us > _STEP_US or (by_us < -_STEP_US and gone_back):
            starts.append(start)
    steps = []
    ends = [*starts[2:], len(place)]
    for before, start, after in zip(starts, starts[1:], ends, strict=False):
        end = min(_end_of_window(newest_us, start), after)
        by_us = _change(latency_us, newest_us, before, start, end)
        first = int(place[start - 1])
        moved_us = np.diff(arrival_us[first : place[start] + 1])
        widest = moved_us.argmax() if by_us > 0 else moved_us.argmin()
        steps.append(ClockStep(first + int(widest) + 1, by_us))
    return steps


def without_steps(arrival_us: Whole, steps: list[ClockStep]) -> Whole:
    """Stamps (n,) of a clock that was never set."""
    if not steps:
        return arrival_us
    steady_us = arrival_us.copy()
    for step in steps:
        steady_us[step.place :] -= step.by_us
    return steady_us


def _change(latency_us: Whole, newest_us: Whole, first: int, start: int, end: int) -> int:
    """The smallest latency of start <= i < ``end``, less that of the seconds before, none older than ``first``."""
    since = int(np.searchsorted(newest_us, newest_us[start - 1] - _LASTING_US))
    before_us = latency_us[max(since, first) : start].min()
    return int(latency_us[start:end].min() - before_us)


def _end_of_window(newest_us: Whole, start: int) -> int:
    """Where the seconds after ``start`` end."""
    until_us = newest_us[start] + _LASTING_US
    return int(np.searchsorted(newest_us, until_us, side="right"))
