"""Which vehicle a log is of: its board, or what is set up on it alone."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping

from models.common.errors import UserError
from replay.flightlog import FlightLog
from replay.identity import VehicleIdentity
from replay.vehicle.airframe import airframe

_BOARD = re.compile(r"\b([0-9A-F]{8}) ?([0-9A-F]{8}) ?([0-9A-F]{8})\b")
"""Unique number of a processor, in a text of start-up."""
_FIRMWARE = re.compile(r"\b(ArduCopter|PX4|Copter)\b[^(]*")
_OWN = re.compile(r"(INS_ACC\d?OFFS_|CAL_ACC\d_[XYZ]OFF)")
"""Offsets of the accelerometers: measured once on this very board. Gyros are set anew at every start."""
_LEARNT = re.compile(
    r"(STAT_|MOT_THST_HOVER|BARO\d?_GND|LND_FLIGHT_T|COM_FLIGHT|SYS_|_TEMP"
    r"|INS_GYR|CAL_GYRO|COMPASS_OFS|CAL_MAG)"
)
"""Parameters that change by themselves."""
_DIGITS = 16


def identity(log: FlightLog) -> VehicleIdentity:
    """By start-up texts and parameters."""
    board = ""
    firmware = ""
    for _, _, text in log.texts:
        number = _BOARD.search(text)
        version = _FIRMWARE.search(text)
        if number is not None and not board:
            board = "".join(number.groups())
        if version is not None and not firmware:
            firmware = version[0].strip()
    frame = _frame(log)
    own = {name: value for name, value in log.parameters.items() if _OWN.match(name)}
    if board:
        vehicle = f"board-{board}"
    elif any(own.values()):
        vehicle = f"sensors-{_hash(own)}"
    else:
        vehicle = f"{frame or 'vehicle'}-{log.system}"
    kept = {name: value for name, value in log.parameters.items() if not _LEARNT.search(name)}
    return VehicleIdentity(
        vehicle=vehicle,
        board=board,
        firmware=firmware,
        frame=frame,
        parameters=_hash(kept) if kept else "",
    )


def _frame(log: FlightLog) -> str:
    try:
        return airframe(log).name
    except UserError:
        return ""


def _hash(parameters: Mapping[str, float]) -> str:
    text = "\n".join(f"{name} {parameters[name]:.9g}" for name in sorted(parameters))
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
