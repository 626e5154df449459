"""By how much the autopilot's velocity differs from the slope of its own position, for seconds on end.

An estimator corrects position and velocity by different sensors, and lets them differ while these do. A hold that flies
by both rests beside its place: where the speed that closes the gap balances the difference. The place is what is held,
so over seconds the position is right, and within seconds the velocity, which is smoother:

    b' = (v - dp/dt - b) / T,    velocity used = v - b

p and v: as sent, north and east. A complementary filter (Higgins, A comparison of complementary and Kalman filtering,
IEEE Transactions on Aerospace and Electronic Systems 11(3), 1975). The height has a witness of its own, the ground
range (``height_drift``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from companion.estimation.vectors import Level, clipped, lagged
from companion.mavlink.samples import LocalPosition

_MEAN_S = 5.0
"""T, the time of the average: some swings of a hold, and short beside the minutes over which an estimator wanders."""
_MOST_M_S = 0.1
"""A larger difference is the noise of a single position."""
_GAP_S = 0.5
"""Over a longer gap the mean of two velocities says too little."""


class VelocityBias(NamedTuple):
    """What is known after one position: the bias [m/s, north and east], and what was sent."""

    bias: Level = (0.0, 0.0)
    sent: LocalPosition | None = None


def corrected(
    known: VelocityBias, sent: LocalPosition, *, set_anew: bool
) -> tuple[VelocityBias, LocalPosition]:
    """What is known one position on, and the sample with a velocity that is the slope of its position.

    ``set_anew``: the autopilot moved the origin of its positions with this one.
    """
    bias = known.bias
    before = known.sent
    if before is not None and not set_anew and 0.0 < sent.t_s - before.t_s <= _GAP_S:
        share = (sent.t_s - before.t_s) / _MEAN_S
        bias = lagged(bias, _difference(before, sent), share)
    north, east, down = sent.velocity_ned
    velocity = (north - bias[0], east - bias[1], down)
    return VelocityBias(bias, sent), replace(sent, velocity_ned=velocity)


def _difference(before: LocalPosition, after: LocalPosition) -> Level:
    """Mean velocity minus the slope of the position between two samples [m/s], north and east."""
    dt = after.t_s - before.t_s
    north = 0.5 * (before.velocity_ned[0] + after.velocity_ned[0])
    east = 0.5 * (before.velocity_ned[1] + after.velocity_ned[1])
    north = north - (after.position_ned[0] - before.position_ned[0]) / dt
    east = east - (after.position_ned[1] - before.position_ned[1]) / dt
    return clipped(north, _MOST_M_S), clipped(east, _MOST_M_S)
