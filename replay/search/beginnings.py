"""When an effect may begin or end in a flight: times that the residual suggests, for the search to weigh."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from models.common.frames import Array
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.channel import Columns
from replay.search.thresholds import CHANCE, MOST_TIMES, SHORTEST_S

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
    rows = _rows_of_times(record)
    if not len(rows):
        return []
    time_s = record.time_s[rows]
    gain = _gains(record, wrench, rows)
    last = len(rows) + 1
    inner = slice(1, last)
    begin = int(gain[inner, last].argmax())
    end = int(gain[0, inner].argmax())
    of_pairs = gain[inner, inner]
    first, second = divmod(int(of_pairs.argmax()), len(rows))
    out: set[tuple[float, float]] = set()
    out |= {(t, NONE_S) for t in _about(time_s, begin)}
    out |= {(NONE_S, t) for t in _about(time_s, end)}
    if np.isfinite(of_pairs[first, second]):
        pairs = product(_about(time_s, first), _about(time_s, second))
        out |= {pair for pair in pairs if pair[1] - pair[0] > SHORTEST_S}
    return sorted(out)


def _gains(record: Record, wrench: Array, rows: Columns) -> Array:
    """Gain (e, e) from every edge to every later one, -inf where that is too short.

    Edges are the start of the record, its ``rows``, and its end.
    """
    own, cross = _products(record, wrench)
    edges = np.concatenate([[0], rows, [len(own)]])
    a = max(_sum_before(own)[-1], 1e-12)
    b = _between(own, edges)
    c = _sum_before(cross)[-1]
    d = _between(cross, edges)
    left = np.maximum(b - b**2 / a, 1e-9 * a)
    gain = (d - b * c / a) ** 2 / left
    seconds = _sum_before(record.valid) * record.step_s
    at_edges = seconds[edges]
    long_enough = at_edges[None, :] - at_edges[:, None] > SHORTEST_S
    return np.where(long_enough, gain, -np.inf)


def _sum_before(x: Array | Mask) -> Array:
    """Sum (n + 1,) of what is before each sample, and of all."""
    return np.concatenate([[0.0], np.cumsum(x)])


def _between(x: Array, edges: Columns) -> Array:
    """Sum (e, e) from every edge to every other."""
    before = _sum_before(x)[edges]
    return np.asarray(before[None, :] - before[:, None])


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
    axes = list(record.axes)
    valid = record.valid[:, None]
    residual = record.residual[:, axes]
    mean_square = (residual[record.valid] ** 2).mean(axis=0)
    rms = np.maximum(np.sqrt(mean_square), 1e-9)
    x = np.where(valid, wrench[:, axes], 0.0) / rms
    r = np.where(valid, np.nan_to_num(residual), 0.0) / rms
    return (x**2).sum(axis=1), (x * r).sum(axis=1)


def _rows_of_times(record: Record) -> Columns:
    """Rows of the times that are looked at, some flight before and after each."""
    judged = np.cumsum(record.valid) * record.step_s
    inside = np.flatnonzero((judged > BESIDE_S) & (judged < judged[-1] - BESIDE_S))
    return inside[:: max(len(inside) // MOST_TIMES, 1)]


def _about(time_s: Array, i: int) -> list[float]:
    """A time and those a little before and after it, as far as they are looked at."""
    near = (time_s[i] - ABOUT_S, time_s[i], time_s[i] + ABOUT_S)
    return [float(t) for t in near if time_s[0] <= t <= time_s[-1]]
