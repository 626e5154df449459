"""Notices that the hold swings by itself: one half wave after another, alike in length, none smaller than the last."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from models.common.frozen_copy import with_changes
from models.vehicle import Vector3

_MEAN_S = 3.0
"""What lasts longer is no swing but a balance of wind or trim."""
_LEAST_M_S2 = 0.45
"""Half waves smaller than 2.6 degrees of tilt are left alone: turbulence and noise reach them."""
_SHORTEST_S = 0.15
_LONGEST_S = 2.5
"""Of a half wave: 0.2 to 3.3 Hz holds every crossover that the gains allow."""
_ALIKE = 2.2
"""Longest over shortest of the half waves of one swing."""
_KEPT = 0.9
"""Two half waves at least this share of the two before: a swing that dies out by itself is left alone."""
_HALVES = 4
"""Half waves that make a swing: two whole ones."""
_FORGET_S = 6.0
"""A half wave that lasts longer than this ends the count."""


SWING_LEVELS = 3
"""So often the gains are softened; after one more swing the hold lets go."""
_CALM_S = 120.0
"""After so long without a swing the gains go one step back; after two swings twice as long, and so on."""


class SwingAxis(NamedTuple):
    """One axis: its slow mean, and the half waves so far as (length [s], peak)."""

    mean: float = 0.0
    sign: int = 0
    since_s: float = -math.inf
    peak: float = 0.0
    halves: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class SwingDetector:
    """Axes north, east and down; how often the hold was softened, and when it last swung."""

    axes: tuple[SwingAxis, ...] = (SwingAxis(),) * 3
    level: int = 0
    swung_s: float = -math.inf
    swings: int = 0
    """All that were noticed: each doubles the calm that the next step back takes."""
    stepped_s: float = -math.inf
    """When the level last changed."""
    t_s: float = -math.inf


def watch(detector: SwingDetector, t_s: float, feedback: Vector3) -> SwingDetector:
    """Take in the acceleration [m/s^2, NED] that the hold asks for beyond its reference's own.

    Where an axis swings, ``level`` goes up by one and the half waves are counted anew.
    """
    dt = t_s - detector.t_s
    if not 0.0 < dt <= 0.5:
        return with_changes(detector, axes=SwingDetector().axes, t_s=t_s)
    axes = tuple(
        [_one(axis, t_s, dt, value) for axis, value in zip(detector.axes, feedback, strict=True)]
    )
    if not any(map(_swings, axes)):
        return with_changes(detector, axes=axes, t_s=t_s)
    return SwingDetector(
        level=detector.level + 1, swung_s=t_s, swings=detector.swings + 1, stepped_s=t_s, t_s=t_s
    )


def calmed(detector: SwingDetector, t_s: float) -> SwingDetector:
    """One level back after a calm, whose length doubles with every swing.

    A swing that a gust or a busy computer caused does not soften the hold for ever; one of the loop's own comes back
    ever more seldom. Above ``SWING_LEVELS`` the hold has let go, and nothing brings it back but another mode.
    """
    if not 0 < detector.level <= SWING_LEVELS or t_s - detector.stepped_s < _CALM_S * 2.0 ** (
        detector.swings - 1
    ):
        return detector
    return with_changes(detector, level=detector.level - 1, stepped_s=t_s)


def _one(axis: SwingAxis, t_s: float, dt: float, value: float) -> SwingAxis:
    mean, sign, since_s, peak, halves = axis
    if sign == 0:
        return SwingAxis(value, 1, t_s, 0.0)
    mean += (value - mean) * (dt / _MEAN_S)
    off = value - mean
    # A quarter of the least peak as hysteresis: noise about zero makes no half waves.
    if off * sign < -0.25 * _LEAST_M_S2:
        return SwingAxis(mean, -sign, t_s, abs(off), (*halves, (t_s - since_s, peak))[-_HALVES:])
    if t_s - since_s >= _FORGET_S:
        halves = ()
    return SwingAxis(mean, sign, since_s, off * sign if off * sign > peak else peak, halves)


def _swings(axis: SwingAxis) -> bool:
    if len(axis.halves) < _HALVES:
        return False
    lengths, peaks = zip(*axis.halves, strict=True)
    shortest = min(lengths)
    longest = max(lengths)
    alike = longest <= _ALIKE * shortest and shortest >= _SHORTEST_S and longest <= _LONGEST_S
    return bool(alike and min(peaks) >= _LEAST_M_S2 and sum(peaks[2:]) >= _KEPT * sum(peaks[:2]))
