"""The MAVLink face of the simulated autopilot: what it sends, when, and what it does with what it hears."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.esc_messages import ESC_INFO, ESC_STATUS, EscMessage
from companion.mavlink.frames import pack
from companion.sim.autopilot import AttitudeTarget, Mode, PositionTarget, Sticks
from companion.sim.body import Vec, euler
from companion.sim.flight import Flight
from companion.sim.px4 import Px4
from companion.sim.sensors import RANGE_MAX_M, RANGE_MIN_M
from models.frames import quaternion_from_euler

SYSTEM = 1
COMPANION = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
PILOT_SYSTEM, PILOT_COMPONENT = 255, mavlink.MAV_COMP_ID_MISSIONPLANNER
"""Ids that ground stations use by default."""
MESSAGES_PER_S = 1290.0
"""What the link carries at most, as measured on the real ones: ArduCopter; PX4 below."""
SHORTEST_INTERVAL_S = 0.003
"""ArduPilot refuses a shorter one."""
GUID_OPTION_THRUST = 8
"""Bit 3 of GUID_OPTIONS: SET_ATTITUDE_TARGET.thrust is thrust."""

PX4_MODES = {
    Mode.GUIDED: (6, 0),  # OFFBOARD
    Mode.TAKEOFF: (4, 2),
    Mode.LOITER: (4, 3),  # Hold
    Mode.RTL: (4, 5),
    Mode.LAND: (4, 6),
    Mode.POSHOLD: (3, 0),  # Position
    Mode.ALT_HOLD: (2, 0),
    Mode.STABILIZE: (7, 0),
}
"""PX4's (main, sub) mode of each of ours."""
PX4_MESSAGES_PER_S = 573.0
"""Messages per second on PX4's onboard link, as measured on the real one."""
_TRUSTED = 0x33F
"""ESTIMATOR_STATUS and EKF_STATUS_REPORT: attitude, velocities, positions relative and absolute, their forecasts."""
_DEAD_RECKONED = _TRUSTED & ~(8 | 16 | 256 | 512)
"""The same without horizontal positions, relative, absolute and forecast."""
_FRAMES = (
    mavlink.MAV_FRAME_LOCAL_NED,
    mavlink.MAV_FRAME_LOCAL_OFFSET_NED,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_BODY_OFFSET_NED,
)
_ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
_DENIED: int = mavlink.MAV_RESULT_DENIED
_FAILED: int = mavlink.MAV_RESULT_FAILED
_UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED


@dataclass
class _Stream:
    build: Callable[[], list[bytes]]
    interval_s: float
    due_s: float


class VehicleLink:
    """Encodes and decodes for one vehicle on one link with one peer. ``send`` takes whole frames."""

    def __init__(self, flight: Flight, send: Callable[[bytes], None]) -> None:
        self._flight = flight
        self._send = send
        self._mav = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1)
        self._pilot = mavlink.MAVLink(None, srcSystem=PILOT_SYSTEM, srcComponent=PILOT_COMPONENT)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._streams: dict[int, _Stream] = {}
        self._turn = 0
        self._tokens = 0.0
        self._last_s = 0.0
        self._heartbeat_s = 0.0
        self._mode_said = flight.autopilot.mode
        self._param_queue: list[str] = []
        self._rate = PX4_MESSAGES_PER_S if flight.px4 else MESSAGES_PER_S
        self.companion_heartbeat_s = -math.inf
        """Boot time of the last heartbeat of component 191."""
        self.attitude_stream_s = -math.inf
        """Boot time of the last SET_ATTITUDE_TARGET that was taken."""
        self.attitude_since_s = math.inf
        """Boot time since which that stream has been flowing."""
        self.taken = 0
        self.dropped = 0
        self._builders = self._message_table()

    # -- out --------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Send what is due. Call once per physics step or so."""
        now = self._flight.time_s
        self._tokens = min(20.0, self._tokens + (now - self._last_s) * self._rate)
        self._last_s = now
        changed = self._flight.autopilot.mode is not self._mode_said and not self._flight.px4
        if now >= self._heartbeat_s or changed:
            # ArduPilot announces a change of mode at once, PX4 with its next heartbeat.
            self._heartbeat_s += 0.0 if changed else 1.0
            self._mode_said = self._flight.autopilot.mode
            self._out(self._heartbeat())
        if self._param_queue and self._tokens >= 1.0:
            self._send_param(self._param_queue.pop(0))
        # Round robin, so that a link asked for too much serves everyone less.
        streams = list(self._streams.values())
        for k in range(len(streams)):
            stream = streams[(self._turn + k) % len(streams)]
            if now + 1e-9 < stream.due_s:
                continue
            if self._tokens < 1.0:
                self._turn = (self._turn + k) % len(streams)
                return
            stream.due_s = max(stream.due_s + stream.interval_s, now)
            for frame in stream.build():
                self._tokens -= 1.0
                self._send(frame)

    def route(self, message: Any) -> None:
        """Forward a message of the pilot to the companion's link, as the autopilot's router does."""
        self._send(message.pack(self._pilot))

    def _out(self, message: Any) -> None:
        self._tokens -= 1.0
        self._send(message.pack(self._mav))

    @property
    def boot_ms(self) -> int:
        """Milliseconds since boot."""
        return int(self._flight.time_s * 1000.0 + 0.5)

    @property
    def boot_us(self) -> int:
        """Microseconds since boot."""
        return int(self._flight.time_s * 1e6 + 0.5)

    def _heartbeat(self) -> Any:
        f = self._flight
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if f.autopilot.armed:
            base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        if f.autopilot.mode in (Mode.GUIDED, Mode.GUIDED_NOGPS):
            base |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        custom = int(f.autopilot.mode)
        if f.px4:
            main, sub = PX4_MODES.get(f.autopilot.mode, (7, 0))
            custom = main << 16 | sub << 24
        kind = (
            mavlink.MAV_TYPE_COAXIAL if any(len(n.rotors) > 1 for n in f.vehicle.fans) else mavlink.MAV_TYPE_QUADROTOR
        )
        state = mavlink.MAV_STATE_STANDBY if f.autopilot.landed else mavlink.MAV_STATE_ACTIVE
        firmware = mavlink.MAV_AUTOPILOT_PX4 if f.px4 else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        return mavlink.MAVLink_heartbeat_message(kind, firmware, base, custom, state, 3)

    def _message_table(self) -> dict[int, Callable[[], list[bytes]]]:
        table: dict[int, Callable[[], Any]] = {
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: self._highres_imu,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: self._attitude_target,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_state,
            mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: self._pressure,
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
        }
        if self._flight.px4:
            table[mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS] = self._estimator_status
        else:
            table[mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT] = self._ekf_status

        def framed(build: Callable[[], Any]) -> Callable[[], list[bytes]]:
            return lambda: [build().pack(self._mav)]

        frames = {number: framed(build) for number, build in table.items()}
        if self._flight.ranges:
            frames[mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR] = self._distance_frames
        if self._flight.rings:
            frames[mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE] = self._ring_frames
        if self._flight.vehicle.telemetered:
            if self._flight.px4:
                frames[ESC_STATUS.id] = self._esc_status_frames
                frames[ESC_INFO.id] = self._esc_info_frames
            else:
                frames[mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4] = self._esc_telemetry_frames
        return frames

    def _attitude(self) -> Any:
        e = self._flight.estimate
        return mavlink.MAVLink_attitude_message(self.boot_ms, e.roll, e.pitch, e.yaw, *e.rates)

    def _attitude_quaternion(self) -> Any:
        e = self._flight.estimate
        return mavlink.MAVLink_attitude_quaternion_message(self.boot_ms, *e.quaternion, *e.rates)

    def _highres_imu(self) -> Any:
        e = self._flight.estimate
        return mavlink.MAVLink_highres_imu_message(
            self.boot_us, *e.specific_force, *e.rates, 0.2, 0.0, 0.4, 1013.25, 0.0, 0.0, 25.0, 0x3F
        )

    def _local_position(self) -> Any:
        e = self._flight.estimate
        return mavlink.MAVLink_local_position_ned_message(self.boot_ms, *e.position, *e.velocity)

    def _estimator_status(self) -> Any:
        trusted = self._flight.estimator.trusted
        flags, error_m = (_TRUSTED, 0.3) if trusted else (_DEAD_RECKONED, 5.0)
        tests = (0.05, 0.05, 0.05, 0.05, 0.05, 0.05)
        return mavlink.MAVLink_estimator_status_message(self.boot_us, flags, *tests, error_m, 0.3)

    def _ekf_status(self) -> Any:
        trusted = self._flight.estimator.trusted
        flags, variance = (_TRUSTED, 0.05) if trusted else (_DEAD_RECKONED, 1.5)
        return mavlink.MAVLink_ekf_status_report_message(flags, 0.05, variance, 0.05, 0.05, 0.0)

    def _servo_output(self) -> Any:
        pwm = [int(v) for v in self._flight.autopilot.mixer.pwm]
        return mavlink.MAVLink_servo_output_raw_message(self.boot_us & 0xFFFFFFFF, 0, *pwm)

    def _attitude_target(self) -> Any:
        a = self._flight.autopilot
        return mavlink.MAVLink_attitude_target_message(
            self.boot_ms, 0, quaternion_from_euler(*a.shaped), *a.shaped_rates, max(0.0, min(1.0, a.throttle))
        )

    def _battery(self) -> Any:
        p = self._flight.body.pack
        volts = [round(1000.0 * p.voltage_v)] + [65535] * 9
        left = max(0, round(100.0 * (1.0 - p.used_ah / p.capacity_ah)))
        return mavlink.MAVLink_battery_status_message(
            0, 0, 1, 32767, volts, round(100.0 * p.current_a), round(1000.0 * p.used_ah), -1, left
        )

    def _extended_state(self) -> Any:
        pilot = self._flight.autopilot
        if pilot.landed:
            landed = mavlink.MAV_LANDED_STATE_ON_GROUND
        elif pilot.taking_off:
            landed = mavlink.MAV_LANDED_STATE_TAKEOFF
        else:
            landed = mavlink.MAV_LANDED_STATE_LANDING if pilot.mode is Mode.LAND else mavlink.MAV_LANDED_STATE_IN_AIR
        return mavlink.MAVLink_extended_sys_state_message(0, landed)

    def _pressure(self) -> Any:
        hpa = 1013.25 + 0.12013 * self._flight.body.position[2]
        return mavlink.MAVLink_scaled_pressure_message(self.boot_ms, hpa, 0.0, 1500)

    def _distance_frames(self) -> list[bytes]:
        return [
            mavlink.MAVLink_distance_sensor_message(
                self.boot_ms,
                round(100.0 * RANGE_MIN_M),
                round(100.0 * RANGE_MAX_M),
                round(100.0 * sensor.reading_m),
                mavlink.MAV_DISTANCE_SENSOR_LASER,
                index,
                sensor.sensor.orientation,
                255 if not self._flight.px4 else 0,
            ).pack(self._mav)
            for index, sensor in enumerate(self._flight.ranges)
        ]

    def _ring_frames(self) -> list[bytes]:
        low, high = round(100.0 * RANGE_MIN_M), round(100.0 * RANGE_MAX_M)
        out = []
        for ring in self._flight.rings:
            read = [min(round(100.0 * beam.reading_m), high + 1) for beam in ring.beams]
            step_deg = math.degrees(ring.step_rad)
            message = mavlink.MAVLink_obstacle_distance_message(
                self.boot_us, mavlink.MAV_DISTANCE_SENSOR_LASER, read + [65535] * (72 - len(read)),
                round(step_deg), low, high, step_deg, 0.0, mavlink.MAV_FRAME_BODY_FRD,
            )  # fmt: skip
            out.append(message.pack(self._mav))
        return out

    def _esc_rpm(self) -> list[float]:
        """Speeds by ESC number, from 1; zero where no ESC is fitted."""
        rotors = self._flight.vehicle.rotors
        out = [0.0] * (4 * math.ceil(max(r.esc or 0 for r in rotors) / 4))
        for rotor, rpm in zip(rotors, self._flight.esc.rpm, strict=True):
            if rotor.esc:
                out[rotor.esc - 1] = rpm
        return out

    def _esc_telemetry_frames(self) -> list[bytes]:
        f, rpm = self._flight, self._esc_rpm()
        groups = (
            mavlink.MAVLink_esc_telemetry_1_to_4_message,
            mavlink.MAVLink_esc_telemetry_5_to_8_message,
            mavlink.MAVLink_esc_telemetry_9_to_12_message,
        )
        temperature = [int(f.esc.temperature_c)] * 4
        volts, amps = round(100.0 * f.body.pack.voltage_v), round(100.0 * f.body.pack.current_a / len(f.body.rpm))
        return [
            group(
                temperature,
                [volts] * 4,
                [amps] * 4,
                [0] * 4,
                [round(v) for v in rpm[4 * i : 4 * i + 4]],
                [f.esc.count & 0xFFFF] * 4,
            ).pack(self._mav)
            for i, group in enumerate(groups[: len(rpm) // 4])
        ]

    def _esc_status_frames(self) -> list[bytes]:
        f, rpm = self._flight, self._esc_rpm()
        volts, amps = f.body.pack.voltage_v, f.body.pack.current_a / len(f.body.rpm)
        return [
            self._esc_frame(ESC_STATUS, *(round(v) for v in rpm[i : i + 4]), *[volts] * 4, *[amps] * 4, i)
            for i in range(0, len(rpm), 4)
        ]

    def _esc_info_frames(self) -> list[bytes]:
        f, rpm = self._flight, self._esc_rpm()
        temperature, count = round(100.0 * f.esc.temperature_c), len(f.body.rpm)
        heard, online = f.esc.count & 0xFFFF, (1 << count) - 1 & 0xFF
        return [
            self._esc_frame(ESC_INFO, *[0] * 4, heard, *[0] * 4, *[temperature] * 4, i, count, 5, online)
            for i in range(0, len(rpm), 4)
        ]

    def _esc_frame(self, kind: EscMessage, *fields: float) -> bytes:
        """A frame of a message that pymavlink lacks."""
        payload = kind.unpacker.pack(self.boot_us, *fields)
        frame = pack(kind.id, payload, SYSTEM, mavlink.MAV_COMP_ID_AUTOPILOT1, self._mav.seq)
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame

    # -- in ---------------------------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Bytes from the peer."""
        for message in self._parser.parse_buffer(data) or []:
            if message.get_type() != "BAD_DATA":
                self.hear(message, message.get_srcSystem(), message.get_srcComponent())

    def hear(self, message: Any, system: int, component: int) -> None:
        """One message from ``system``/``component``, addressed to us, to all, or to nobody in particular."""
        kind = message.get_type()
        target = getattr(message, "target_system", SYSTEM)
        part = getattr(message, "target_component", 0)
        ours = part in (0, mavlink.MAV_COMP_ID_AUTOPILOT1)
        # ArduCopter takes what is for a component that it has never heard of.
        nobody = part == COMPANION and not self._flight.px4 and self.companion_heartbeat_s == -math.inf
        if target not in (0, SYSTEM) or not (ours or nobody):
            return
        if kind == "HEARTBEAT":
            if system == SYSTEM and component == COMPANION:
                self.companion_heartbeat_s = self._flight.time_s
            return
        handler = getattr(self, f"_on_{kind.lower()}", None)
        if handler is not None:
            handler(message)

    def _on_timesync(self, m: Any) -> None:
        if m.tc1 == 0:
            self._out(mavlink.MAVLink_timesync_message(1_000_000 * self.boot_ms, m.ts1))

    def _on_set_attitude_target(self, m: Any) -> None:
        pilot, f = self._flight.autopilot, self._flight
        pilot.stream_heard()
        if pilot.mode not in (Mode.GUIDED, Mode.GUIDED_NOGPS):
            return
        mask = m.type_mask
        rates_ignored = mask & 7
        attitude_ignored = bool(mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE)
        if rates_ignored not in (0, 7):
            # A partial mask stops the vehicle, at every message: so does the real one.
            pilot.hold_here(f.estimate)
            self.dropped += 1
            return
        norm = math.sqrt(sum(v * v for v in m.q))
        if mask & mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE or (not attitude_ignored and abs(norm - 1.0) > 1e-3):
            self.dropped += 1
            return
        if attitude_ignored and rates_ignored:
            self.dropped += 1
            return
        roll, pitch, yaw = euler(m.q) if not attitude_ignored else (0.0, 0.0, 0.0)
        climb = not f.px4 and not int(pilot.parameters["GUID_OPTIONS"]) & GUID_OPTION_THRUST
        pilot.fly_attitude(
            AttitudeTarget(
                roll,
                pitch,
                yaw,
                (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate) if attitude_ignored else None,
                max(0.0, min(1.0, m.thrust)),
                climb,
                f.time_s,
            )
        )
        if f.time_s - self.attitude_stream_s > 0.3:
            self.attitude_since_s = f.time_s
        self.attitude_stream_s = f.time_s
        self.taken += 1

    def _on_set_position_target_local_ned(self, m: Any) -> None:
        pilot, f = self._flight.autopilot, self._flight
        pilot.stream_heard()
        if pilot.mode is not Mode.GUIDED or pilot.landed or m.coordinate_frame not in _FRAMES:
            return
        if f.px4 and m.coordinate_frame not in (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_NED):
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
        if m.coordinate_frame not in (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED):
            return (x, y, z)
        c, s = math.cos(self._flight.estimate.yaw), math.sin(self._flight.estimate.yaw)
        return (c * x - s * y, s * x + c * y, z)

    def _place(self, m: Any) -> Vec:
        """The position of a message in NED."""
        n, e, d = self._turned(m, m.x, m.y, m.z)
        if m.coordinate_frame in (mavlink.MAV_FRAME_LOCAL_OFFSET_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED):
            here = self._flight.estimate.position
            return (here[0] + n, here[1] + e, here[2] + d)
        return (n, e, d)

    def _on_manual_control(self, m: Any) -> None:
        pilot = self._flight.autopilot
        pilot.sticks = Sticks(m.x / 1000.0, m.y / 1000.0, (m.z - 500.0) / 500.0, pilot.time_s)

    def _on_command_long(self, m: Any) -> None:
        result = self._command(m)
        self._out(mavlink.MAVLink_command_ack_message(m.command, result))

    def _command(self, m: Any) -> int:
        pilot, f = self._flight.autopilot, self._flight
        if m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return _ACCEPTED if self.set_interval(int(m.param1), m.param2) else _DENIED
        if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            return _ACCEPTED if pilot.arm(m.param1 > 0.5) else _FAILED
        if m.command == mavlink.MAV_CMD_DO_SET_MODE:
            custom = int(m.param2) << 16 | int(m.param3) << 24 if f.px4 else int(m.param2)
            return _ACCEPTED if self._set_mode(custom) else _FAILED
        if m.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            if pilot.mode is not Mode.GUIDED and not f.px4:
                return _FAILED
            return _ACCEPTED if pilot.take_off(m.param7, f.estimate) else _FAILED
        return _UNSUPPORTED

    def set_interval(self, number: int, interval_us: float) -> bool:
        """SET_MESSAGE_INTERVAL: whole milliseconds, no shorter than 3 ms, only messages that we have."""
        build = self._builders.get(number)
        if build is None:
            return False
        if interval_us < 0:
            self._streams.pop(number, None)
            return True
        interval_s = round(interval_us / 1000.0) / 1000.0
        if interval_us == 0 or interval_s < SHORTEST_INTERVAL_S:
            return False
        self._streams[number] = _Stream(build, interval_s, self._flight.time_s)
        return True

    def _set_mode(self, custom: int) -> bool:
        pilot, f = self._flight.autopilot, self._flight
        if f.px4:
            wanted = (custom >> 16 & 0xFF, custom >> 24 & 0xFF)
            match = [
                mode for mode, code in PX4_MODES.items() if code == wanted or (code[1] == 0 and code[0] == wanted[0])
            ]
            if not match:
                return False
            if match[0] is Mode.GUIDED and isinstance(pilot, Px4) and not pilot.stream_runs:
                return False
            pilot.set_mode(match[0], f.estimate)
            return True
        try:
            mode = Mode(custom)
        except ValueError:
            return False
        pilot.set_mode(mode, f.estimate)
        return True

    # -- parameters -------------------------------------------------------------------------------------------------

    @property
    def params(self) -> dict[str, float]:
        """The autopilot's parameters."""
        return self._flight.autopilot.parameters

    def _send_param(self, name: str) -> None:
        names = list(self.params)
        self._out(
            mavlink.MAVLink_param_value_message(
                name.encode(), self.params[name], mavlink.MAV_PARAM_TYPE_REAL32, len(names), names.index(name)
            )
        )

    def _on_param_request_read(self, m: Any) -> None:
        names = list(self.params)
        name = m.param_id if m.param_index < 0 else names[m.param_index] if m.param_index < len(names) else ""
        if name in self.params:
            self._param_queue.append(name)

    def _on_param_request_list(self, m: Any) -> None:
        self._param_queue.extend(self.params)

    def _on_param_set(self, m: Any) -> None:
        if self._flight.autopilot.set_parameter(m.param_id, float(m.param_value)):
            self._param_queue.append(m.param_id)
