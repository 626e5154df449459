"""Why nothing is sent, or why offsets fade, in the words that the pilot reads."""

from __future__ import annotations

from enum import Enum
from typing import Self

from companion.estimation.surfaces import Seen


class HoldsBack(Enum):
    """What a reason keeps from the autopilot."""

    EVERYTHING = "nothing is sent"
    OFFSETS = "the base is sent, offsets fade to zero"


class Reason(Enum):
    """Why offsets are not (or not fully) applied, gravest first. The value is what the pilot reads."""

    _value_: str
    holds_back: HoldsBack

    def __new__(cls, text: str, holds_back: HoldsBack) -> Self:
        """A reason by its text alone, with what it holds back beside it."""
        reason = object.__new__(cls)
        reason._value_ = text
        reason.holds_back = holds_back
        return reason

    NO_HEARTBEAT = "no heartbeat from the autopilot", HoldsBack.EVERYTHING
    NOT_ARMED = "not armed", HoldsBack.EVERYTHING
    WRONG_MODE = "not in GUIDED, GUIDED_NOGPS or OFFBOARD", HoldsBack.EVERYTHING
    LANDED = "on the ground", HoldsBack.EVERYTHING
    ATTITUDE_STALE = "attitude missing or old", HoldsBack.EVERYTHING
    POSITION_STALE = "local position missing or old", HoldsBack.EVERYTHING
    TOO_LATE = "telemetry arrives too late to fly on", HoldsBack.EVERYTHING
    POSITION_UNTRUSTED = "the autopilot does not trust its own position", HoldsBack.EVERYTHING
    THRUST_UNKNOWN = (
        "GUID_OPTIONS not read yet: the meaning of thrust is unknown",
        HoldsBack.EVERYTHING,
    )
    THRUST_IS_CLIMB_RATE = (
        "GUID_OPTIONS lacks bit 3 (value 8): thrust would be read as a climb rate",
        HoldsBack.EVERYTHING,
    )
    TYPE_IGNORED = "this MAV_TYPE ignores SET_ATTITUDE_TARGET.thrust on PX4", HoldsBack.EVERYTHING
    STACK_UNKNOWN = "neither ArduPilot nor PX4", HoldsBack.EVERYTHING
    UPSTREAM_STALE = "no setpoint from the upstream controller", HoldsBack.EVERYTHING
    CARRIER_REFUSED = (
        "--carrier acceleration cancels no disturbance on ArduPilot (measured)",
        HoldsBack.EVERYTHING,
    )
    TAKING_OFF = "waiting for the end of the take-off", HoldsBack.EVERYTHING
    HOVER_UNKNOWN = (
        "hover thrust not known yet: let the autopilot hover for a few seconds",
        HoldsBack.EVERYTHING,
    )
    HOVER_IMPLAUSIBLE = (
        "the autopilot's hover parameter contradicts the vehicle file, and no thrust could be "
        "learned",
        HoldsBack.EVERYTHING,
    )
    NO_MARGIN = (
        "attitude too slow or positions too late for a hold that is stable and firm",
        HoldsBack.EVERYTHING,
    )
    SWINGS_ON = "the hold swings even with soft gains", HoldsBack.EVERYTHING
    RANGE_MISSING = "rangefinder never heard", HoldsBack.OFFSETS
    RANGE_LOST = "range lost: from near to nothing without motion", HoldsBack.OFFSETS
    RANGE_FROZEN = "range frozen: the vehicle moves, the reading does not", HoldsBack.OFFSETS
    RANGE_STALE = "range old or invalid", HoldsBack.OFFSETS
    LATE = "telemetry arrives late", HoldsBack.OFFSETS
    POSITION_OLD = "local position is late", HoldsBack.OFFSETS
    RPM_MISSING = "rotor speeds missing or old", HoldsBack.OFFSETS
    SURFACE_STEP = "ground or wall jumped", HoldsBack.OFFSETS
    RANGE_JUMPED = "a range jumped, the vehicle did not move", HoldsBack.OFFSETS
    HEIGHT_DRIFTS = "height estimate drifts against the ground range", HoldsBack.OFFSETS
    OUT_OF_DOMAIN = "outside the data of the model", HoldsBack.OFFSETS
    TILTED = "tilted beyond 25 degrees", HoldsBack.OFFSETS
    SWINGING = "the hold was swinging: softer gains", HoldsBack.OFFSETS
    STOPPING = "stopping", HoldsBack.OFFSETS
    NO_MODEL = "no model of this vehicle's air", HoldsBack.OFFSETS
    MODEL_WRONG = (
        "modelled lift is not the weight: model or file of another vehicle",
        HoldsBack.OFFSETS,
    )
    ROTORS_WRONG = (
        "more rotors turn than the vehicle file names: of another vehicle",
        HoldsBack.OFFSETS,
    )
    OFFSETS_OFF = "offsets switched off", HoldsBack.OFFSETS


HOLDS_BACK_EVERYTHING = frozenset(
    [reason for reason in Reason if reason.holds_back is HoldsBack.EVERYTHING]
)

REASON_OF_SIGHT = {
    Seen.MISSING: Reason.RANGE_MISSING,
    Seen.STALE: Reason.RANGE_STALE,
    Seen.LOST: Reason.RANGE_LOST,
    Seen.FROZEN: Reason.RANGE_FROZEN,
}
"""What is said of a direction that should be watched and is not."""


class Notice(Enum):
    """Messages to the pilot beside the state; nothing stops because of them."""

    FRAME_REFUSED = (
        "target refused: its frame is none of LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, "
        "BODY_OFFSET_NED"
    )
    LANDED_OVERRULED = (
        "said to be landed, but rotors and ground range say that it flies: the hold goes on"
    )
    POSITION_DRIFTS = "position drifts against the wall range: held off the wall by its range"
    WALL_RANGE_DRIFTS = "wall range drifts against position and accelerometer: held by the position"
    WALL_LEAST = "this attitude loop can hold {least:.2f} m from a wall, not {target:.2f}"
    SOFTENED = "swinging: gains softened, offsets off for now"
    SLOW_PLANT = "slow attitude or late positions: the hold flies with softer gains"
