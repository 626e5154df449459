"""Shares with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Iterable
from math import sqrt


def wilson(hits: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a proportion (Wilson 1927).

    With p = hits / n: (p + z^2 / 2n ± z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n).
    """
    if not trials:
        return (0.0, 1.0)
    p = hits / trials
    n = float(trials)
    scale = 1.0 + z * z / n
    middle = p + z * z / (2.0 * n)
    half = z * sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
    low = (middle - half) / scale
    high = (middle + half) / scale
    return (max(0.0, low), min(1.0, high))


def share(flags: Iterable[bool]) -> str:
    """``hits/trials = x % [low, high]``."""
    values = list(flags)
    if not values:
        return "none"
    return share_of(sum(values), len(values))


def share_of(hits: int, trials: int, digits: int = 0) -> str:
    """The same of numbers, with so many digits of a percent."""
    low, high = wilson(hits, trials)
    part = hits / max(trials, 1)
    return f"{hits}/{trials} = {part:.{digits}%} [{low:.{digits}%}, {high:.{digits}%}]"
