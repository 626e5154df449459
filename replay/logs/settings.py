"""Which setting of ArduPilot or PX4 puts a missing quantity into a log."""

from __future__ import annotations

import re
from collections.abc import Sequence

from replay.flightlog import FlightLog
from replay.logs.formats import suffix_of

ARDUPILOT = 3
PX4 = 12
"""MAV_AUTOPILOT."""

# x is the number of the link. _of_version gives SRx_ the name that this firmware has for it.
_TLOG_ARDUPILOT = {
    "imu": "SRx_RAW_SENS 50, or SET_MESSAGE_INTERVAL of HIGHRES_IMU (105)",
    "attitude": "SRx_EXTRA1 50",
    "position": "SRx_POSITION 20, and a position estimate (GPS, optical flow or external vision)",
    "range": "RNGFNDn_TYPE, RNGFNDn_ORIENT ({}) and SRx_EXTRA3 20",
    "rpm": "SERVO_BLH_AUTO 1 with SERVO_BLH_TRATE 50 (or bidirectional DShot: SERVO_BLH_BDMASK) "
    "and SRx_EXTRA1 50",
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
    "range": "RNGFNDn_TYPE, RNGFNDn_ORIENT ({}) and LOG_BITMASK with CTUN (bit 4)",
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
    "range": "the sensor's own SENS_EN_… or SENS_…_CFG, its rotation parameter ({}), and "
    "SET_MESSAGE_INTERVAL of DISTANCE_SENSOR (132)",
    "rpm": "DSHOT_TEL_CFG or DSHOT_BIDIR_EN 1 (or DroneCAN ESCs: UAVCAN_ENABLE 3), "
    "MOT_POLE_COUNT, and SET_MESSAGE_INTERVAL of ESC_STATUS (291)",
    "servo": "MAV_x_MODE 2 (onboard), or SET_MESSAGE_INTERVAL of SERVO_OUTPUT_RAW (36)",
    "battery": "BAT1_SOURCE and its scale parameters",
    "pressure": "SET_MESSAGE_INTERVAL of SCALED_PRESSURE (29)",
    "temperature": "ESCs that report it: DSHOT_TEL_CFG, and ESC_INFO (290)",
    "thrust": "SET_MESSAGE_INTERVAL of ATTITUDE_TARGET (83); companion asks for it",
    "parameters": "a ground station or companion on the link: it asks for the parameters",
}
_ULG = {
    **_TLOG_PX4,
    **dict.fromkeys(
        ("imu", "attitude", "servo", "pressure", "thrust"), "SDLOG_PROFILE with bit 0 (default)"
    ),
    "position": "a position estimate (GPS, flow or vision)",
    "range": "the sensor's own SENS_EN_… or SENS_…_CFG and its rotation parameter ({})",
    "rpm": "DSHOT_TEL_CFG or DSHOT_BIDIR_EN 1 (or DroneCAN ESCs: UAVCAN_ENABLE 3), and "
    "MOT_POLE_COUNT",
    "temperature": "ESCs that report it: DSHOT_TEL_CFG",
    "parameters": "nothing: PX4 writes them at the start of a log; was the file cut?",
}


_TURNED = {
    "down": "25 down",
    "up": "24 up",
    "forward": "0 ahead",
    "right": "2 right",
    "back": "4 back",
    "left": "6 left",
}
"""Values of RNGFNDn_ORIENT and of PX4's rotation parameters, MAV_SENSOR_ORIENTATION."""
_STREAMS = re.compile(r"(SR|MAV)\d+_(RAW_SENS|EXTRA\d|EXT_STAT|POSITION|RC_CHAN)")
_RENAMED = (4, 7)
"""From this ArduPilot on SR0_ is MAV1_, SR1_ is MAV2_ (list of parameter name changes, 4.6 to 4.7)."""
_VERSION = re.compile(r"(?:ArduCopter|APM:Copter)\D*(\d+)\.(\d+)")
_FRAME_RENAMED = (3, 5)
"""FRAME is FRAME_CLASS and FRAME_TYPE from this ArduCopter on."""


def change_for(log: FlightLog, quantity: str, directions: Sequence[str] = ()) -> str:
    """What to set so that the next log of this kind holds ``quantity``, by the autopilot's parameter names.

    ``directions``: of a range, the ways in which the sensor may look.
    """
    of_links = {ARDUPILOT: _TLOG_ARDUPILOT, PX4: _TLOG_PX4}.get(log.autopilot or 0)
    settings = {".bin": _BIN, ".ulg": _ULG}.get(suffix_of(log.path), of_links)
    if settings is not None:
        said = settings[quantity]
    else:
        said = f"ArduPilot: {_TLOG_ARDUPILOT[quantity]}; PX4: {_TLOG_PX4[quantity]}"
    turned = ", ".join(_TURNED[direction] for direction in directions)
    return _of_version(log, said.format(*[turned] * said.count("{}")))


def _of_version(log: FlightLog, said: str) -> str:
    """The stream rates by the names of this firmware; by both where the log does not say which it is."""
    if "SRx_" not in said:
        return said
    named = {found[1] for name in log.parameters if (found := _STREAMS.fullmatch(name))}
    version = copter_version(log)
    if "MAV" in named or (version or (0, 0)) >= _RENAMED:
        return said.replace("SRx_", "MAVx_")
    if named or version:
        return said
    return f"{said} (from 4.7 on SRx_ is MAVx_)"


def parameter_missing(log: FlightLog, name: str, since: tuple[int, int]) -> str:
    """What to do where the log of an ArduCopter of unknown version holds parameters, but not ``name``."""
    if suffix_of(log.path) == ".bin" and log.parameters:
        return "ArduCopter has {} from {}.{} on; if this one is as new, the file was cut".format(
            name, *since
        )
    return change_for(log, "parameters")


def copter_version(log: FlightLog) -> tuple[int, int] | None:
    """Major and minor number of ArduCopter, by its start-up text; None where no text says it."""
    found = (_VERSION.search(text) for _, _, text in log.texts)
    return next(((int(m[1]), int(m[2])) for m in found if m is not None), None)


def older_than(log: FlightLog, version: tuple[int, int]) -> str:
    """How ArduCopter is called where it is older than ``version``; empty where that is not known."""
    own = copter_version(log)
    if own is not None:
        if own < version:
            return f"ArduCopter {own[0]}.{own[1]}"
        return ""
    if "FRAME" in log.parameters and "FRAME_CLASS" not in log.parameters:
        return "ArduCopter before {}.{}".format(*_FRAME_RENAMED)
    return ""
