"""When an effect may begin or end in a flight: times that the residual suggests, for the search to weigh."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from models.common.frames import Array
from replay.residual.record import Record
from replay.search.channel import Columns
from replay.search.thresholds import (
    CHANCE,
    MOST_TIMES,
    SHORTEST_S,
)

BESIDE_S = 8.0
"""Flight that is judged before and after a time: after the start the ground lifts, and the pack is not settled."""
ABOUT_S = 2.0
"""So far before and after a suggestion it is tried as well: the search halves the steps."""
NONE_S = 0.0
"""No beginning, or no end."""


def times_of(record: Record, wrench: Array) -> list[tuple[float, float]]:
    """Beginnings and ends [s] between which ``wrench`` (n, 6) would explain most, beside itself for the whole flight.

    The best beginning without an end, the best end without a beginning, and the best pair; each with its neighbours.
    With r the residual and x the wrench, each over the residual's RMS on its axis, and sums over all axes:

        gain = (D - B C / A)^2 / (B - B^2 / A),  A = sum x^2,  C = sum x r,  B and D the same from begin to end

    is what the sum of squares loses by ``x`` between both, where ``x`` for the whole record is fitted, too
    (Frisch & Waugh 1933, Econometrica 1, 387).
    """
    own, cross = _products(record, wrench)
    rows = _looked_at(record)
    if not len(rows):
        return []
    before_own = np.concatenate([[0.0], np.cumsum(own)])
    before_cross = np.concatenate([[0.0], np.cumsum(cross)])
    edges = np.concatenate([[0], rows, [len(own)]])
    b = before_own[edges][None, :] - before_own[edges][:, None]
    d = before_cross[edges][None, :] - before_cross[edges][:, None]
    whole = max(before_own[-1], 1e-12)
    left = np.maximum(b - b**2 / whole, 1e-9 * whole)
    gain = (d - b * before_cross[-1] / whole) ** 2 / left
    judged = np.concatenate([[0.0], np.cumsum(record.valid) * record.step_s])[edges]
    long_enough = judged[None, :] - judged[:, None] > SHORTEST_S
    gain = np.where(long_enough, gain, -np.inf)
    time_s = record.time_s[rows]
    out: set[tuple[float, float]] = set()
    last = len(edges) - 1
    inner = slice(1, last)
    begin = int(gain[inner, last].argmax())
    end = int(gain[0, inner].argmax())
    both = np.unravel_index(int(gain[inner, inner].argmax()), (len(rows), len(rows)))
    out |= {(t, NONE_S) for t in _about(time_s, begin)}
    out |= {(NONE_S, t) for t in _about(time_s, end)}
    if np.isfinite(gain[inner, inner][both]):
        first, second = (int(i) for i in both)
        pairs = product(_about(time_s, first), _about(time_s, second))
        out |= {pair for pair in pairs if pair[1] - pair[0] > SHORTEST_S}
    return sorted(out)


def log_chance(record: Record, times: tuple[float, float]) -> float:
    """Log prior of a beginning and an end: each is at any time of the flight, ``ABOUT_S`` long, or there is none."""
    there = math.log(CHANCE * ABOUT_S / max(record.seconds, ABOUT_S))
    none = math.log(1.0 - CHANCE)
    chance = 0.0
    for time in times:
        if time > NONE_S:
            chance += there
        else:
            chance += none
    return chance


def _products(record: Record, wrench: Array) -> tuple[Array, Array]:
    """x^2 and x r (n,), summed over the axes."""
    valid = record.valid
    axes = list(record.axes)
    rms = np.sqrt((record.residual[valid][:, axes] ** 2).mean(axis=0))
    rms = np.maximum(rms, 1e-9)
    x = np.where(valid[:, None], wrench[:, axes], 0.0) / rms
    r = np.where(valid[:, None], np.nan_to_num(record.residual[:, axes]), 0.0) / rms
    return (x**2).sum(axis=1), (x * r).sum(axis=1)


def _looked_at(record: Record) -> Columns:
    """Rows of the times that are looked at, some flight before and after each."""
    judged = np.cumsum(record.valid) * record.step_s
    inside = np.flatnonzero((judged > BESIDE_S) & (judged < judged[-1] - BESIDE_S))
    return inside[:: max(len(inside) // MOST_TIMES, 1)]


def _about(time_s: Array, i: int) -> list[float]:
    """A time and those a little before and after it, as far as they are looked at."""
    near = (time_s[i] - ABOUT_S, time_s[i], time_s[i] + ABOUT_S)
    return [float(t) for t in near if time_s[0] <= t <= time_s[-1]]
