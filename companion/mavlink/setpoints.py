"""Decisions as MAVLink setpoints: a unit quaternion, all three rate bits together, throttle never ignored."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.outgoing import Message, message
from companion.mavlink.samples import Quaternion
from models.vehicle import Vector3

RATES_IGNORED = 7
ATTITUDE_IGNORED = 128
"""Bits of ATTITUDE_TARGET_TYPEMASK."""
_POSITION_AND_ACCELERATION = (
    8 | 16 | 32 | 2048
)  # ignore velocity and yaw rate; bit 512 off: acceleration, not force
_POSITION_AND_YAW = 8 | 16 | 32 | 64 | 128 | 256 | 2048
_LOCAL_NED = 1
"""MAV_FRAME_LOCAL_NED; the masks above are of POSITION_TARGET_TYPEMASK."""
SET_ATTITUDE_TARGET = 82
SET_POSITION_TARGET = 84
"""Message ids."""


class AttitudeCommand(NamedTuple):
    """SET_ATTITUDE_TARGET: attitude FRD to NED, thrust 0...1, stamped with the sample's boot time."""

    t_s: float
    q_ned_frd: Quaternion
    thrust: float
    type_mask: int = RATES_IGNORED
    rates_frd: Vector3 = (0.0, 0.0, 0.0)


class PositionCommand(NamedTuple):
    """SET_POSITION_TARGET_LOCAL_NED: a place to stay at under the autopilot's own controller."""

    t_s: float
    position_ned: Vector3
    yaw: float
    acceleration_ned: Vector3 | None = None
    """Added behind PX4's velocity controller."""


Command = AttitudeCommand | PositionCommand


def tilt_by(q: Quaternion, roll: float, pitch: float) -> Quaternion:
    """Turn an attitude by small roll and pitch angles [rad] about its own body axes; returns a unit quaternion."""
    w, x, y, z = q
    cr = math.cos(roll / 2)
    sr = math.sin(roll / 2)
    cp = math.cos(pitch / 2)
    sp = math.sin(pitch / 2)
    ow = cr * cp
    ox = sr * cp
    oy = cr * sp
    oz = sr * sp
    out = (
        w * ow - x * ox - y * oy - z * oz,
        w * ox + x * ow + y * oz - z * oy,
        w * oy - x * oz + y * ow + z * ox,
        w * oz + x * oy - y * ox + z * ow,
    )
    size = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3])
    if not math.isfinite(size) or size < 1e-6:
        return q
    return (out[0] / size, out[1] / size, out[2] / size, out[3] / size)


def whole_rate_mask(type_mask: int) -> int:
    """A partial rate mask re-initialises ArduPilot's GUIDED at every message: ignore all rates or none."""
    if type_mask & RATES_IGNORED:
        return type_mask | RATES_IGNORED
    return type_mask


def encode(command: Command, system: int) -> Message:
    """Message id and payload of a command, addressed to the autopilot of a system."""
    boot_ms = round(max(command.t_s, 0.0) * 1000.0) & 0xFFFFFFFF
    if isinstance(command, AttitudeCommand):
        mask = whole_rate_mask(command.type_mask) & (RATES_IGNORED | ATTITUDE_IGNORED)
        thrust = min(max(command.thrust, 0.0), 1.0)
        return message(
            SET_ATTITUDE_TARGET,
            boot_ms,
            *command.q_ned_frd,
            *command.rates_frd,
            thrust,
            system,
            AUTOPILOT_COMPONENT,
            mask,
        )
    if command.acceleration_ned is None:
        mask = _POSITION_AND_YAW
    else:
        mask = _POSITION_AND_ACCELERATION
    acceleration = command.acceleration_ned or (0.0, 0.0, 0.0)
    return message(
        SET_POSITION_TARGET,
        boot_ms,
        *command.position_ned,
        0.0,
        0.0,
        0.0,
        *acceleration,
        command.yaw,
        0.0,
        mask,
        system,
        AUTOPILOT_COMPONENT,
        _LOCAL_NED,
    )
