"""Sensors that go wrong in flight: what the firmware is told instead of the truth.

A file of JSON says what is wrong from now on. The physics reads it ten times a second, so that a
script can change it in flight.
"""

from __future__ import annotations

import json
import math
import random
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path

from companion.sim.body import Body
from companion.sim.fan_wrench import Vec
from companion.sim.sensors import OUT_OF_RANGE_M, RANGE_MIN_M

_LOOK_S = 0.1
_SUN_LOST = 0.5
_SUN_SD_M = 0.1
"""Sunlight on a surface: half of the readings are none, the others are noise [1, m]."""


class Range(Enum):
    """What a rangefinder does wrong besides an offset."""

    RIGHT = "right"
    FROZEN = "frozen"
    LOST = "lost"
    SUN = "sun"


@dataclass(frozen=True, kw_only=True)
class Wrong:
    """What is wrong from one instant on. Positions are those that the estimator is given, NED."""

    position_off_m: Vec = (0.0, 0.0, 0.0)
    position_drift_m_s: Vec = (0.0, 0.0, 0.0)
    position_frozen: bool = False
    position_turned_deg: float = 0.0
    """Ways flown since then are turned about the vertical."""
    wall_range: Range = Range.RIGHT
    wall_range_off_m: float = 0.0
    wall_range_drift_m_s: float = 0.0
    wall_range_drift_most_m: float = 0.4
    ground_range: Range = Range.RIGHT
    gust_m_s: Vec = (0.0, 0.0, 0.0)


NOTHING_WRONG = Wrong()


def write(path: Path, wrong: Wrong) -> None:
    """What is wrong from now on."""
    fields = asdict(wrong)
    for name in ("wall_range", "ground_range"):
        fields[name] = fields[name].value
    new = path.with_suffix(".new")
    new.write_text(json.dumps(fields), encoding="utf-8")
    new.replace(path)


def read(path: Path) -> Wrong:
    """The same, read again."""
    fields = json.loads(path.read_text(encoding="utf-8"))
    for name in ("wall_range", "ground_range"):
        fields[name] = Range(fields[name])
    for name in ("position_off_m", "position_drift_m_s", "gust_m_s"):
        fields[name] = tuple(fields[name])
    return Wrong(**fields)


class WrongSensors:
    """Stands between the body and what the firmware is told."""

    def __init__(self, path: Path | None = None, seed: int = 0) -> None:
        self._path = path
        self._next_look_s = 0.0
        self._changed_ns = 0
        self._rng = random.Random(f"wrong sensors {seed}")
        self._since_s = 0.0
        self._place: Vec = (0.0, 0.0, 0.0)
        self._told: dict[str, float] = {}
        self.wrong = NOTHING_WRONG

    def look(self, body: Body) -> None:
        """Read the file where it has changed."""
        if self._path is None or body.time_s < self._next_look_s:
            return
        self._next_look_s = body.time_s + _LOOK_S
        try:
            changed_ns = self._path.stat().st_mtime_ns
        except FileNotFoundError:
            return
        if changed_ns != self._changed_ns:
            self._changed_ns = changed_ns
            self.begin(read(self._path), body)

    def begin(self, wrong: Wrong, body: Body) -> None:
        """``wrong`` counts from this instant."""
        self.wrong = wrong
        self._since_s = body.time_s
        self._place = (body.position[0], body.position[1], body.position[2])

    def motion(self, body: Body) -> tuple[Vec, Vec]:
        """Position and velocity NED as the estimator is told."""
        wrong = self.wrong
        if wrong.position_frozen:
            return self._place, (0.0, 0.0, 0.0)
        seconds = body.time_s - self._since_s
        c = math.cos(math.radians(wrong.position_turned_deg))
        s = math.sin(math.radians(wrong.position_turned_deg))
        north, east, down = body.position
        flown_north = north - self._place[0]
        flown_east = east - self._place[1]
        vn, ve, vd = body.velocity
        off = wrong.position_off_m
        drift = wrong.position_drift_m_s
        position = (
            self._place[0] + c * flown_north - s * flown_east + off[0] + drift[0] * seconds,
            self._place[1] + s * flown_north + c * flown_east + off[1] + drift[1] * seconds,
            down + off[2] + drift[2] * seconds,
        )
        velocity = (c * vn - s * ve + drift[0], s * vn + c * ve + drift[1], vd + drift[2])
        return position, velocity

    def range_m(self, target: str, reading_m: float, body: Body) -> float:
        """What a rangefinder that looks at ``target`` reports where it should report ``reading_m``."""
        wrong = self.wrong
        if target == "wall":
            fault = wrong.wall_range
        else:
            fault = wrong.ground_range
        if fault is Range.FROZEN:
            return self._told.setdefault(target, reading_m)
        self._told[target] = reading_m
        if fault is Range.LOST:
            return OUT_OF_RANGE_M
        if fault is Range.SUN:
            if self._rng.random() < _SUN_LOST:
                return OUT_OF_RANGE_M
            return max(RANGE_MIN_M, reading_m + self._rng.gauss(0.0, _SUN_SD_M))
        if target != "wall" or reading_m >= OUT_OF_RANGE_M:
            return reading_m
        most = wrong.wall_range_drift_most_m
        drifted = wrong.wall_range_drift_m_s * (body.time_s - self._since_s)
        return max(RANGE_MIN_M, reading_m + wrong.wall_range_off_m + max(-most, min(most, drifted)))
