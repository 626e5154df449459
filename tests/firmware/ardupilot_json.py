"""The same physics behind ArduPilot's JSON interface (``--model JSON:127.0.0.1``): the real firmware in our corner.

UDP, lock-step. In: little-endian ``uint16 magic, uint16 frame_rate_hz, uint32 frame_count, uint16 pwm[16 or 32]``.
Out: one line of JSON between newlines. A repeated ``frame_count`` (the firmware saw no answer in time) gets the last
answer again and is not stepped twice; one that goes back means that the firmware restarted, and so does the vehicle.
"""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from body_truth import BodyTruthFile
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rough_air import RoughBody
from wrong_sensors import WrongSensors

from companion.sim.body import Body
from companion.sim.scenario import Scenario
from companion.sim.sensors import EscTelemetry, RangeSensor
from companion.sim.world import law_of
from models.common.errors import LinkError
from models.vehicle import Vehicle

MAGIC_16, MAGIC_32 = 18458, 29569
"""First number of a packet with 16 or 32 servo outputs (ArduPilot, SITL JSON interface)."""
_HEADER = struct.Struct("<HHI")
RATES_HZ = (50, 4000)
"""Frame rates that are taken for real."""
ESCS = 4
"""In one ESC_TELEMETRY_1_TO_4."""
SENSORS_MAX = 6
"""Rangefinders that the interface carries."""


@dataclass(frozen=True)
class Packet:
    """Servo outputs [us] of one frame."""

    frame_rate_hz: int
    frame_count: int
    pwm: tuple[int, ...]


def parse(data: bytes) -> Packet | None:
    """A packet of the firmware, or None for anything else."""
    if len(data) < _HEADER.size:
        return None
    magic, rate, count = _HEADER.unpack_from(data)
    channels = {MAGIC_16: 16, MAGIC_32: 32}.get(magic)
    if (
        channels is None
        or len(data) < _HEADER.size + 2 * channels
        or not RATES_HZ[0] <= rate <= RATES_HZ[1]
    ):
        return None
    return Packet(rate, count, struct.unpack_from(f"<{channels}H", data, _HEADER.size))


class JsonPhysics:
    """Answers packets; owns the body. No sockets here."""

    def __init__(
        self,
        vehicle: Vehicle,
        scenario: Scenario,
        seed: int,
        body: type[Body] = Body,
        *,
        wrong: WrongSensors | None = None,
    ) -> None:
        self._body_type = body
        self._wrong = wrong or WrongSensors()
        self._vehicle = vehicle
        self._scenario = scenario
        self._seed = seed
        self._rate_hz = 0
        self._last_count: int | None = None
        self._answer = b""
        self.restarts = 0

    def answer(self, data: bytes) -> bytes | None:
        """The reply to one datagram; None where it is not a packet of the firmware."""
        packet = parse(data)
        if packet is None:
            return None
        if packet.frame_count == self._last_count:
            return self._answer
        if self._last_count is None or packet.frame_count < self._last_count:
            self.restarts += self._last_count is not None
            self._restart(packet.frame_rate_hz)
        elif packet.frame_rate_hz != self._rate_hz:
            # The firmware goes from its first rate to SIM_RATE_HZ by one hertz a frame.
            self._rate_hz = packet.frame_rate_hz
            self.body.change_step(1.0 / packet.frame_rate_hz)
        self._last_count = packet.frame_count
        self._wrong.look(self.body)
        if isinstance(self.body, RoughBody):
            self.body.gust = self._wrong.wrong.gust_m_s
        self.body.step(packet.pwm)
        self.speeds.step(self.body)
        for sensor in self.ranges:
            sensor.step(self.body)
        self._answer = b"\n" + json.dumps(self._state(), separators=(",", ":")).encode() + b"\n"
        return self._answer

    def _restart(self, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        law = law_of(self._scenario.name, self._seed)
        self.body = self._body_type(
            vehicle=self._vehicle,
            surroundings=self._scenario.surroundings,
            law=law,
            seed=self._seed,
            dt=1.0 / rate_hz,
        )
        sensors = self._vehicle.rangefinders[:SENSORS_MAX]
        self.ranges = [RangeSensor(r, f"range {self._seed} {i}") for i, r in enumerate(sensors)]
        self.speeds = EscTelemetry(self.body, self._seed)

    def _state(self) -> dict[str, object]:
        b = self.body
        position, velocity = self._wrong.motion(b)
        ranges = {}
        for i, one in enumerate(self.ranges, 1):
            ranges[f"rng_{i}"] = self._wrong.range_m(one.sensor.target, one.reading_m, b)
        return {
            "timestamp": b.time_s,
            "imu": {"gyro": b.rates, "accel_body": b.specific_force},
            "position": position,
            "quaternion": b.quaternion,
            "velocity": velocity,
            "velocity_wind": (0.0, 0.0, 0.0),
            "battery": {"voltage": b.pack.voltage_v, "current": b.pack.current_a},
            **ranges,
        }


def speed_frame(speeds: EscTelemetry, mav: mavlink.MAVLink) -> bytes:
    """ESC_TELEMETRY_1_TO_4 as the autopilot would send it; the interface itself carries no rotor speeds."""
    rpm = [*(round(v) for v in speeds.rpm[:ESCS]), *[0] * ESCS][:ESCS]
    nothing = [0] * ESCS
    return bytes(
        mavlink.MAVLink_esc_telemetry_1_to_4_message(
            [round(speeds.temperature_c)] * ESCS,
            nothing,
            nothing,
            nothing,
            rpm,
            [speeds.count % 65536] * ESCS,
        ).pack(mav)
    )


def serve(
    physics: JsonPhysics,
    port: int,
    announce: Callable[[int], None],
    truth: Path | None = None,
    speeds_port: int | None = None,
) -> NoReturn:
    """Answer on UDP ``port`` (0: any) until interrupted; ``announce`` gets the port, ``truth`` is written.

    ``speeds_port``: where rotor speeds are sent to, as frames of MAVLink on UDP.
    """
    record: BodyTruthFile | None = None
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sent = 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.bind(("0.0.0.0", port))
        except OSError as error:
            raise LinkError(
                f"--ardupilot-json {port}: UDP port cannot be opened ({error.strerror}); choose another"
            ) from None
        announce(sock.getsockname()[1])
        while True:
            data, peer = sock.recvfrom(4096)
            reply = physics.answer(data)
            if reply is None:
                continue
            sock.sendto(reply, peer)
            if speeds_port is not None and physics.speeds.count != sent:
                sent = physics.speeds.count
                sock.sendto(speed_frame(physics.speeds, mav), ("127.0.0.1", speeds_port))
            if truth is not None:
                record = record or BodyTruthFile(truth, physics.body)
                record.step(physics.body)
