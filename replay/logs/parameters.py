"""The autopilot's parameters as they were when the flight began, and what was changed after that."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from replay.flightlog import Interval, ParameterChange

_NAMED = 6
"""Changed parameters that a note names; the others are counted."""
_COUNTERS = (
    "STAT_",
    "MIS_TOTAL",
    "SYS_NUM_RESETS",
    "COMPASS_OFS",
    "COM_FLIGHT_UUID",
    "LND_FLIGHT_T",
)
"""Beginnings of names that the autopilot itself keeps writing: they are no setting."""
Row = tuple[float, str, float]
"""Time [s], name, value."""


def take_off(armed: Sequence[Interval]) -> float:
    """When the vehicle was first armed [s]; never where it was not: then the last values are those of the log."""
    return next((interval.start_s for interval in armed if interval.value), math.inf)


def in_force(
    rows: Iterable[Row], take_off_s: float
) -> tuple[dict[str, float], tuple[ParameterChange, ...]]:
    """Of ``rows`` in order of time the values at ``take_off_s``, and what was changed after that.

    A name that first appears later was not changed: a log may begin in the air, or with a slow list of parameters.
    """
    values: dict[str, float] = {}
    now: dict[str, float] = {}
    changes = []
    for t_s, name, value in rows:
        if t_s <= take_off_s or name not in values:
            values[name] = value
        elif value != now[name]:
            changes.append(ParameterChange(t_s, name, now[name], value))
        now[name] = value
    return values, tuple(changes)


def change_notes(changes: Iterable[ParameterChange]) -> list[str]:
    """One note on what was changed in flight."""
    said = {}
    for change in changes:
        if not change.name.startswith(_COUNTERS):
            said[change.name] = (
                f"{change.name} from {change.before:g} to {change.after:g} at {change.t_s:.0f} s"
            )
    if not said:
        return []
    first = list(said.values())[:_NAMED]
    more = len(said) - len(first)
    if more:
        rest = f" and {more} more"
    else:
        rest = ""
    return [f"changed in flight: {', '.join(first)}{rest}; read with the values at take-off"]
