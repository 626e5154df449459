"""By which names a quantity goes in each log format: MAVLink messages, dataflash messages, uORB topics."""

from __future__ import annotations

from pathlib import Path

from models.common.errors import LogError
from replay.logs.formats import suffix_of

_TLOG = {
    "imu": "HIGHRES_IMU, RAW_IMU or SCALED_IMU",
    "attitude": "ATTITUDE or ATTITUDE_QUATERNION",
    "rotor speeds": "ESC_TELEMETRY, ESC_STATUS or RPM",
    "outputs": "SERVO_OUTPUT_RAW",
    "position": "LOCAL_POSITION_NED",
    "range": "DISTANCE_SENSOR (or RANGEFINDER)",
    "parameters": "PARAM_VALUE",
    "heartbeat": "HEARTBEAT of the autopilot (component 1)",
}
_BIN = {
    "imu": "IMU (or ACC and GYR)",
    "attitude": "ATT",
    "rotor speeds": "ESC or RPM",
    "outputs": "RCOU",
    "position": "XKF1 (or NKF1)",
    "range": "RFND",
    "parameters": "PARM",
    "heartbeat": "MODE",
}
_ULG = {
    "imu": "sensor_combined",
    "attitude": "vehicle_attitude",
    "rotor speeds": "esc_status",
    "outputs": "actuator_outputs",
    "position": "vehicle_local_position",
    "range": "distance_sensor",
    "parameters": "parameters",
    "heartbeat": "vehicle_status",
}
_OF_FORMAT = {".tlog": _TLOG, ".bin": _BIN, ".log": _BIN, ".ulg": _ULG}
"""``.log`` is a dataflash log as text."""


def called(path: Path, quantity: str) -> str:
    """The messages or topics of a log of this format that carry ``quantity``, a key of the tables above."""
    try:
        suffix = suffix_of(path)
    except LogError:
        suffix = path.suffix.lower()
    names = _OF_FORMAT.get(suffix, _TLOG)
    return names[quantity]
