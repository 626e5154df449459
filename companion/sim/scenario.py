"""Scenarios: where ground and wall stand, and the reference that the pilot flies."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from itertools import pairwise

from companion.sim.body import Surroundings
from companion.sim.fan_wrench import Vec
from companion.sim.sensors import BEAM_DIRECTIONS
from models.common.errors import ConfigError
from models.vehicle import Vehicle

START_HEIGHT_M = 1.2
"""Above the ground's air for every shipped vehicle."""
START_GAP_M = 1.6
"""Distance from lip to wall at the start: far outside the wall's air for every shipped vehicle."""

CREEP_M_S = 0.1
"""Speed of the last part of an approach."""
ROUNDING_S = 0.6
"""0.3 m/s within 0.6 s: 0.5 m/s^2."""


@dataclass(frozen=True)
class Waypoint:
    """A corner of the reference: reached at ``time_s`` of the script; straight and steady in between."""

    time_s: float
    towards_m: float
    """How far from the start towards the wall."""
    height_m: float
    along_m: float = 0.0
    name: str = ""
    """The phase that begins here."""


@dataclass(frozen=True)
class ScriptPoint:
    """What the pilot asks for at one instant, NED."""

    position: Vec
    velocity: Vec
    phase: str


@dataclass(frozen=True)
class Scenario:
    """A named flight."""

    name: str
    surroundings: Surroundings
    waypoints: tuple[Waypoint, ...]
    rounding_s: float = 0.0
    """The straight lines between the knots are averaged over this time: corners flown with a finite acceleration."""

    @property
    def duration_s(self) -> float:
        """Length of the script."""
        return self.waypoints[-1].time_s

    def repeated(self, times: int) -> Scenario:
        """The same script so many times in one flight."""
        long = self.duration_s
        last = self.waypoints[-1]
        again = []
        for i in range(times):
            for point in self.waypoints[:-1]:
                again.append(replace(point, time_s=point.time_s + i * long))
        end = replace(last, time_s=times * long)
        return replace(self, waypoints=(*again, end))

    def reference(self, time_s: float) -> ScriptPoint:
        """The reference at script time ``time_s``: the first knot before, the last one after."""
        azimuth = self.surroundings.wall_azimuth_rad
        c = math.cos(azimuth)
        s = math.sin(azimuth)
        (towards, height, along), (v_towards, v_height, v_along) = self._smooth(time_s)
        waypoint = self.waypoints[max(0, self._leg(time_s) - 1)]
        return ScriptPoint(
            position=(towards * c - along * s, towards * s + along * c, -height),
            velocity=(v_towards * c - v_along * s, v_towards * s + v_along * c, -v_height),
            phase=waypoint.name,
        )

    def _leg(self, time_s: float) -> int:
        """Number of knots at or before ``time_s``."""
        return bisect_right(self.waypoints, time_s, key=lambda k: k.time_s)

    def _straight(self, time_s: float) -> Vec:
        """Towards, height, along on the straight lines."""
        i = self._leg(time_s)
        a = self.waypoints[max(0, i - 1)]
        b = self.waypoints[min(i, len(self.waypoints) - 1)]
        share = 0.0
        if 0 < i < len(self.waypoints):
            share = (time_s - a.time_s) / (b.time_s - a.time_s)
        return (
            a.towards_m + share * (b.towards_m - a.towards_m),
            a.height_m + share * (b.height_m - a.height_m),
            a.along_m + share * (b.along_m - a.along_m),
        )

    def _smooth(self, time_s: float) -> tuple[list[float], list[float]]:
        """Position and velocity, averaged over ``rounding_s``: exact, since the lines are straight in between."""
        half = 0.5 * max(self.rounding_s, 1e-3)
        start = time_s - half
        end = time_s + half
        knots = [point.time_s for point in self.waypoints if start < point.time_s < end]
        times = [start, *knots, end]
        points = [self._straight(time) for time in times]
        mean = [0.0, 0.0, 0.0]
        for (t0, p0), (t1, p1) in pairwise(zip(times, points, strict=True)):
            for axis in range(3):
                mean[axis] += 0.5 * (p0[axis] + p1[axis]) * (t1 - t0) / (end - start)
        change = zip(points[0], points[-1], strict=True)
        rate = [(last - first) / (end - start) for first, last in change]
        return mean, rate


class _Script:
    """Builds knots by saying where to go and how fast."""

    def __init__(self) -> None:
        self._t = 0.0
        self._x = 0.0
        self._z = START_HEIGHT_M
        self.waypoints: list[Waypoint] = []

    def hold(self, seconds: float, name: str) -> None:
        self.waypoints.append(Waypoint(self._t, self._x, self._z, name=name))
        self._t += seconds

    def go(
        self,
        name: str,
        towards: float | None = None,
        height: float | None = None,
        speed: float = 0.3,
    ) -> None:
        x = self._x if towards is None else towards
        z = self._z if height is None else height
        self.waypoints.append(Waypoint(self._t, self._x, self._z, name=name))
        self._t += max(0.1, math.dist((x, z), (self._x, self._z)) / speed)
        self._x = x
        self._z = z

    def end(self) -> tuple[Waypoint, ...]:
        return (*self.waypoints, Waypoint(self._t, self._x, self._z, name="end"))


def wall_azimuth(vehicle: Vehicle) -> float:
    """Where the wall stands for a vehicle that points north: where its wall rangefinder looks, else to the right."""
    for sensor in vehicle.rangefinders_for("wall"):
        x, y, _ = BEAM_DIRECTIONS.get(sensor.orientation, (0.0, 1.0, 0.0))
        return math.atan2(y, x)
    return 0.5 * math.pi


def lip_reach(vehicle: Vehicle, azimuth: float) -> float:
    """How far the foremost lip stands out from the CG towards the wall [m]."""
    c = math.cos(azimuth)
    s = math.sin(azimuth)
    return max(f.position_m[0] * c + f.position_m[1] * s + f.lip_radius_m for f in vehicle.fans)


def build(name: str, vehicle: Vehicle, *, air: bool = True, turned_rad: float = 0.0) -> Scenario:
    """The scenario ``name`` for a vehicle.

    ``air`` False: same obstacles, nothing of ground or wall in the air. ``turned_rad``: from the beam of its wall
    rangefinder to the wall's normal, to the right.
    """
    r = vehicle.rotor_radius_m
    azimuth = wall_azimuth(vehicle) + turned_rad
    # Where the fans are above the CG, it flies lower.
    offset = max(0.0, -min(fan.position_m[2] for fan in vehicle.fans))
    wall = START_GAP_M + lip_reach(vehicle, azimuth)
    # The last bit is flown slowly, as one does: 0.3 m/s stops short of every surface by more than it overshoots.
    low = max(1.25 * r - offset, 0.2)
    lowish = max(low, 2.4 * r - offset, 0.35)
    near = START_GAP_M - 0.6 * r
    nearish = START_GAP_M - max(1.6 * r, 0.24)
    s = _Script()
    if name == "hover":
        s.hold(60.0, "free")
    elif name in NAMES:
        s.hold(6.0, "free")
        s.go("descend", height=lowish)
        s.go("descend", height=low, speed=CREEP_M_S)
        s.hold(4.0, "ground")
        s.go("climb", height=START_HEIGHT_M)
        s.hold(3.0, "free")
        s.go("approach", towards=nearish)
        s.go("approach", towards=near, speed=CREEP_M_S)
        s.hold(4.0, "wall")
        s.go("descend at wall", height=lowish)
        s.go("descend at wall", height=low, speed=CREEP_M_S)
        s.hold(5.0, "corner")
        s.go("climb at wall", height=START_HEIGHT_M)
        s.hold(3.0, "wall")
        s.go("retreat", towards=0.0)
        s.hold(4.0, "free")
    else:
        raise ConfigError(f"scenario '{name}' is not known; choose one of {', '.join(NAMES)}")
    surroundings = Surroundings(
        wall_m=math.inf if name in ("hover", "free") else wall,
        wall_azimuth_rad=azimuth,
        air=air and name != "free",
    )
    return Scenario(name, surroundings, s.end(), ROUNDING_S)


NAMES = ("corner", "corner_cfd", "hover", "free")
