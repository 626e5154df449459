"""Letting go without a bump: the autopilot gets a place to stay at, or the setpoint fades to level."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.control.position_hold import BaseSetpoint, Hold
from companion.control.reasons import Reason
from companion.mavlink.firmware import ThrustMap
from companion.mavlink.setpoints import AttitudeCommand, PositionCommand
from models.common.frames import quaternion_from_euler
from models.vehicle import Vector3

NOT_OURS = frozenset({Reason.NOT_ARMED, Reason.WRONG_MODE, Reason.LANDED})
"""Refusals after which somebody else flies, or nobody does: nothing is sent."""
HAND_OVER_S = 0.5
"""Letting go takes so long: level by degrees, or the place sent to the autopilot several times."""
_STIFFNESS_1_S2 = 1.8
"""Of an autopilot's own position control: PX4's MPC_XY_P 0.95 times MPC_XY_VEL_P_ACC 1.8; ArduPilot's 1.0 times 2.0."""
_MOST_OFF_M = 0.15
_CLIMB_RATE_ZERO = 0.5
"""Thrust where ArduPilot reads it as a climb rate: neither up nor down."""


@dataclass(frozen=True, slots=True)
class HandOver:
    """The end of a hold: what was last sent, and where it was to be."""

    since_s: float
    last: BaseSetpoint
    """Offsets included."""
    place: tuple[float, float, float] | None
    """NED, or None where positions are not to be believed."""


def place_of(hold: Hold, correction_m: float) -> Vector3:
    """Where the vehicle is to stay, NED as the autopilot counts it; ``correction_m``: ``HeightDrift.correction_m``."""
    north, east, down = hold.reference.position
    return north, east, down - correction_m


def held_off(place: Vector3, lean: tuple[float, float], towards: tuple[float, float]) -> Vector3:
    """So far off a wall that the error balances its pull: the autopilot's position control begins without trim.

    Two proportional stages give the acceleration P_position P_velocity e, so e = a / (P_position P_velocity) for the
    acceleration a = ``lean`` [m/s^2] by which the tilt holds the vehicle off. ``towards``: level unit vector to it.
    """
    off = min(
        max(-(lean[0] * towards[0] + lean[1] * towards[1]), 0.0) / _STIFFNESS_1_S2, _MOST_OFF_M
    )
    return place[0] - off * towards[0], place[1] - off * towards[1], place[2]


def begin_hand_over(
    last: BaseSetpoint, refusals: set[Reason], t_s: float, listens_to_places: bool, place: Vector3
) -> HandOver | None:
    """Begin to let go to ``place``, or None where others fly."""
    if refusals & NOT_OURS:
        return None
    # A position that only does not arrive here is still known to the autopilot.
    known = listens_to_places and Reason.POSITION_UNTRUSTED not in refusals
    return HandOver(t_s, last, place if known else None)


def hand_over_command(
    hand_over: HandOver, thrust: ThrustMap, refusals: set[Reason], t_s: float
) -> AttitudeCommand | PositionCommand | None:
    """What to send while letting go; None once it is over. An attitude stream must not end with a tilt."""
    share = (t_s - hand_over.since_s) / HAND_OVER_S
    if not 0.0 <= share <= 1.0:
        return None
    last = hand_over.last
    if hand_over.place is not None:
        return PositionCommand(t_s, hand_over.place, last.yaw)
    left = max(
        1.0 - 1.25 * share, 0.0
    )  # level for the last fifth, so that a lost message leaves no tilt
    level = thrust.hover + left * (last.thrust - thrust.hover)
    if Reason.THRUST_IS_CLIMB_RATE in refusals or Reason.THRUST_UNKNOWN in refusals:
        level = _CLIMB_RATE_ZERO
    if not math.isfinite(level):
        return None
    return AttitudeCommand(
        t_s, quaternion_from_euler(left * last.roll, left * last.pitch, last.yaw), level
    )
