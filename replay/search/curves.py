"""Free curves: an unknown force along one axis that follows one logged channel. What no effect of the catalogue is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from models.common.frames import AXES, Array
from replay.residual.record import Record
from replay.search.thresholds import CLOSEST, LEAST_TURN_RAD, ODDS, REACTION_ODDS
from replay.search.time_courses import TimeCourse, time_courses

KNOTS = 7
"""Of a curve: so many evenly over the channel's range, and as many on its quantiles."""
PLACE = ("north_m", "east_m", "down_m")
MOST_KNOTS = 32
"""Channels that say where the vehicle is, and even knots over them at most. A force that stays at a place has
two of them for the length of an arm: over less than that the rotors take the mean."""
LENGTH = 0.5
"""Correlation length of a curve, as a share of the channel's range."""
FELT = ("ax_m_s2", "ay_m_s2", "az_m_s2")
"""Channels of the accelerometer: what it reads is force, and causes none."""
SAME_SENSOR = {"p_rad_s": "Mx", "q_rad_s": "My", "r_rad_s": "Mz"}
"""Channels whose own noise is in the residual of an axis, and that axis."""
LEANS = {"pitch_rad": "Fx", "roll_rad": "Fy"}
"""Angles by which a vehicle that holds its place leans against a force, and its axis: they follow every such force."""
REACTIONS = {
    "Fx": ("vn_", "ve_", "roll", "q_", "servo", "rpm", "thrust", "battery_current"),
    "Fy": ("vn_", "ve_", "pitch", "p_", "servo", "rpm", "thrust", "battery_current"),
    "Fz": ("vd_", "servo", "rpm", "thrust", "battery_current"),
    "Mx": ("roll", "pitch", "p_", "q_", "r_", "servo", "rpm", "thrust", "ve_", "vn_"),
    "My": ("pitch", "roll", "p_", "q_", "r_", "servo", "rpm", "thrust", "ve_", "vn_"),
    "Mz": ("p_", "q_", "r_", "servo", "rpm", "thrust"),
}
"""Channels that respond to a disturbance of that axis within the loop, and vary with its noise.

The pack's current does; its voltage also falls with the charge, which makes it a cause.
"""
DRIFTS = ("north_m", "east_m", "down_m", "yaw_rad", "range_")
"""Channels that nothing but disturbances move in a flight that only hovers: a curve is as likely as commands are."""
ATTITUDE = ("roll_rad", "pitch_rad")
"""Channels that go with the speed in steady flight: what drag explains is none of theirs."""
FEWEST = 50
"""Samples of a channel without which no curve is laid through it."""


@dataclass(frozen=True)
class CarryingChannel:
    """A channel that carries part of the remainder: ``score`` is its share of the energy of ``axis``."""

    name: str
    score: float
    axis: str
    course: TimeCourse | None = None
    """Where the force follows time alone."""


@dataclass(frozen=True)
class Curve:
    """Columns (n,) a flight of one channel on one axis, prior N(0, 1) each, and its prior odds."""

    name: str
    axis: int
    parts: tuple[Array | None, ...]
    odds: float
    """True odds, p / (1 - p)."""
    course: TimeCourse | None = None
    """Of a curve over time that is no smooth one."""


def curves(records: Sequence[Record]) -> Iterator[Curve]:
    """Every curve that may stand for an unknown force."""
    names: dict[str, None] = {}
    axes: set[int] = set()
    for record in records:
        names |= dict.fromkeys(record.channels)
        axes |= set(record.axes)
    for name in names:
        if name in FELT or (name == "time_s" and len(records) > 1):
            continue
        bases = _bases(records, name)
        for axis in sorted(axes):
            odds = _odds(name, AXES[axis], records)
            if odds is None:
                continue
            courses = time_courses(records[0], axis) if name == "time_s" else ()
            odds_of_each = odds / max(len(bases) + len(courses), 1)
            for basis in bases:
                yield Curve(name, axis, basis, odds_of_each)
            for course, columns in courses:
                basis = (_centred(columns, records[0]),)
                yield Curve(name, axis, basis, odds_of_each, course)


def _odds(name: str, axis: str, records: Sequence[Record]) -> float | None:
    """Of a curve; None where there can be none."""
    if SAME_SENSOR.get(name) == axis or LEANS.get(name) == axis:
        return None
    vanes = {f"servo_{vane.servo}" for vane in records[0].context.vehicle.vanes}
    # Vanes do not change lift.
    answers_lift = axis == "Fz" and name in vanes
    if name.startswith(REACTIONS[axis]) and not answers_lift:
        if axis.startswith("F"):
            return REACTION_ODDS
        return None
    if name.startswith(DRIFTS):
        return ODDS * max(r.context.if_commanded(1.0) for r in records)
    return ODDS


def _bases(records: Sequence[Record], name: str) -> list[tuple[Array | None, ...]]:
    """Smooth curves over the channel's range (n, k) a flight, less their mean, of every spacing of their knots."""
    known = _known(records, name)
    if len(known) < FEWEST:
        return []
    if name == "yaw_rad":
        if np.ptp(np.unwrap(known)) < LEAST_TURN_RAD:
            return []
        return [_of_flights(_of_heading, records, name)]
    low, high = np.quantile(known, [0.01, 0.99])
    if high - low < 1e-9:
        return []
    out = []
    for even in _knots(high - low, name, records):
        smooth = _of_range(known, even)
        out.append(_of_flights(smooth, records, name))
    return out


def _known(records: Sequence[Record], name: str) -> Array:
    """Valid values of a channel on all flights that have it."""
    out = []
    for record in records:
        values = record.channels.get(name)
        if values is not None:
            out.append(values[record.valid & np.isfinite(values)])
    return np.concatenate(out)


def _of_flights(
    smooth: Callable[[Array], Array], records: Sequence[Record], name: str
) -> tuple[Array | None, ...]:
    """A curve over a channel on every flight; None where a flight lacks it."""
    out: list[Array | None] = []
    for record in records:
        values = record.channels.get(name)
        if values is None:
            out.append(None)
        else:
            out.append(_centred(smooth(values), record))
    return tuple(out)


def _of_heading(yaw: Array) -> Array:
    """sin and cos of the heading and of twice the heading, (n, 4)."""
    return np.stack([np.sin(yaw), np.cos(yaw), np.sin(2 * yaw), np.cos(2 * yaw)], axis=1)


def _knots(reach: float, name: str, records: Sequence[Record]) -> list[int]:
    """How many knots stand evenly over a range: few, and over the place as many as the vehicle tells apart, too."""
    if name not in PLACE:
        return [KNOTS]
    arm = max(r.context.lever for r in records)
    two_an_arm = int(np.clip(2.0 * reach / arm, KNOTS, MOST_KNOTS))
    return sorted({KNOTS, two_an_arm})


def _of_range(known: Array, even: int) -> Callable[[Array], Array]:
    """Curves H L (n, k) over the channel whose values are ``known``, with ``even`` knots evenly over their range.

    H interpolates between knots x, L L^T = K, K_ij = exp(-|x_i - x_j| / l): a Gaussian process with the
    Ornstein-Uhlenbeck kernel (Rasmussen & Williams 2006, ch. 4).
    """
    low, high = np.quantile(known, [0.01, 0.99])
    reach = high - low
    evenly = np.linspace(low, high, even)
    by_quantile = np.quantile(known, np.linspace(0.01, 0.99, KNOTS))
    knots = np.union1d(evenly, by_quantile)
    apart = np.diff(knots) > CLOSEST * reach
    knots = knots[np.concatenate([[True], apart])]
    distance = np.abs(knots[:, None] - knots) / (LENGTH * reach)
    identity = np.eye(len(knots))
    factor = np.linalg.cholesky(np.exp(-distance) + 1e-9 * identity)
    usual = np.median(known)

    def smooth(values: Array) -> Array:
        values = np.where(np.isfinite(values), values, usual)
        values = np.clip(values, low, high)
        hats = [np.interp(values, knots, of_knot) for of_knot in identity]
        return np.asarray(np.stack(hats, axis=1) @ factor)

    return smooth


def _centred(x: Array, record: Record) -> Array:
    x = np.nan_to_num(x)
    return np.asarray(x - x[record.valid].mean(axis=0))
