"""A vehicle that is driven into a wall: when, and how far it leans away then."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from companion.control.plant import FULL
from companion.control.position_hold import BaseSetpoint, Motion, engage, fly
from companion.control.wall_guard import WallAhead, watch_wall
from companion.estimation.surfaces import Seen, Surface
from companion.mavlink.firmware import ThrustMap
from models.vehicle import Limits

EAST = WallAhead(0.0, 1.0, 0.0)
THRUST = ThrustMap(0.5, 1.0)


@dataclass
class Beside:
    """What the guard reads of a disturbance: a wall in the east, its distance from the lips."""

    gap_m: float
    seen: Seen = Seen.SURFACE

    @property
    def wall(self) -> Surface:
        return Surface(self.seen, self.gap_m + 0.2, normal_ned=(0.0, 1.0, 0.0))

    @property
    def d_m(self) -> np.ndarray:
        return np.array([self.gap_m, self.gap_m + 0.3])


@pytest.mark.parametrize(
    ("gap_m", "speed_m_s", "wall_ahead"),
    [
        (0.30, 0.0, False),
        (0.30, 0.3, False),
        (0.30, 0.6, True),
        (0.15, 0.3, True),
        (0.04, 0.0, True),
        (1.0, 0.8, False),
    ],
)
def test_a_wall_is_ahead_where_it_cannot_stop_before_the_wall(gap_m, speed_m_s, wall_ahead):
    assert (watch_wall(None, Beside(gap_m), (0.2, speed_m_s, 0.0), 1.0) is not None) == wall_ahead


def test_it_stays_ahead_until_it_is_clear_also_where_the_range_is_blind():
    wall_ahead = watch_wall(None, Beside(0.05), (0.0, 0.5, 0.0), 1.0)
    assert wall_ahead == WallAhead(0.0, 1.0, 1.0)
    blind = Beside(0.0, Seen.LOST)
    assert watch_wall(wall_ahead, blind, (0.0, 0.0, 0.0), 2.0) == wall_ahead
    assert watch_wall(wall_ahead, None, (0.0, 0.0, 0.0), 2.0) == wall_ahead
    assert watch_wall(wall_ahead, blind, (0.0, 0.0, 0.0), 5.0) is None
    assert watch_wall(wall_ahead, Beside(0.15), (0.0, -0.2, 0.0), 2.0) is not None
    assert watch_wall(wall_ahead, Beside(0.25), (0.0, -0.2, 0.0), 2.0) is None


def setpoint(wall: WallAhead | None, north_m: float, east_m: float) -> BaseSetpoint:
    """The first one after the vehicle was driven off by so much."""
    level = Motion((0.0,) * 3, (0.0,) * 3, (0.0, 0.0, 1.0), 0.0)
    hold = engage(0.0, level, (0.0, 0.0), THRUST.hover, THRUST)
    off = Motion((north_m, east_m, 0.0), (0.0,) * 3, (0.0, 0.0, 1.0), 0.0, wall=wall)
    return fly(hold, FULL, Limits(), 0.02, off, THRUST)[1]


def lean(s: BaseSetpoint) -> float:
    return math.degrees(math.hypot(s.roll, s.pitch))


def test_away_from_the_wall_it_leans_further_and_first():
    assert lean(setpoint(None, 1.0, 1.0)) == pytest.approx(15.0, abs=0.3)
    s = setpoint(EAST, 1.0, 1.0)
    assert math.degrees(s.roll) == pytest.approx(-24.0, abs=0.1)
    assert math.degrees(s.pitch) == pytest.approx(0.0, abs=0.1)


def test_along_the_wall_it_gets_what_is_left():
    s = setpoint(EAST, 0.6, 0.3)
    assert math.degrees(s.roll) == pytest.approx(-18.6, abs=0.3)
    assert lean(s) == pytest.approx(24.5, abs=0.5)


def test_towards_the_wall_and_within_the_limit_nothing_changes():
    for north_m, east_m in ((1.0, -1.0), (0.1, 0.1)):
        assert setpoint(EAST, north_m, east_m) == setpoint(None, north_m, east_m)
