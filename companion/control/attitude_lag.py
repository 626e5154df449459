"""When the tilt gives what was asked for: the attitude loop as three lags of a third of its own lag each."""

from __future__ import annotations

from companion.estimation.vectors import Level

Lags = tuple[Level, Level, Level]
"""North and east acceleration [m/s^2] behind each of the lags."""
AT_REST: Lags = ((0.0, 0.0),) * 3


def answered(lags: Lags, acceleration: Level, dt_s: float, lag_s: float) -> Lags:
    """The acceleration behind each of three first-order lags of ``lag_s`` / 3, ``dt_s`` later."""
    if dt_s > 0.0:
        share = dt_s / (lag_s / 3.0 + dt_s)
    else:
        share = 0.0
    north, east = acceleration
    behind = []
    for late_n, late_e in lags:
        north = late_n + share * (north - late_n)
        east = late_e + share * (east - late_e)
        behind.append((north, east))
    first, second, third = behind
    return first, second, third
