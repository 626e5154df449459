"""Whether the autopilot's own estimator stands behind the position it sends, and whether it set it anew."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.mavlink.samples import EstimatorStatus, LocalPosition
from models.vehicle import Vector3

# EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS (MAVLink common, ardupilotmega) agree in these.
_ATTITUDE = 1
_VELOCITY_HORIZONTAL = 2
_VELOCITY_VERTICAL = 4
_POSITION_RELATIVE = 8
_POSITION_ABSOLUTE = 16
_HEIGHT_ABSOLUTE = 32
_HEIGHT_OVER_GROUND = 64
_NO_POSITION_AIDING = 128  # CONST_POS_MODE: the estimator assumes that the vehicle stands still
_UNINITIALISED, _GPS_GLITCHING = (
    1024,
    32768,
)  # ArduPilot's; 1024 is GPS_GLITCH on PX4, which comes and goes in flight
_NEEDED = _ATTITUDE | _VELOCITY_HORIZONTAL | _VELOCITY_VERTICAL
_GROWTH = 4.0
"""PX4 sends a dead-reckoned position for 5 s before it clears its flags; its accuracy grows from the first second."""
_FORGOTTEN_M_S = 0.01
"""The best accuracy is forgotten so fast. On optical flow alone PX4's grows for ever, by n h sqrt(t / f) at h metres:
EKF2_OF_N_MIN n = 0.15 rad/s and f = 20 Hz make 0.3 m in 20 s at 2 m. Without any sensor it grows by 0.1 m/s."""
_ACCURACY_M = 0.3
"""Up to here a growing accuracy is no dead reckoning yet."""
_INNOVATION = 1.0
"""Test ratio from which an estimator rejects its measurements."""
_RESET_M = 0.1
_RESET_M_S = 1.0
"""A jump past what the velocity explains: this, and as much for each second between two positions. A gentler one is the
estimator pulled to its sensors: at most 0.07 m in 0.1 s in five real flights, 0.01 m in 0.02 s in simulation."""
_RESET_WITHIN_S = 0.5
"""Two and a half positions at 5 Hz; over a longer gap a velocity says too little."""


@dataclass(frozen=True, slots=True)
class PositionTrust:
    """Whether the newest estimator status is trusted, and the best accuracy so far. Nothing heard is trusted."""

    best_accuracy_m: float = math.inf
    t_s: float = -math.inf
    """Of the newest status."""
    trusted: bool = True
    """False while the estimator lacks what a position needs, coasts without a sensor, or rejects its sensors."""

    def after(self, status: EstimatorStatus) -> PositionTrust:
        """After one more status."""
        accuracy = status.horizontal_accuracy_m
        best = self.best_accuracy_m + _FORGOTTEN_M_S * max(status.t_s - self.t_s, 0.0)
        if accuracy > 0.0:
            best = min(best, accuracy)
        return PositionTrust(best, status.t_s, _trusted(status, best))


def _trusted(status: EstimatorStatus, best_accuracy_m: float) -> bool:
    flags = status.flags
    ardupilot = status.source == "EKF_STATUS_REPORT"
    if flags & _NEEDED != _NEEDED or flags & _NO_POSITION_AIDING:
        return False
    if not flags & (_POSITION_RELATIVE | _POSITION_ABSOLUTE):
        return False
    if not flags & (_HEIGHT_ABSOLUTE | _HEIGHT_OVER_GROUND):
        return False
    if ardupilot and flags & (_UNINITIALISED | _GPS_GLITCHING):
        return False
    grown = status.horizontal_accuracy_m > max(_ACCURACY_M, _GROWTH * best_accuracy_m)
    return not grown and not status.innovation > _INNOVATION


@dataclass(frozen=True, slots=True)
class PositionReset:
    """The estimator set its position anew at ``t_s``: by how much, NED [m]."""

    t_s: float
    by_ned: Vector3


def position_reset(before: LocalPosition, after: LocalPosition) -> PositionReset | None:
    """The jump between two positions that their velocities do not explain, or None."""
    dt = after.t_s - before.t_s
    if not 0.0 < dt <= _RESET_WITHIN_S:
        return None
    jump = [
        p1 - p0 - 0.5 * (v0 + v1) * dt
        for p0, p1, v0, v1 in zip(
            before.position_ned,
            after.position_ned,
            before.velocity_ned,
            after.velocity_ned,
            strict=True,
        )
    ]
    if math.hypot(*jump) <= _RESET_M + _RESET_M_S * dt:
        return None
    return PositionReset(after.t_s, (jump[0], jump[1], jump[2]))
