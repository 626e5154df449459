"""The MAVLink face of the simulated autopilot: what it sends, when, and what it does with what it hears."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.sim.autopilot import AttitudeDemand, Mode, PositionTarget
from companion.sim.body import euler
from companion.sim.flight import SimulatedFlight
from companion.sim.sensors import RANGE_MAX_M, RANGE_MIN_M
from models.common.frames import quaternion_from_euler

SYSTEM = 1
AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1
COMPANION = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
PILOT_SYSTEM = 255
PILOT_COMPONENT = mavlink.MAV_COMP_ID_MISSIONPLANNER
"""Ids that ground stations use by default."""
SHORTEST_INTERVAL_S = 0.003
"""ArduPilot refuses a shorter one."""
TRUSTED = 0x33F
"""ESTIMATOR_STATUS and EKF_STATUS_REPORT: attitude, velocities, positions relative and absolute, their forecasts."""
_NO_TEMPERATURE = 32767
"""Battery temperature that is not known."""
_LEAST_CM = round(100.0 * RANGE_MIN_M)
_MOST_CM = round(100.0 * RANGE_MAX_M)
Messages = list[Any]


@dataclass
class _Stream:
    build: Callable[[], Messages]
    interval_s: float
    due_s: float


class VehicleLink:
    """Encodes and decodes for one vehicle on one link with one peer. ``send`` takes whole frames."""

    messages_per_s = 1290.0
    """What the link carries at most, as measured on the real one."""
    firmware: int = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    range_covariance = 255
    """255: unknown; PX4 says 0."""
    says_mode_at_once = True
    """ArduPilot announces a change of mode at once, PX4 with its next heartbeat."""

    def __init__(self, flight: SimulatedFlight, send: Callable[[bytes], None]) -> None:
        self._flight = flight
        self._send = send
        self._mav = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=AUTOPILOT)
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
        self.attitude_stream_s = -math.inf
        """Boot time of the last SET_ATTITUDE_TARGET that was taken."""
        self.attitude_since_s = math.inf
        """Boot time since which that stream has been flowing."""
        self._builders = self._message_table()

    # -- out --------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Send what is due. Call once per physics step or so."""
        now = self._flight.time_s
        self._tokens = min(20.0, self._tokens + (now - self._last_s) * self.messages_per_s)
        self._last_s = now
        changed = self._flight.autopilot.mode is not self._mode_said and self.says_mode_at_once
        if now >= self._heartbeat_s or changed:
            self._heartbeat_s += 0.0 if changed else 1.0
            self._mode_said = self._flight.autopilot.mode
            self._out(*self._heartbeat())
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
            self._out(*stream.build())

    def route(self, message: Any) -> None:
        """Forward a message of the pilot to the companion's link, as the autopilot's router does."""
        self._send(message.pack(self._pilot))

    def _out(self, *messages: Any) -> None:
        for message in messages:
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

    def mode_numbers(self, mode: Mode) -> tuple[int, int]:
        """Main and sub mode of MAV_CMD_DO_SET_MODE."""
        return int(mode), 0

    def _custom_mode(self) -> int:
        return int(self._flight.autopilot.mode)

    def _message_table(self) -> dict[int, Callable[[], Messages]]:
        """What can be asked for, by message id."""
        table = {
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
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._estimator_status,
        }
        if self._flight.ranges:
            table[mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR] = self._distances
        if self._flight.rings:
            table[mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE] = self._obstacles
        if self._flight.vehicle.telemetered:
            table[mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4] = self._esc_telemetry
        return table

    def _heartbeat(self) -> Messages:
        pilot = self._flight.autopilot
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if pilot.armed:
            base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        if pilot.mode in pilot.stream_modes:
            base |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        coaxial = any(len(fan.rotors) > 1 for fan in self._flight.vehicle.fans)
        beat = mavlink.MAVLink_heartbeat_message(
            type=mavlink.MAV_TYPE_COAXIAL if coaxial else mavlink.MAV_TYPE_QUADROTOR,
            autopilot=self.firmware,
            base_mode=base,
            custom_mode=self._custom_mode(),
            system_status=mavlink.MAV_STATE_STANDBY if pilot.landed else mavlink.MAV_STATE_ACTIVE,
            mavlink_version=3,
        )
        return [beat]

    def _attitude(self) -> Messages:
        e = self._flight.estimate
        return [mavlink.MAVLink_attitude_message(self.boot_ms, e.roll, e.pitch, e.yaw, *e.rates)]

    def _attitude_quaternion(self) -> Messages:
        e = self._flight.estimate
        return [mavlink.MAVLink_attitude_quaternion_message(self.boot_ms, *e.quaternion, *e.rates)]

    def _highres_imu(self) -> Messages:
        e = self._flight.estimate
        air = (0.2, 0.0, 0.4, 1013.25, 0.0, 0.0, 25.0, 0x3F)
        return [
            mavlink.MAVLink_highres_imu_message(self.boot_us, *e.specific_force, *e.rates, *air)
        ]

    def _local_position(self) -> Messages:
        e = self._flight.estimate
        return [mavlink.MAVLink_local_position_ned_message(self.boot_ms, *e.position, *e.velocity)]

    def _estimator_status(self) -> Messages:
        return [mavlink.MAVLink_ekf_status_report_message(TRUSTED, 0.05, 0.05, 0.05, 0.05, 0.0)]

    def _servo_output(self) -> Messages:
        pwm = [int(v) for v in self._flight.autopilot.mixer.pwm]
        return [mavlink.MAVLink_servo_output_raw_message(self.boot_us & 0xFFFFFFFF, 0, *pwm)]

    def _attitude_target(self) -> Messages:
        a = self._flight.autopilot
        q = quaternion_from_euler(*a.shaped)
        thrust = max(0.0, min(1.0, a.throttle))
        rates = a.shaped_rates
        return [mavlink.MAVLink_attitude_target_message(self.boot_ms, 0, q, *rates, thrust)]

    def _battery(self) -> Messages:
        pack = self._flight.body.pack
        left = round(100.0 * (1.0 - pack.used_ah / pack.capacity_ah))
        status = mavlink.MAVLink_battery_status_message(
            id=0,
            battery_function=0,
            type=1,
            temperature=_NO_TEMPERATURE,
            voltages=[round(1000.0 * pack.voltage_v)] + [65535] * 9,
            current_battery=round(100.0 * pack.current_a),
            current_consumed=round(1000.0 * pack.used_ah),
            energy_consumed=-1,
            battery_remaining=max(0, left),
        )
        return [status]

    def _landed_state(self) -> int:
        pilot = self._flight.autopilot
        if pilot.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if pilot.taking_off:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        return int(mavlink.MAV_LANDED_STATE_IN_AIR)

    def _extended_state(self) -> Messages:
        return [mavlink.MAVLink_extended_sys_state_message(0, self._landed_state())]

    def _pressure(self) -> Messages:
        hpa = 1013.25 + 0.12013 * self._flight.body.position[2]
        return [mavlink.MAVLink_scaled_pressure_message(self.boot_ms, hpa, 0.0, 1500)]

    def _distances(self) -> Messages:
        out = []
        for index, sensor in enumerate(self._flight.ranges):
            message = mavlink.MAVLink_distance_sensor_message(
                time_boot_ms=self.boot_ms,
                min_distance=_LEAST_CM,
                max_distance=_MOST_CM,
                current_distance=round(100.0 * sensor.reading_m),
                type=mavlink.MAV_DISTANCE_SENSOR_LASER,
                id=index,
                orientation=sensor.sensor.orientation,
                covariance=self.range_covariance,
            )
            out.append(message)
        return out

    def _obstacles(self) -> Messages:
        out = []
        for ring in self._flight.rings:
            read = [min(round(100.0 * beam.reading_m), _MOST_CM + 1) for beam in ring]
            step_deg = 360.0 / len(ring)
            message = mavlink.MAVLink_obstacle_distance_message(
                time_usec=self.boot_us,
                sensor_type=mavlink.MAV_DISTANCE_SENSOR_LASER,
                distances=read + [65535] * (72 - len(read)),
                increment=round(step_deg),
                min_distance=_LEAST_CM,
                max_distance=_MOST_CM,
                increment_f=step_deg,
                angle_offset=0.0,
                frame=mavlink.MAV_FRAME_BODY_FRD,
            )
            out.append(message)
        return out

    def _esc_rpm(self) -> list[float]:
        """Speeds by ESC number, from 1; zero where no ESC is fitted."""
        rotors = self._flight.vehicle.rotors
        out = [0.0] * (4 * math.ceil(max(r.esc or 0 for r in rotors) / 4))
        for rotor, rpm in zip(rotors, self._flight.esc.rpm, strict=True):
            if rotor.esc:
                out[rotor.esc - 1] = rpm
        return out

    def _esc_telemetry(self) -> Messages:
        f = self._flight
        rpm = [round(v) for v in self._esc_rpm()]
        groups = (
            mavlink.MAVLink_esc_telemetry_1_to_4_message,
            mavlink.MAVLink_esc_telemetry_5_to_8_message,
            mavlink.MAVLink_esc_telemetry_9_to_12_message,
        )
        volts = round(100.0 * f.body.pack.voltage_v)
        amps = round(100.0 * f.body.pack.current_a / len(f.body.rpm))
        same = [[v] * 4 for v in (int(f.esc.temperature_c), volts, amps, 0)]
        count = [f.esc.count & 0xFFFF] * 4
        out = []
        for i, message in enumerate(groups[: len(rpm) // 4]):
            speeds = rpm[4 * i : 4 * i + 4]
            out.append(message(*same, speeds, count))
        return out

    # -- in ---------------------------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Bytes from the peer."""
        for message in self._parser.parse_buffer(data) or []:
            if message.get_type() != "BAD_DATA":
                self.hear(message)

    def hear(self, message: Any) -> None:
        """One message: obeyed where it is for us, for all, or for nobody in particular."""
        handler = getattr(self, f"_on_{message.get_type().lower()}", None)
        system = getattr(message, "target_system", SYSTEM)
        if handler is not None and system in (0, SYSTEM) and self._for_us(message):
            handler(message)

    def _for_us(self, message: Any) -> bool:
        return getattr(message, "target_component", 0) in (0, AUTOPILOT)

    def _on_timesync(self, m: Any) -> None:
        if m.tc1 == 0:
            self._out(mavlink.MAVLink_timesync_message(1_000_000 * self.boot_ms, m.ts1))

    def _on_set_attitude_target(self, m: Any) -> None:
        pilot = self._flight.autopilot
        now = self._flight.time_s
        if pilot.mode not in pilot.stream_modes:
            return
        rates = None
        if m.type_mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE:
            rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
        roll, pitch, yaw = (0.0, 0.0, 0.0) if rates else euler(m.q)
        demand = AttitudeDemand(
            roll=roll,
            pitch=pitch,
            yaw=yaw,
            rates=rates,
            thrust=max(0.0, min(1.0, m.thrust)),
            time_s=now,
        )
        pilot.fly_attitude(demand)
        if now - self.attitude_stream_s > 0.3:
            self.attitude_since_s = now
        self.attitude_stream_s = now

    def _on_set_position_target_local_ned(self, m: Any) -> None:
        """A place in the local frame, with or without a velocity and a heading."""
        pilot = self._flight.autopilot
        f = self._flight
        if pilot.mode is Mode.GUIDED and not pilot.landed:
            target = PositionTarget(position=(m.x, m.y, m.z), time_s=f.time_s)
            if not m.type_mask & 0x38:
                target.velocity = (m.vx, m.vy, m.vz)
            if not m.type_mask & 0x400:
                target.yaw = m.yaw
            pilot.fly_to(target, f.estimate)

    def _on_command_long(self, m: Any) -> None:
        self._out(mavlink.MAVLink_command_ack_message(m.command, self._command(m)))

    def _command(self, m: Any) -> int:
        if m.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            taken = self.set_interval(int(m.param1), m.param2)
            return int(mavlink.MAV_RESULT_ACCEPTED if taken else mavlink.MAV_RESULT_DENIED)
        if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            done = self._flight.autopilot.arm(m.param1 > 0.5)
        elif m.command == mavlink.MAV_CMD_DO_SET_MODE:
            done = self._set_mode(int(m.param2), int(m.param3))
        elif m.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            done = self._take_off(m.param7)
        else:
            return int(mavlink.MAV_RESULT_UNSUPPORTED)
        return int(mavlink.MAV_RESULT_ACCEPTED if done else mavlink.MAV_RESULT_FAILED)

    def _take_off(self, height_m: float) -> bool:
        pilot = self._flight.autopilot
        return pilot.mode is Mode.GUIDED and pilot.take_off(height_m, self._flight.estimate)

    def _set_mode(self, main: int, sub: int) -> bool:
        if main not in list(Mode):
            return False
        self._flight.autopilot.set_mode(Mode(main), self._flight.estimate)
        return True

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

    # -- parameters -------------------------------------------------------------------------------------------------

    def _send_param(self, name: str) -> None:
        parameters = self._flight.autopilot.parameters
        value = mavlink.MAVLink_param_value_message(
            param_id=name.encode(),
            param_value=parameters[name],
            param_type=mavlink.MAV_PARAM_TYPE_REAL32,
            param_count=len(parameters),
            param_index=list(parameters).index(name),
        )
        self._out(value)

    def _on_param_request_read(self, m: Any) -> None:
        names = list(self._flight.autopilot.parameters)
        if m.param_index < 0:
            name = m.param_id
        elif m.param_index < len(names):
            name = names[m.param_index]
        else:
            name = ""
        if name in names:
            self._param_queue.append(name)
