"""ArduCopter and PX4: which modes take a setpoint, what ``thrust`` means, which parameters tell.

Figures: docs/autopilots.md. Sources: ArduPilot mode_guided.cpp, AP_Motors_Thrust_Linearization; PX4 mavlink_receiver.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

from companion.mavlink.samples import Heartbeat

_ARDUCOPTER_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE", 9: "LAND",
    11: "DRIFT", 13: "SPORT", 16: "POSHOLD", 17: "BRAKE", 20: "GUIDED_NOGPS", 21: "SMART_RTL",
}  # fmt: skip
_PX4_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
_PX4_THRUST_TYPES = {2, 3, 4, 13, 14, 15, 19, 20, 21, 22, 29, 35}
"""MAV_TYPEs whose SET_ATTITUDE_TARGET.thrust PX4 uses (fill_thrust); MAV_TYPE_GENERIC is ignored there."""


class Stack(Enum):
    """The firmware on the other end."""

    ARDUPILOT = 3
    PX4 = 12
    OTHER = 0


_STACKS = {stack.value: stack for stack in Stack}


class ThrustMeaning(Enum):
    """What the autopilot does with SET_ATTITUDE_TARGET.thrust."""

    THRUST = "thrust"
    CLIMB_RATE = "climb rate"
    UNKNOWN = "unknown"
    IGNORED = "ignored"


@dataclass(frozen=True, slots=True)
class ThrustMap:
    """Lift over weight is affine in the command: T/W = 1 + slope (thrust - hover), in free air at hover voltage."""

    hover: float
    slope: float

    def change(self, share_of_weight: float) -> float:
        """The command change that changes the lift by this share of the weight."""
        return share_of_weight / self.slope


def stack_of(heartbeat: Heartbeat | None) -> Stack:
    """The firmware a heartbeat names."""
    if heartbeat is None:
        return Stack.OTHER
    return _STACKS.get(heartbeat.autopilot, Stack.OTHER)


def mode_name(heartbeat: Heartbeat) -> str:
    """The flight mode in words."""
    if stack_of(heartbeat) is Stack.PX4:
        return (
            _PX4_MODES.get((heartbeat.custom_mode >> 16) & 0xFF)
            or f"mode {heartbeat.custom_mode:#x}"
        )
    return _ARDUCOPTER_MODES.get(heartbeat.custom_mode) or f"mode {heartbeat.custom_mode}"


def takes_setpoints(heartbeat: Heartbeat | None) -> bool:
    """True in the modes in which an attitude setpoint is obeyed."""
    return heartbeat is not None and mode_name(heartbeat) in ("GUIDED", "GUIDED_NOGPS", "OFFBOARD")


def needed_parameters(stack: Stack) -> tuple[str, ...]:
    """Parameters read at connect."""
    if stack is Stack.ARDUPILOT:
        return (
            "GUID_OPTIONS",
            "GUID_TIMEOUT",
            "MOT_THST_HOVER",
            "MOT_SPIN_MIN",
            "MOT_SPIN_MAX",
            "MOT_THST_EXPO",
            "ATC_INPUT_TC",
            "ATC_ANG_RLL_P",
            "ATC_ANG_PIT_P",
            "ATC_RATE_FF_ENAB",
        )
    if stack is Stack.PX4:
        return ("MPC_THR_HOVER", "THR_MDL_FAC", "MC_ROLL_P", "MC_PITCH_P")
    return ()


def thrust_meaning(heartbeat: Heartbeat, parameters: Mapping[str, float]) -> ThrustMeaning:
    """What a thrust command would do now.

    ArduPilot reads it as a climb rate unless GUID_OPTIONS has bit 3 (value 8); PX4 ignores it for unknown types.
    """
    stack = stack_of(heartbeat)
    if stack is Stack.ARDUPILOT:
        if "GUID_OPTIONS" not in parameters:
            return ThrustMeaning.UNKNOWN
        if int(parameters["GUID_OPTIONS"]) & 8:
            return ThrustMeaning.THRUST
        return ThrustMeaning.CLIMB_RATE
    if stack is Stack.PX4:
        if heartbeat.vehicle_type in _PX4_THRUST_TYPES:
            return ThrustMeaning.THRUST
        return ThrustMeaning.IGNORED
    return ThrustMeaning.UNKNOWN


def thrust_map(stack: Stack, parameters: Mapping[str, float], hover: float) -> ThrustMap:
    """The affine thrust law around ``hover`` (commanded thrust that hovers in free air).

    ArduPilot linearises thrust above spin-min only, so lift does not start at zero: with x the solution of
    e x^2 + (1-e) x = thrust and the propeller law p(1-e) + e p^2 of the output p = min + (max - min) x, the slope at
    hover is dT/dthrust / T. A proportional map would say 1/hover and overestimate the gain by 35-55 %.
    PX4 commands thrust proportionally.
    """
    hover = min(max(hover, 0.05), 0.95)
    if stack is not Stack.ARDUPILOT:
        return ThrustMap(hover, 1.0 / hover)
    low = parameters.get("MOT_SPIN_MIN", 0.15)
    high = parameters.get("MOT_SPIN_MAX", 0.95)
    return _linearised(hover, low, high, parameters.get("MOT_THST_EXPO", 0.65))


@lru_cache(maxsize=16)
def _linearised(hover: float, low: float, high: float, expo: float) -> ThrustMap:
    """ArduPilot's thrust about ``hover``; asked for at every setpoint, changed by few."""
    e = min(max(expo, 0.0), 1.0)
    if e < 1e-3:
        x = hover
    else:
        x = ((e - 1.0) + math.sqrt((1.0 - e) ** 2 + 4.0 * e * hover)) / (2.0 * e)
    span = max(high - low, 0.1)
    output = low + span * x
    lift = (1.0 - e) * output + e * output**2
    per_x = span * ((1.0 - e) + 2.0 * e * output)
    return ThrustMap(hover, per_x / ((1.0 - e) + 2.0 * e * x) / lift)


def advice(stack: Stack, parameters: Mapping[str, float]) -> str | None:
    """One sentence for the pilot at connect, or None."""
    timeout = parameters.get("GUID_TIMEOUT", 0.0)
    if stack is not Stack.ARDUPILOT or timeout <= 1.0:
        return None
    held = (
        f"GUID_TIMEOUT is {timeout:g} s: if the companion stops, the last attitude is held that "
        "long"
    )
    return f"{held}; 0.5 s is better indoors"
