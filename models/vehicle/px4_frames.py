"""Which frame PX4's parameters name: places of CA_ROTORn (from 1.13 on), else the airframe number SYS_AUTOSTART.

Sources: PX4 ``control_allocator`` (KM above 0 turns counter-clockwise seen from above); ``init.d/airframes`` and
``init.d/rc.autostart`` up to 1.13, where each airframe names its mixer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from models.vehicle.ardupilot_frames import SaidFrame
from models.vehicle.motor_layouts import CCW, CW, FRAMES, LAYOUTS, Frame, Motor

_AUTOSTART: dict[int, str] = {}
"""Airframe number to name."""
for _frame, _layout in LAYOUTS.items():
    _AUTOSTART |= dict.fromkeys(_layout.get("px4_airframes", ()), _frame)
_COUNT_OF_RANGE = {4: 4, 5: 4, 6: 6, 7: 6, 8: 8, 9: 8, 10: 4, 11: 6, 12: 8, 14: 3, 24: 12}
"""Thousands of SYS_AUTOSTART to motors, by the list in ``rc.autostart``."""
_UPRIGHT = 0.9
"""Cosine of a rotor's tilt (26 degrees) down to which it is taken for upright."""
_SAME_PLACE = 0.10
_SAME_ARM = 0.15
"""Share of the arm by which a motor may sit beside its place in a frame that still gives its name to the vehicle, and
how much the arms may differ."""


@dataclass(frozen=True, kw_only=True)
class Px4Rotors:
    """Motors of CA_ROTORn, places over the longest arm."""

    name: str
    """Of the frame in ``FRAMES`` that they are, else their number."""
    motors: Frame
    arm_m: float
    unsure: str = ""
    """Why they do not say the moments."""


def px4_rotors(parameters: Mapping[str, float]) -> Px4Rotors | None:
    """What CA_ROTORn_* say; None where PX4 says nothing."""
    found = px4_motors(parameters)
    if found is None:
        return None
    motors, arm_m = found
    return Px4Rotors(
        name=_name(motors),
        motors=motors,
        arm_m=arm_m,
        unsure=_unsure(parameters, len(motors)),
    )


def px4_motors(parameters: Mapping[str, float]) -> tuple[Frame, float] | None:
    """Motors of CA_ROTORn_*, places over the longest arm, and that arm's length [m]; None where PX4 says nothing."""
    count = int(parameters.get("CA_ROTOR_COUNT", 0))
    places = []
    for k in range(count):
        places.append(tuple(parameters.get(f"CA_ROTOR{k}_P{axis}", 0.0) for axis in "XYZ"))
    arm = max((math.hypot(x, y) for x, y, _ in places), default=0.0)
    if arm <= 0.0:
        return None
    spins = [CCW if parameters.get(f"CA_ROTOR{k}_KM", 0.05) > 0.0 else CW for k in range(count)]
    numbered = enumerate(zip(places, spins, strict=True), 1)
    motors = tuple(
        Motor(number=k, forward=x / arm, right=y / arm, spin=spin, down=z / arm)
        for k, ((x, y, z), spin) in numbered
    )
    return motors, arm


def _unsure(parameters: Mapping[str, float], count: int) -> str:
    for k in range(count):
        axis = [
            parameters.get(f"CA_ROTOR{k}_A{name}", default)
            for name, default in zip("XYZ", (0.0, 0.0, -1.0), strict=True)
        ]
        length = math.hypot(*axis)
        if length > 0.0 and -axis[2] / length < _UPRIGHT:
            return f"CA_ROTOR{k}_AX, _AY, _AZ tilt a rotor"
        if parameters.get(f"CA_ROTOR{k}_KM", 0.05) == 0.0:
            return f"CA_ROTOR{k}_KM is 0: no parameter says how the rotor turns"
    return ""


def _name(motors: Frame) -> str:
    """The frame with every motor at its place and its spin, whatever the arm's length is."""
    alike = (name for name, frame in FRAMES.items() if _same(motors, frame))
    return next(alike, f"{len(motors)} rotors of CA_ROTORn")


def _same(motors: Frame, frame: Frame) -> bool:
    if len(motors) != len(frame):
        return False
    pairs = list(zip(motors, frame, strict=True))
    return all(_matches(own, other) for own, other in pairs)


def _matches(own: Motor, other: Motor) -> bool:
    if (own.number, own.spin) != (other.number, other.spin):
        return False
    arm = math.hypot(own.forward, own.right)
    wanted = math.hypot(other.forward, other.right)
    apart = math.hypot(own.forward - other.forward, own.right - other.right)
    return apart <= _SAME_PLACE and abs(arm - wanted) <= _SAME_ARM


def said_by_autostart(parameters: Mapping[str, float]) -> SaidFrame | None:
    """What SYS_AUTOSTART says of a multirotor, or None."""
    number = int(parameters.get("SYS_AUTOSTART", 0))
    said = f"SYS_AUTOSTART {number}"
    if number in _AUTOSTART:
        name = _AUTOSTART[number]
        return SaidFrame(said=said, name=name, count=len(FRAMES[name]))
    count = _COUNT_OF_RANGE.get(number // 1000)
    if count is None:
        return None
    return SaidFrame(
        said=said, count=count, unsure=f"the places of airframe {number} are not known"
    )
