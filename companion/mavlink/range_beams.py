"""Rangefinder messages: where a beam points, and what a reading is worth."""

from __future__ import annotations

import math

from companion.mavlink.dialect import mavlink
from companion.mavlink.samples import Quaternion, RangeVerdict
from companion.mavlink.wire_layout import unit_quaternion
from models.vehicle import Vector3

DOWN = (0.0, 0.0, 1.0)


def dot(a: Vector3, b: Vector3) -> float:
    """Scalar product; of two beams the cosine of the angle between them."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


CUSTOM_ORIENTATION = 100
"""MAV_SENSOR_ROTATION_CUSTOM: the quaternion has the direction."""


LOW_QUALITY_BELOW = 10
"""signal_quality is 1 (invalid) to 100 (best); 0 is "not given"."""


_PREFIX = "MAV_SENSOR_ROTATION_"


def _beam(name: str) -> Vector3:
    """Beam of an orientation by its name, such as ``ROLL_90_PITCH_68_YAW_293``; roll does not turn a beam."""
    words = name.removeprefix(_PREFIX).split("_")
    angles = dict(zip(words[::2], words[1::2], strict=False))
    pitch, yaw = (math.radians(float(angles.get(axis, 0))) for axis in ("PITCH", "YAW"))
    # + 0.0 turns -0.0 into 0.0; rounding takes the 1e-17 out of cos 90 deg.
    x = math.cos(pitch) * math.cos(yaw)
    y = math.cos(pitch) * math.sin(yaw)
    z = -math.sin(pitch)
    return (round(x, 15) + 0.0, round(y, 15) + 0.0, round(z, 15) + 0.0)


_BEAMS = {
    value: _beam(entry.name)
    for value, entry in mavlink.enums["MAV_SENSOR_ORIENTATION"].items()
    if entry.name.startswith(_PREFIX) and value != CUSTOM_ORIENTATION
}


def orientation_direction(orientation: int) -> Vector3 | None:
    """Unit beam (FRD) of a MAV_SENSOR_ORIENTATION: Rz(yaw) Ry(pitch) (1, 0, 0). None for CUSTOM and unknown values."""
    return _BEAMS.get(orientation)


def beam_direction(orientation: int, quaternion: Quaternion) -> Vector3 | None:
    """Unit beam (FRD) of a DISTANCE_SENSOR; a CUSTOM one by its quaternion. None where it cannot be resolved."""
    if orientation != CUSTOM_ORIENTATION:
        return _BEAMS.get(orientation)
    q = unit_quaternion(quaternion)
    if q is None:
        return None
    w, x, y, z = q
    return (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))


def range_verdict(
    distance_m: float, min_m: float, max_m: float, quality: int, mapped: bool
) -> RangeVerdict:
    """What a reading is worth by itself. Sensors say "nothing" with 0, their minimum, their maximum or more."""
    if not mapped:
        return RangeVerdict.UNMAPPED
    if distance_m <= 0.0 or distance_m <= min_m:
        return RangeVerdict.BELOW_MIN
    if distance_m >= max_m:
        return RangeVerdict.ABOVE_MAX
    if 0 < quality < LOW_QUALITY_BELOW:
        return RangeVerdict.LOW_QUALITY
    return RangeVerdict.OK
