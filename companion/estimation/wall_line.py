"""The direction of a wall, by the places on it that one beam has met.

A single beam says how far the wall is along the beam. At first it is taken for square to the beam. Where the vehicle
passes along it, turns, or comes nearer on another way than along the beam, the places show how the wall runs.

The wall is a straight line in the level plane. With x square to the beam and y along it, the state is y and the slope
s = dy/dx: a track of constant slope, with the way dx in the place of time,

    y' = y + s dx,    P' = F P F' + Q,    F = [[1, dx], [0, 1]],

and a place on the wall measures y (Kalman 1960, J. Basic Eng. 82; equal by test to the filter that filterpy designs).
The noise of a range lies along the beam, so x is taken as it is: across the estimated wall, the noise itself would look
like a slope. Q lets positions wander with time and walls bend with the way. A position that drifts while the vehicle
stays where it is moves y alone: it says nothing about the direction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from models.vehicle import Vector3

_PLACE_M = 0.03
"""Standard deviation of a place: a range's noise, and that of a position."""
_WANDER_M = 0.02
"""Positions wander so far in a second: the square grows with the time."""
_BEND_RAD = 0.1
"""A wall bends so much in a metre."""
_SLOPE = 0.3
"""Standard deviation of the slope before any place says it: pilots face a wall within 17 degrees, mostly."""
_NEAR_M = 0.25
"""Two readings of one wall are no further apart across it. Else a position leapt, or it is another wall."""
_MOST_RAD = math.radians(60.0)
"""A beam that meets a wall more flatly returns nothing: such a direction is not believed."""


class WallLine(NamedTuple):
    """A wall: one place on it [m], the bearing of its normal [rad], NED, and what is known of both."""

    north: float
    east: float
    bearing_rad: float
    t_s: float
    variance: float = _PLACE_M**2
    """Of y [m^2]."""
    covariance: float = 0.0
    """Of y and the slope."""
    slope_variance: float = _SLOPE**2

    def seen_along(self, beam_ned: Vector3) -> Vector3 | None:
        """Level unit vector towards the wall; None where the beam could not have met such a wall.

        Of an angle to the beam that is no larger than its standard deviation little is believed: its share
        angle^2 / (angle^2 + sd^2) makes the expected square of the error least (Wiener).
        """
        beam_rad = math.atan2(beam_ned[1], beam_ned[0])
        angle = math.remainder(self.bearing_rad - beam_rad, math.tau)
        if abs(angle) > _MOST_RAD:
            return None
        square = angle * angle
        turned = beam_rad + angle * square / (square + self.slope_variance)
        return (math.cos(turned), math.sin(turned), 0.0)

    def near(self, place_ned: Vector3) -> bool:
        """Whether a place may be on this wall."""
        north = place_ned[0] - self.north
        east = place_ned[1] - self.east
        off = math.cos(self.bearing_rad) * north + math.sin(self.bearing_rad) * east
        return abs(off) <= _NEAR_M

    def through(self, place_ned: Vector3, t_s: float) -> WallLine:
        """A wall of the same direction through a place: what was known of the old place says nothing of it."""
        return WallLine(
            north=place_ned[0],
            east=place_ned[1],
            bearing_rad=self.bearing_rad,
            t_s=t_s,
            slope_variance=self.slope_variance,
        )

    def shifted(self, by_ned: Vector3) -> WallLine:
        """The same wall after the origin of positions moved."""
        return self._replace(north=self.north + by_ned[0], east=self.east + by_ned[1])


def square_to(beam_ned: Vector3, place_ned: Vector3, t_s: float) -> WallLine:
    """A wall of which one place is known."""
    bearing_rad = math.atan2(beam_ned[1], beam_ned[0])
    return WallLine(north=place_ned[0], east=place_ned[1], bearing_rad=bearing_rad, t_s=t_s)


def met(line: WallLine, beam_ned: Vector3, place_ned: Vector3, t_s: float) -> WallLine:
    """The wall after one more place, that a beam met on it."""
    beam_rad = math.atan2(beam_ned[1], beam_ned[0])
    c = math.cos(beam_rad)
    s = math.sin(beam_rad)
    north = place_ned[0] - line.north
    east = place_ned[1] - line.east
    dx = -s * north + c * east
    # A wall that goes further away to the right has its normal turned to the left of the beam.
    slope = math.tan(beam_rad - line.bearing_rad)
    off = c * north + s * east - slope * dx
    # Predict.
    variance = line.variance + 2.0 * dx * line.covariance + dx * dx * line.slope_variance
    variance += _WANDER_M**2 * max(t_s - line.t_s, 0.0)
    covariance = line.covariance + dx * line.slope_variance
    slope_variance = line.slope_variance + _BEND_RAD**2 * abs(dx)
    # Correct.
    innovation = variance + _PLACE_M**2
    gain = variance / innovation
    slope_gain = covariance / innovation
    y = slope * dx + gain * off
    return WallLine(
        north=line.north - s * dx + c * y,
        east=line.east + c * dx + s * y,
        bearing_rad=beam_rad - math.atan(slope + slope_gain * off),
        t_s=t_s,
        variance=(1.0 - gain) * variance,
        covariance=(1.0 - gain) * covariance,
        slope_variance=max(slope_variance - slope_gain * covariance, 0.0),
    )
