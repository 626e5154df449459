"""What a log says of the kind of its vehicle, where that is no multirotor of fixed rotors.

Numbers: MAVLink MAV_TYPE; ArduPilot FRAME_CLASS, Q_ENABLE and names of parameters that one vehicle alone has; PX4
CA_AIRFRAME and the ranges of SYS_AUTOSTART (``init.d/rc.autostart``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from replay.flightlog import FlightLog

_AEROPLANE = "an aeroplane"
_VTOL = "a VTOL aeroplane"
_HELICOPTER = "a helicopter"
_ROVER = "a rover"
_BOAT = "a boat"
_SUBMARINE = "a submarine"
_AIRSHIP = "an airship"
_TRACKER = "an antenna tracker"
_SPACECRAFT = "a spacecraft"
_SINGLE = "a single-rotor copter with vanes"
_COAX = "a coaxial copter with vanes"
_BICOPTER = "a bicopter"
_SIX_AXES = "a vehicle with rotors in all directions"

_MAV_TYPES = {
    1: _AEROPLANE,
    3: "a coaxial helicopter",
    4: _HELICOPTER,
    5: _TRACKER,
    7: _AIRSHIP,
    8: "a balloon",
    9: "a rocket",
    10: _ROVER,
    11: _BOAT,
    12: _SUBMARINE,
    16: "a flapping-wing aircraft",
    17: "a kite",
    28: "a parafoil",
    **dict.fromkeys(range(19, 26), _VTOL),
}
_FRAME_CLASSES = {
    **dict.fromkeys((6, 11, 13), _HELICOPTER),
    8: _SINGLE,
    9: _COAX,
    10: _BICOPTER,
    16: _SIX_AXES,
}
_ROVER_CLASSES = {2: _BOAT, 3: "a balance bot"}
_CA_AIRFRAMES = {
    1: _AEROPLANE,
    7: _SUBMARINE,
    **dict.fromkeys((2, 3, 4), _VTOL),
    **dict.fromkeys((5, 6, 13), _ROVER),
    **dict.fromkeys((10, 11, 12), _HELICOPTER),
    **dict.fromkeys((14, 15), _SPACECRAFT),
}
_AUTOSTART_RANGES = {
    2: _AEROPLANE,
    3: "a flying wing",
    13: _VTOL,
    15: _HELICOPTER,
    16: _HELICOPTER,
    17: "an autogyro",
    18: "a balloon",
    **dict.fromkeys(range(50, 60), _ROVER),
    **dict.fromkeys(range(60, 70), _SUBMARINE),
}
"""Thousands of SYS_AUTOSTART."""
_AIRSHIPS = (2500, 2507)
"""Among the numbers of aeroplanes."""
_OF_ONE_VEHICLE = {
    "TECS_CLMB_MAX": _AEROPLANE,
    "CRUISE_THROTTLE": _ROVER,
    "JS_GAIN_DEFAULT": _SUBMARINE,
    "H_RSC_MODE": _HELICOPTER,
    "YAW_SLEW_TIME": _TRACKER,
}
"""Parameters of ArduPilot's other vehicles."""
_TEXTS = {
    "ArduPlane": _AEROPLANE,
    "APM:Plane": _AEROPLANE,
    "QuadPlane": _VTOL,
    "ArduRover": _ROVER,
    "APM:Rover": _ROVER,
    "Rover V": _ROVER,
    "ArduSub": _SUBMARINE,
    "Blimp": _AIRSHIP,
    "AntennaTracker": _TRACKER,
    "ArduTracker": _TRACKER,
    "Frame: HELI": _HELICOPTER,
    "Frame: SINGLE": _SINGLE,
    "Frame: COAX": _COAX,
}
"""First words of what an autopilot says when it starts."""
_MULTIROTORS = (2, 13, 14, 15, 29, 35)
"""MAV_TYPE of multirotors of 4, 6, 8, 3, 12 and 10 motors."""


@dataclass(frozen=True)
class Kind:
    """What a vehicle is, and what of the log says so."""

    what: str
    said: str


def other_kind(log: FlightLog) -> Kind | None:
    """What the vehicle is, or None where it may be a multirotor."""
    return next(_kinds(log), None)


def _kinds(log: FlightLog) -> Iterator[Kind]:
    p = log.parameters
    if p.get("Q_ENABLE", 0.0) > 0.0:
        yield Kind(_VTOL, f"Q_ENABLE {p['Q_ENABLE']:g}")
    mav_type = int(p.get("MAV_TYPE", 0.0)) or log.vehicle_type
    if mav_type in _MAV_TYPES:
        yield Kind(_MAV_TYPES[mav_type], f"MAV_TYPE {mav_type}")
    for name, what in _OF_ONE_VEHICLE.items():
        if name in p:
            yield Kind(_of_rover(log) if what == _ROVER else what, f"parameter {name}")
    for name, kinds in (("FRAME_CLASS", _FRAME_CLASSES), ("CA_AIRFRAME", _CA_AIRFRAMES)):
        number = int(p.get(name, -1.0))
        if number in kinds:
            yield Kind(kinds[number], f"{name} {number}")
    if mav_type not in _MULTIROTORS:
        yield from _by_autostart(int(p.get("SYS_AUTOSTART", 0.0)))
    for _, _, text in log.texts:
        for start, what in _TEXTS.items():
            if text.startswith(start):
                yield Kind(what, f"'{text}'")


def _of_rover(log: FlightLog) -> str:
    """FRAME_CLASS has other values on a rover."""
    return _ROVER_CLASSES.get(int(log.parameters.get("FRAME_CLASS", 0.0)), _ROVER)


def _by_autostart(number: int) -> Iterator[Kind]:
    what: str | None
    if number in _AIRSHIPS:
        what = _AIRSHIP
    else:
        what = _AUTOSTART_RANGES.get(number // 1000)
    if what is not None:
        yield Kind(what, f"SYS_AUTOSTART {number}")
