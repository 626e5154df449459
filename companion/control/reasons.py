"""Why nothing is sent, or why offsets fade, in the words that the pilot reads."""

from __future__ import annotations

from enum import Enum


class Reason(Enum):
    """Why offsets are not (or not fully) applied. The value is what the pilot reads."""

    # Nothing is sent at all
    NO_HEARTBEAT = "no heartbeat from the autopilot"
    NOT_ARMED = "not armed"
    WRONG_MODE = "not in GUIDED, GUIDED_NOGPS or OFFBOARD"
    LANDED = "on the ground"
    ATTITUDE_STALE = "attitude missing or old"
    POSITION_STALE = "local position missing or old"
    TOO_LATE = "telemetry arrives too late to fly on"
    POSITION_UNTRUSTED = "the autopilot does not trust its own position"
    THRUST_UNKNOWN = "GUID_OPTIONS not read yet: the meaning of thrust is unknown"
    THRUST_IS_CLIMB_RATE = (
        "GUID_OPTIONS lacks bit 3 (value 8): thrust would be read as a climb rate"
    )
    TYPE_IGNORED = "this MAV_TYPE ignores SET_ATTITUDE_TARGET.thrust on PX4"
    STACK_UNKNOWN = "neither ArduPilot nor PX4"
    UPSTREAM_STALE = "no setpoint from the upstream controller"
    CARRIER_REFUSED = "--carrier acceleration cancels no disturbance on ArduPilot (measured)"
    TAKING_OFF = "waiting for the end of the take-off"
    HOVER_UNKNOWN = "hover thrust not known yet: let the autopilot hover for a few seconds"
    HOVER_IMPLAUSIBLE = (
        "the autopilot's hover parameter contradicts the vehicle file, and no thrust could be "
        "learned"
    )
    NO_MARGIN = "attitude too slow or positions too late for a hold that is stable and firm"
    SWINGS_ON = "the hold swings even with soft gains"
    # The base is sent, offsets fade to zero
    RANGE_MISSING = "rangefinder never heard"
    RANGE_LOST = "range lost: from near to nothing without motion"
    RANGE_FROZEN = "range frozen: the vehicle moves, the reading does not"
    RANGE_STALE = "range old or invalid"
    LATE = "telemetry arrives late"
    POSITION_OLD = "local position is late"
    RPM_MISSING = "rotor speeds missing or old"
    SURFACE_STEP = "ground or wall jumped"
    RANGE_JUMPED = "a range jumped, the vehicle did not move"
    HEIGHT_DRIFTS = "height estimate drifts against the ground range"
    OUT_OF_DOMAIN = "outside the data of the model"
    TILTED = "tilted beyond 25 degrees"
    SWINGING = "the hold was swinging: softer gains"
    STOPPING = "stopping"
    NO_MODEL = "no model of this vehicle's air"
    MODEL_WRONG = "modelled lift is not the weight: model or file of another vehicle"
    ROTORS_WRONG = "more rotors turn than the vehicle file names: of another vehicle"
    OFFSETS_OFF = "offsets switched off"


_GRAVEST_FIRST = tuple(Reason)
HOLDS_BACK_EVERYTHING = frozenset(_GRAVEST_FIRST[: _GRAVEST_FIRST.index(Reason.SWINGS_ON) + 1])
"""Those of the first group."""


class Notice(Enum):
    """Messages to the pilot beside the state; nothing stops because of them."""

    FRAME_REFUSED = (
        "target refused: its frame is none of LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, "
        "BODY_OFFSET_NED"
    )
    LANDED_OVERRULED = (
        "said to be landed, but rotors and ground range say that it flies: the hold goes on"
    )
    POSITION_DRIFTS = (
        "position drifts against the wall range: watch the wall, be ready to take over"
    )
    SOFTENED = "swinging: gains softened, offsets off for now"
    SLOW_PLANT = "slow attitude or late positions: the hold flies with softer gains"
