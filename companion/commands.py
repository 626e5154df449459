"""From a decision to a MAVLink command."""

from __future__ import annotations

import math

from companion.config import Base, Carrier, PipelineConfig
from companion.control import hover_thrust
from companion.control.compensation import Offset
from companion.control.engagement import waits_for_mode
from companion.control.hand_over import (
    NOT_OURS,
    HandOver,
    hand_over_command,
    held_off,
    place_of,
)
from companion.control.position_hold import (
    BaseSetpoint,
    Hold,
)
from companion.control.reasons import Reason
from companion.control.wall_guard import level_wall
from companion.mavlink.firmware import ThrustMap, thrust_map
from companion.mavlink.setpoints import AttitudeCommand, Command, PositionCommand, tilt_by
from companion.state.pipeline_state import PipelineState
from models.common.frames import quaternion_from_euler
from models.vehicle import Vector3

_LEAST_THRUST_SHARE = 0.3
"""Of hover thrust: the hold never commands less, so that the attitude stays controllable."""
_MOST_THRUST_ABOVE_HOVER = 0.35
MIN_THRUST = 0.05
MAX_THRUST = 0.95
"""Of the hold's commands."""


def thrust_map_of(state: PipelineState, config: PipelineConfig) -> ThrustMap:
    """How the autopilot reads a commanded thrust, with the hover thrust that is known best."""
    hover = hover_thrust.best_hover(
        state.learned.hover, state.heard.parameters, config.vehicle.hover_thrust
    )
    return thrust_map(state.heard.stack, state.heard.parameters, hover)


def hand_over_place(state: PipelineState, hold: Hold) -> Vector3:
    """Where the autopilot is to stay when the hold ends, NED."""
    place = place_of(hold, state.held.drift.correction_m)
    towards = level_wall(state.air.disturbance)
    if towards is None:
        return place
    return held_off(place, state.learned.balance.acceleration, towards)


def level_command(state: PipelineState, config: PipelineConfig) -> AttitudeCommand:
    """Level at hover thrust, heading as held."""
    if state.held.hold is None:
        yaw = 0.0
    else:
        yaw = state.held.hold.target.yaw
    return AttitudeCommand(
        state.t_s, quaternion_from_euler(0.0, 0.0, yaw), thrust_map_of(state, config).hover
    )


def command_held_back(
    state: PipelineState,
    hand_over: HandOver | None,
    held_back: set[Reason],
    thrust: ThrustMap,
    config: PipelineConfig,
    t_s: float,
) -> Command | None:
    """What is sent although nothing is compensated: the end of a hold, or what PX4 needs before OFFBOARD."""
    if hand_over is not None and not held_back & NOT_OURS:
        return hand_over_command(hand_over, thrust, held_back, t_s)
    rows = state.estimates.rows
    if not waits_for_mode(state.heard.heartbeat, held_back) or rows is None:
        return None
    if config.base is Base.UPSTREAM:
        upstream = state.requests.upstream
        assert upstream is not None
        return AttitudeCommand(
            t_s, upstream.q_ned_frd, upstream.thrust, upstream.type_mask, upstream.rates_frd
        )
    yaw = math.atan2(rows[1][0], rows[0][0])
    return AttitudeCommand(t_s, quaternion_from_euler(0.0, 0.0, yaw), thrust.hover)


def command_of(
    state: PipelineState,
    hold: Hold | None,
    base: BaseSetpoint,
    offset: Offset,
    thrust: ThrustMap,
    config: PipelineConfig,
    t_s: float,
) -> Command | None:
    """The setpoint of a base and its offset, thrust within limits.

    None where the carrier needs a hold and there is none.
    """
    if config.carrier is Carrier.ACCELERATION:
        if hold is None:
            return None
        place = place_of(hold, state.held.drift.correction_m)
        return PositionCommand(t_s, place, hold.target.yaw, offset.acceleration)
    floor = max(_LEAST_THRUST_SHARE * thrust.hover, MIN_THRUST)
    ceiling = min(thrust.hover + _MOST_THRUST_ABOVE_HOVER, MAX_THRUST)
    value = base.thrust + offset.thrust
    if config.base is Base.UPSTREAM:
        upstream = state.requests.upstream
        assert upstream is not None
        # An upstream controller's own extremes are its business; the offset never goes past the limits.
        value = base.thrust + min(
            max(offset.thrust, min(floor - base.thrust, 0.0)), max(ceiling - base.thrust, 0.0)
        )
        q = tilt_by(upstream.q_ned_frd, offset.roll, offset.pitch)
        return AttitudeCommand(
            t_s, q, min(max(value, 0.0), 1.0), upstream.type_mask, upstream.rates_frd
        )
    q = quaternion_from_euler(base.roll, base.pitch, base.yaw)
    return AttitudeCommand(
        t_s, tilt_by(q, offset.roll, offset.pitch), min(max(value, floor), ceiling)
    )
