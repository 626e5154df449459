"""What ArduCopter does with the messages of other people: sticks, ground stations, targets of every kind and frame.

Local positions may be few and late.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any

from arducopter import ArduCopter, Sticks
from gps import GpsEstimator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.sim.autopilot import Mode, PositionTarget
from companion.sim.fan_wrench import Vec
from companion.sim.flight import SimulatedFlight
from companion.sim.link import COMPANION, SYSTEM, TRUSTED, Messages, VehicleLink
from companion.sim.sensors import Estimate

STREAMS = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE,),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,),
    mavlink.MAV_DATA_STREAM_POSITION: (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4,
    ),
}
"""What REQUEST_DATA_STREAM sets the rate of on ArduCopter, by group; ATTITUDE_QUATERNION is in none."""
DEAD_RECKONED = TRUSTED & ~(8 | 16 | 256 | 512)
"""Flags without horizontal positions, relative, absolute and forecast."""
ON_EARTH = 16 | 512
"""Position absolute, and its forecast: neither is set without GPS, a beacon or a given origin."""
_FRAMES = (
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_BODY_OFFSET_NED,
)


class ArduCopterLink(VehicleLink):
    """The link of an ``ArduCopter`` whose estimator may lose GPS."""

    frames: tuple[int, ...] = _FRAMES
    """Of positions that are obeyed."""

    def __init__(self, flight: SimulatedFlight, send: Callable[[bytes], None]) -> None:
        super().__init__(flight, send)
        self.companion_heartbeat_s = -math.inf
        """Boot time of the last heartbeat of component 191."""
        self.taken = self.dropped = 0
        """Attitude targets."""
        self.position_hz = math.inf
        """Local positions come no faster than this, whatever is asked for."""
        self.position_late_s = 0.0
        """And this much later than their stamp says."""
        self._past: deque[tuple[int, Estimate]] = deque()

    @property
    def _copter(self) -> ArduCopter:
        assert isinstance(self._flight.autopilot, ArduCopter)
        return self._flight.autopilot

    @property
    def _estimator(self) -> GpsEstimator:
        assert isinstance(self._flight.estimator, GpsEstimator)
        return self._flight.estimator

    # -- out --------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Send what is due."""
        if self.position_late_s > 0.0:
            self._past.append((self.boot_ms, self._flight.estimate))
        super().step()

    def set_interval(self, number: int, interval_us: float) -> bool:
        """SET_MESSAGE_INTERVAL."""
        if number == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED and interval_us > 0:
            interval_us = max(interval_us, 1e6 / self.position_hz)
        return super().set_interval(number, interval_us)

    def _local_position(self) -> Messages:
        boot_ms, e = self.boot_ms, self._flight.estimate
        while self._past and self._past[0][0] <= self.boot_ms - 1000.0 * self.position_late_s:
            boot_ms, e = self._past.popleft()
        return [mavlink.MAVLink_local_position_ned_message(boot_ms, *e.position, *e.velocity)]

    def _position_flags(self) -> int:
        flags = TRUSTED if self._estimator.trusted else DEAD_RECKONED
        return flags & ~ON_EARTH if self._estimator.relative else flags

    def _estimator_status(self) -> Messages:
        ratio = self._estimator.test_ratio
        return [
            mavlink.MAVLink_ekf_status_report_message(
                self._position_flags(), 0.05, ratio, 0.05, 0.05, 0.0
            )
        ]

    def _landed_state(self) -> int:
        state = super()._landed_state()
        in_air = state == mavlink.MAV_LANDED_STATE_IN_AIR
        return (
            int(mavlink.MAV_LANDED_STATE_LANDING)
            if in_air and self._copter.mode is Mode.LAND
            else state
        )

    # -- in ---------------------------------------------------------------------------------------------------------

    def _for_us(self, message: Any) -> bool:
        # ArduCopter takes what is for a component that it has never heard of.
        nobody = (
            self.companion_heartbeat_s == -math.inf
            and getattr(message, "target_component", 0) == COMPANION
        )
        return nobody or super()._for_us(message)

    def _on_heartbeat(self, m: Any) -> None:
        if (m.get_srcSystem(), m.get_srcComponent()) == (SYSTEM, COMPANION):
            self.companion_heartbeat_s = self._flight.time_s

    def _on_set_attitude_target(self, m: Any) -> None:
        pilot, mask = self._copter, m.type_mask
        if pilot.mode not in pilot.stream_modes:
            return
        rates_ignored, attitude_ignored = (
            mask & 7,
            bool(mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE),
        )
        if rates_ignored not in (0, 7):
            # A partial mask stops the vehicle, at every message: so does the real one.
            pilot.hold_here(self._flight.estimate)
            self.dropped += 1
            return
        norm = math.sqrt(sum(v * v for v in m.q))
        if mask & mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE or (
            not attitude_ignored and abs(norm - 1.0) > 1e-3
        ):
            self.dropped += 1
            return
        if attitude_ignored and rates_ignored:
            self.dropped += 1
            return
        super()._on_set_attitude_target(m)
        self.taken += 1

    def _on_set_position_target_local_ned(self, m: Any) -> None:
        pilot, f = self._copter, self._flight
        if pilot.mode is not Mode.GUIDED or pilot.landed or m.coordinate_frame not in self.frames:
            return
        mask = m.type_mask
        position, velocity, accel = not mask & 0x7, not mask & 0x38, not mask & 0x1C0
        if mask & 0x200 or not (position or velocity or accel):
            pilot.hold_here(f.estimate)
            return
        pilot.fly_to(
            PositionTarget(
                position=self._place(m) if position else (None, None, None),
                velocity=self._turned(m, m.vx, m.vy, m.vz) if velocity else (0.0, 0.0, 0.0),
                accel=self._turned(m, m.afx, m.afy, m.afz) if accel else (0.0, 0.0, 0.0),
                yaw=None if mask & 0x400 else m.yaw,
                time_s=f.time_s,
            ),
            f.estimate,
        )

    def _turned(self, m: Any, x: float, y: float, z: float) -> Vec:
        """A vector of a message in NED: the body frames are turned by the heading, and stay level."""
        if m.coordinate_frame not in (
            mavlink.MAV_FRAME_BODY_NED,
            mavlink.MAV_FRAME_BODY_OFFSET_NED,
        ):
            return (x, y, z)
        c, s = math.cos(self._flight.estimate.yaw), math.sin(self._flight.estimate.yaw)
        return (c * x - s * y, s * x + c * y, z)

    def _place(self, m: Any) -> Vec:
        """The position of a message in NED."""
        n, e, d = self._turned(m, m.x, m.y, m.z)
        if m.coordinate_frame in (
            mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
            mavlink.MAV_FRAME_BODY_OFFSET_NED,
        ):
            here = self._flight.estimate.position
            return (here[0] + n, here[1] + e, here[2] + d)
        return (n, e, d)

    def _on_manual_control(self, m: Any) -> None:
        pilot = self._copter
        pilot.sticks = Sticks(m.x / 1000.0, m.y / 1000.0, (m.z - 500.0) / 500.0, pilot.time_s)

    def _on_request_data_stream(self, m: Any) -> None:
        """A rate for whole groups, in place of what SET_MESSAGE_INTERVAL asked for."""
        for stream, numbers in STREAMS.items():
            if m.req_stream_id in (mavlink.MAV_DATA_STREAM_ALL, stream):
                for number in numbers:
                    self.set_interval(
                        number,
                        1e6 / m.req_message_rate if m.start_stop and m.req_message_rate else -1,
                    )

    def _on_param_request_list(self, m: Any) -> None:
        self._param_queue.extend(self._copter.parameters)

    def _on_param_set(self, m: Any) -> None:
        if self._copter.set_parameter(m.param_id, float(m.param_value)):
            self._param_queue.append(m.param_id)
