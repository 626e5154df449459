"""Which setting of ArduPilot or PX4 puts a missing quantity into a log."""

from __future__ import annotations

from replay.flightlog import FlightLog
from replay.logs.formats import suffix_of

ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT."""

# SRx_ is MAVx_ from ArduPilot 4.7 on; x is the number of the link.
_TLOG_ARDUPILOT = {
    "imu": "SRx_RAW_SENS 50, or SET_MESSAGE_INTERVAL of HIGHRES_IMU (105)",
    "attitude": "SRx_EXTRA1 50",
    "position": "SRx_POSITION 20, and a position estimate (GPS, optical flow or external vision)",
    "range": "RNGFNDn_TYPE, RNGFNDn_ORIENT (25 down, 0 ahead, 2 right) and SRx_EXTRA3 20",
    "rpm": "SERVO_BLH_AUTO 1 with SERVO_BLH_TRATE 50 (or bidirectional DShot: SERVO_BLH_BDMASK) and SRx_EXTRA1 50",
    "servo": "SRx_RC_CHAN 50",
    "battery": "BATT_MONITOR and SRx_EXT_STAT 2",
    "pressure": "SRx_RAW_SENS 2 or more",
    "temperature": "ESCs that report it, SERVO_BLH_AUTO 1 and SRx_EXTRA1 20",
    "thrust": "SET_MESSAGE_INTERVAL of ATTITUDE_TARGET (83); companion asks for it",
    "parameters": "a ground station or companion on the link: it asks for the parameters",
}
_BIN = {
    "imu": "LOG_BITMASK with IMU (bit 7; bit 18 for the fast one)",
    "attitude": "LOG_BITMASK with ATTITUDE_MED (bit 1) or ATTITUDE_FAST (bit 0)",
    "position": "EK3_ENABLE 1 and a position source",
    "range": "RNGFNDn_TYPE, RNGFNDn_ORIENT (25 down, 0 ahead, 2 right) and LOG_BITMASK with CTUN (bit 4)",
    "rpm": "SERVO_BLH_AUTO 1 with SERVO_BLH_TRATE 50, or bidirectional DShot (SERVO_BLH_BDMASK)",
    "servo": "LOG_BITMASK with RCOUT (bit 10)",
    "battery": "BATT_MONITOR and LOG_BITMASK with CURRENT (bit 9)",
    "pressure": "LOG_BITMASK with IMU (bit 7)",
    "temperature": "ESCs that report it and SERVO_BLH_AUTO 1",
    "thrust": "LOG_BITMASK with CTUN (bit 4)",
    "parameters": "nothing: ArduPilot writes them at the start of a log; was the file cut?",
}
_TLOG_PX4 = {
    "imu": "MAV_x_MODE 2 (onboard), or SET_MESSAGE_INTERVAL of HIGHRES_IMU (105)",
    "attitude": "MAV_x_MODE 2 (onboard)",
    "position": "MAV_x_MODE 2 (onboard), and a position estimate (GPS, flow or vision)",
    "range": "the sensor's own SENS_EN_… or SENS_…_CFG, its rotation parameter, and SET_MESSAGE_INTERVAL of "
    "DISTANCE_SENSOR (132)",
    "rpm": "DSHOT_TEL_CFG or DSHOT_BIDIR_EN 1 (or DroneCAN ESCs: UAVCAN_ENABLE 3), MOT_POLE_COUNT, and "
    "SET_MESSAGE_INTERVAL of ESC_STATUS (291)",
    "servo": "MAV_x_MODE 2 (onboard), or SET_MESSAGE_INTERVAL of SERVO_OUTPUT_RAW (36)",
    "battery": "BAT1_SOURCE and its scale parameters",
    "pressure": "SET_MESSAGE_INTERVAL of SCALED_PRESSURE (29)",
    "temperature": "ESCs that report it: DSHOT_TEL_CFG, and ESC_INFO (290)",
    "thrust": "SET_MESSAGE_INTERVAL of ATTITUDE_TARGET (83); companion asks for it",
    "parameters": "a ground station or companion on the link: it asks for the parameters",
}
_ULG = {
    **_TLOG_PX4,
    **dict.fromkeys(("imu", "attitude", "servo", "pressure", "thrust"), "SDLOG_PROFILE with bit 0 (default)"),
    "position": "a position estimate (GPS, flow or vision)",
    "range": "the sensor's own SENS_EN_… or SENS_…_CFG and its rotation parameter",
    "rpm": "DSHOT_TEL_CFG or DSHOT_BIDIR_EN 1 (or DroneCAN ESCs: UAVCAN_ENABLE 3), and MOT_POLE_COUNT",
    "temperature": "ESCs that report it: DSHOT_TEL_CFG",
    "parameters": "nothing: PX4 writes them at the start of a log; was the file cut?",
}


def change_for(log: FlightLog, quantity: str) -> str:
    """What to set so that the next log of this kind holds ``quantity``, by the autopilot's parameter names."""
    of_links = {ARDUPILOT: _TLOG_ARDUPILOT, PX4: _TLOG_PX4}.get(log.autopilot or 0)
    settings = {".bin": _BIN, ".ulg": _ULG}.get(suffix_of(log.path), of_links)
    if settings is not None:
        return settings[quantity]
    return f"ArduPilot: {_TLOG_ARDUPILOT[quantity]}; PX4: {_TLOG_PX4[quantity]}"
