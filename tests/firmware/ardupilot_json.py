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

from companion.sim.body import Body
from companion.sim.scenario import Scenario
from companion.sim.sensors import RangeSensor
from companion.sim.world import law_of
from models.common.errors import LinkError
from models.vehicle import Vehicle

MAGIC_16, MAGIC_32 = 18458, 29569
"""First number of a packet with 16 or 32 servo outputs (ArduPilot, SITL JSON interface)."""
_HEADER = struct.Struct("<HHI")
RATES_HZ = (50, 4000)
"""Frame rates that are taken for real."""
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
        self, vehicle: Vehicle, scenario: Scenario, seed: int, body: type[Body] = Body
    ) -> None:
        self._body_type = body
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
        self.body.step(packet.pwm)
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

    def _state(self) -> dict[str, object]:
        b = self.body
        return {
            "timestamp": b.time_s,
            "imu": {"gyro": b.rates, "accel_body": b.specific_force},
            "position": b.position,
            "quaternion": b.quaternion,
            "velocity": b.velocity,
            "velocity_wind": (0.0, 0.0, 0.0),
            "battery": {"voltage": b.pack.voltage_v, "current": b.pack.current_a},
            **{f"rng_{i}": sensor.reading_m for i, sensor in enumerate(self.ranges, 1)},
        }


def serve(
    physics: JsonPhysics, port: int, announce: Callable[[int], None], truth: Path | None = None
) -> NoReturn:
    """Answer on UDP ``port`` (0: any) until interrupted; ``announce`` gets the port, ``truth`` is written."""
    record: BodyTruthFile | None = None
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
            if truth is not None:
                record = record or BodyTruthFile(truth, physics.body)
                record.step(physics.body)
