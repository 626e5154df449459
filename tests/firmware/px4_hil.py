"""The same physics behind PX4's simulator link (TCP 4560): the real firmware in our corner, in lockstep.

PX4 connects to us. Out: HIL_SENSOR (250 Hz; magnetometer and barometer at their own rates), HIL_GPS 10 Hz,
DISTANCE_SENSOR 50 Hz. In: HIL_ACTUATOR_CONTROLS, motors 0...1 by output number, vanes -1...1. The vehicle waits for the
answer to each HIL_SENSOR; before PX4's outputs run none comes, and time goes on.
Source: PX4's simulation API, docs.px4.io/main/en/simulation (MAVLink HIL messages, lockstep).
"""

from __future__ import annotations

import contextlib
import math
import random
import select
import socket
import time
from collections.abc import Callable
from typing import Any

from body_truth import BodyTruthFile
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rough_air import RoughBody
from wrong_sensors import WrongSensors

from companion.mavlink import wire_frames
from companion.mavlink.esc_messages import ESC_STATUS
from companion.sim.body import Body, MotorOutput
from companion.sim.scenario import Scenario
from companion.sim.sensors import RANGE_MAX_M, RANGE_MIN_M, EscTelemetry, RangeSensor
from companion.sim.world import law_of
from models.common.errors import LinkError
from models.vehicle import Vehicle

PORT = 4560
"""TCP port on which PX4 looks for its simulator."""
STEP_S, SUBSTEPS = 0.004, 2
"""PX4's lockstep runs at 250 Hz; the physics twice as fast."""
HOME_LAT_DEG, HOME_LON_DEG, HOME_ALT_M = 47.397742, 8.545594, 488.0
"""PX4's default home of simulations: Zurich."""
FIELD_NED_GAUSS = (0.2126, 0.0118, 0.4254)
"""The earth's magnetic field there (World Magnetic Model); PX4 checks strength and inclination."""
METRES_PER_DEG = 111_319.49
"""Of latitude, and of longitude at the equator: WGS 84, 6 378 137 m of radius."""
ESCS = 4
"""In one ESC_STATUS."""
ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED."""
_IMU, _MAG, _BARO = 0x3F, 0x1C0, 0x200 | 0x800 | 0x1000
"""HIL_SENSOR.fields_updated."""
_MAG_EVERY, _BARO_EVERY, _RANGE_EVERY, _GPS_EVERY, _BEAT_EVERY = 2, 5, 5, 25, 250
"""Steps between two messages: 125, 50, 50, 10 and 1 Hz."""
_ANSWERS_BEFORE_PATIENCE = 50
"""PX4 answers not every step while it boots."""
_PATIENCE_S, _IMPATIENCE_S = 0.4, STEP_S
"""Wall-clock time that an answer is waited for: once PX4 runs, and before."""
_MOTOR = MotorOutput(0.0, 1.0, 0.0)
"""PX4's command is the output."""
_VANE_TRAVEL_RAD = 0.5
"""Of a full output."""


class Px4Physics:
    """Sensor messages out, actuator outputs in; owns the body. No sockets here."""

    def __init__(
        self,
        vehicle: Vehicle,
        scenario: Scenario,
        seed: int,
        body: type[Body] = Body,
        *,
        wrong: WrongSensors | None = None,
    ) -> None:
        self._wrong = wrong or WrongSensors()
        dt = STEP_S / SUBSTEPS
        self.body = body(
            vehicle=vehicle,
            surroundings=scenario.surroundings,
            law=law_of(scenario.name, seed),
            seed=seed,
            dt=dt,
            motor=_MOTOR,
        )
        self._vehicle = vehicle
        self.ranges = [
            RangeSensor(r, f"range {seed} {i}") for i, r in enumerate(vehicle.rangefinders)
        ]
        self._speeds = EscTelemetry(self.body, seed)
        self._noise = random.Random(f"hil {seed}")
        self._mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=51)
        self._speeds_sent = 0
        self._count = 0
        self._pwm = [1000.0] * 16
        self._release([0.0] * 16)

    @property
    def time_us(self) -> int:
        """Simulated time; never zero, which PX4 takes for none."""
        return 1_000_000 + round(self.body.time_s * 1e6)

    def sensors(self) -> bytes:
        """Every message that is due now, HIL_SENSOR last: it is what PX4 answers."""
        k, out = self._count, b""
        if k % _BEAT_EVERY == 0:
            out += self._pack(mavlink.MAVLink_heartbeat_message(0, 8, 0, 0, 4, 3))
        if k % _GPS_EVERY == 0:
            out += self._pack(self._gps())
        if k % _RANGE_EVERY == 0:
            for i, sensor in enumerate(self.ranges):
                out += self._pack(self._range(i, sensor))
        return out + self._pack(self._sensor(k))

    def step(self, controls: list[float] | None) -> None:
        """Advance by one period under the outputs of one HIL_ACTUATOR_CONTROLS; None: as before."""
        if controls is not None:
            self._release(controls)
        self._wrong.look(self.body)
        if isinstance(self.body, RoughBody):
            self.body.gust = self._wrong.wrong.gust_m_s
        for _ in range(SUBSTEPS):
            self.body.step(self._pwm)
        self._speeds.step(self.body)
        for sensor in self.ranges:
            sensor.step(self.body)
        self._count += 1

    def _release(self, controls: list[float]) -> None:
        for channel in self.body.rotor_channels:
            self._pwm[channel] = 1000.0 + 1000.0 * min(1.0, max(0.0, controls[channel]))
        for vane in self._vehicle.vanes:
            share = min(1.0, max(-1.0, controls[vane.servo - 1]))
            self._pwm[vane.servo - 1] = vane.neutral_us + share * _VANE_TRAVEL_RAD / vane.rad_per_us

    def _pack(self, message: Any) -> bytes:
        raw = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return raw

    def _sensor(self, k: int) -> Any:
        b, gauss = self.body, self._noise.gauss
        accel = [v + gauss(0.0, 0.02) for v in b.specific_force]
        gyro = [v + gauss(0.0, 0.001) for v in b.rates]
        r, (fn, fe, fd) = b.rotation(), FIELD_NED_GAUSS
        field = [r[i] * fn + r[3 + i] * fe + r[6 + i] * fd + gauss(0.0, 0.0006) for i in range(3)]
        altitude = HOME_ALT_M - b.position[2]
        hpa = 1013.25 * (1.0 - 2.25577e-5 * altitude) ** 5.25588 + gauss(0.0, 0.004)
        updated = (
            _IMU | (_MAG if k % _MAG_EVERY == 0 else 0) | (_BARO if k % _BARO_EVERY == 0 else 0)
        )
        return mavlink.MAVLink_hil_sensor_message(
            self.time_us, *accel, *gyro, *field, hpa, 0.0, altitude, 15.0, updated
        )

    def _gps(self) -> Any:
        b, gauss = self.body, self._noise.gauss
        position, (vn, ve, vd) = self._wrong.motion(b)
        n, e, d = (v + gauss(0.0, 0.01) for v in position)
        east_m = METRES_PER_DEG * math.cos(math.radians(HOME_LAT_DEG))
        lat, lon = HOME_LAT_DEG + n / METRES_PER_DEG, HOME_LON_DEG + e / east_m
        cm = [round(100.0 * v) for v in (math.hypot(vn, ve), vn, ve, vd)]
        return mavlink.MAVLink_hil_gps_message(
            self.time_us,
            3,
            round(lat * 1e7),
            round(lon * 1e7),
            round(1e3 * (HOME_ALT_M - d)),
            30,
            40,
            *cm,
            65535,
            14,
        )

    def speeds(self) -> bytes:
        """ESC_STATUS with the speeds of the rotors, once for each time that they were sampled; else nothing."""
        if self._speeds.count == self._speeds_sent:
            return b""
        self._speeds_sent = self._speeds.count
        rpm = [round(v) for v in self._speeds.rpm]
        out = b""
        for first in range(0, len(rpm), ESCS):
            four = (rpm[first : first + ESCS] + [0] * ESCS)[:ESCS]
            volts_and_amps = [0.0] * (2 * ESCS)
            payload = ESC_STATUS.unpacker.pack(self.time_us, *four, *volts_and_amps, first)
            out += wire_frames.pack(ESC_STATUS.id, payload, 1, 1, self._speeds.count % 256)
        return out

    def _range(self, i: int, sensor: RangeSensor) -> Any:
        reading = self._wrong.range_m(sensor.sensor.target, sensor.reading_m, self.body)
        return mavlink.MAVLink_distance_sensor_message(
            self.time_us // 1000,
            round(100.0 * RANGE_MIN_M),
            round(100.0 * RANGE_MAX_M),
            round(100.0 * reading),
            mavlink.MAV_DISTANCE_SENSOR_LASER,
            i,
            sensor.sensor.orientation,
            1,
        )


def serve(
    physics: Px4Physics,
    port: int,
    announce: Callable[[int], None],
    *,
    speed: float = 1.0,
    duration_s: float | None = None,
    truth: BodyTruthFile | None = None,
    speeds_port: int | None = None,
) -> None:
    """Wait for PX4 on TCP ``port`` (0: any), then fly with it until it leaves; ``announce`` gets the port.

    ``speeds_port``: UDP port of this machine that rotor speeds are sent to, as frames of MAVLink.
    Raises LinkError where the port cannot be opened.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(("127.0.0.1", port))
        except OSError as error:
            raise LinkError(
                f"--px4-hil {port}: TCP port cannot be opened ({error.strerror}); choose another"
            ) from None
        listener.listen(1)
        announce(listener.getsockname()[1])
        peer, _ = listener.accept()
    with peer:
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as speeds:
            if speeds_port is not None:
                speeds.connect(("127.0.0.1", speeds_port))
            _fly(physics, peer, speed, duration_s, truth, speeds if speeds_port else None)


def _fly(
    physics: Px4Physics,
    peer: socket.socket,
    speed: float,
    duration_s: float | None,
    truth: BodyTruthFile | None,
    speeds: socket.socket | None,
) -> None:
    answers = _Answers(peer)
    due = time.monotonic()
    while duration_s is None or physics.body.time_s < duration_s:
        try:
            peer.sendall(physics.sensors())
            controls = answers.wait()
        except (ConnectionError, EOFError):
            return
        physics.step(controls)
        if truth is not None:
            truth.step()
        if speeds is not None:
            _send(speeds, physics.speeds())
        # No faster than the clock; a machine that is too slow stretches time rather than catching up.
        due = max(due + STEP_S / speed, time.monotonic() - 0.25)
        time.sleep(max(0.0, due - time.monotonic()))


def _send(speeds: socket.socket, frames: bytes) -> None:
    """Rotor speeds, where there are new ones and somebody listens."""
    if frames:
        with contextlib.suppress(ConnectionError):
            speeds.send(frames)


class _Answers:
    """Reads HIL_ACTUATOR_CONTROLS; patient once they have been coming."""

    def __init__(self, peer: socket.socket) -> None:
        self._peer = peer
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._count = 0

    def wait(self) -> list[float] | None:
        """The outputs that answer the last HIL_SENSOR; None where no answer came in time.

        Raises EOFError when PX4 has gone.
        """
        until = time.monotonic() + (
            _PATIENCE_S if self._count > _ANSWERS_BEFORE_PATIENCE else _IMPATIENCE_S
        )
        while (left := until - time.monotonic()) > 0.0:
            if not select.select([self._peer], [], [], left)[0]:
                return None
            data = self._peer.recv(4096)
            if not data:
                raise EOFError
            found = [
                m
                for m in self._parser.parse_buffer(data) or []
                if m.get_type() == "HIL_ACTUATOR_CONTROLS"
            ]
            if found:
                self._count += len(found)
                last = found[-1]
                return list(last.controls) if last.mode & ARMED else [0.0] * 16
        return None
