"""A scripted autopilot: speaks real MAVLink, remembers what it was sent. No physics.

On loopback UDP it lives by the wall clock; ``paced_flight`` has one that lives by simulated time.
"""

from __future__ import annotations

import socket
import threading
import time
from typing import Any

from patience import HANG_S

from companion.mavlink.dialect import mavlink
from models.common.frames import quaternion_from_euler


class ScriptedAutopilot:
    """A hovering vehicle's messages at 50 Hz; ``boot_s`` may be set back (a reboot)."""

    autopilot = 3
    """MAV_AUTOPILOT: ArduPilot."""

    def __init__(self, system: int = 1, parameters: dict[str, float] | None = None):
        self.system = system
        self.parameters = (
            {"GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 0.5} if parameters is None else parameters
        )
        self.boot_s = 20.0
        self.armed, self.mode = True, 4
        self.height, self.wall = 0.3, 0.4
        self.silent = False
        self.received: list[Any] = []
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def send_raw(self, raw: bytes) -> None:
        raise NotImplementedError

    def of_type(self, name: str) -> list[Any]:
        return [m for m in list(self.received) if m.get_type() == name]

    def send(self, message: Any) -> None:
        self.send_raw(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256

    def tick(self, number: int) -> None:
        """The messages of one fiftieth of a second."""
        if self.silent:
            return
        m, ms = self._mav, int(self.boot_s * 1000)
        if number % 10 == 0:
            self.send(m.heartbeat_encode(2, self.autopilot, 128 if self.armed else 0, self.mode, 4))
            self.send(m.extended_sys_state_encode(0, 2))
        self.send(m.local_position_ned_encode(ms, 0.0, 0.0, -self.height, 0.0, 0.0, 0.0))
        for number_, orientation, distance in ((0, 25, self.height - 0.05), (1, 2, self.wall)):
            self.send(
                m.distance_sensor_encode(
                    ms, 5, 4000, round(distance * 100), 0, number_, orientation, 0
                )
            )
        self.send(
            m.esc_telemetry_1_to_4_encode(
                [20] * 4, [0] * 4, [0] * 4, [0] * 4, [4000] * 4, [number % 65536] * 4
            )
        )
        self.send(
            m.attitude_quaternion_encode(ms, *quaternion_from_euler(0.0, 0.0, 0.1), 0.0, 0.0, 0.0)
        )

    def hear(self, data: bytes) -> None:
        for message in self._parser.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA":
                continue
            self.received.append(message)
            if message.get_type() == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
                value = self.parameters[message.param_id]
                name = message.param_id.encode()
                self.send(self._mav.param_value_encode(name, value, 9, 2, 0))


class FakeAutopilot(ScriptedAutopilot):
    """On loopback UDP: sends to ``port`` from a thread."""

    def __init__(
        self,
        port: int,
        system: int = 1,
        parameters: dict[str, float] | None = None,
        rate_hz: float = 50.0,
    ):
        super().__init__(system, parameters)
        self._rate = rate_hz
        self._target = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> FakeAutopilot:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(HANG_S)
        self._socket.close()

    def wait_for(self, name: str, count: int = 1) -> list[Any]:
        end = time.monotonic() + HANG_S
        while time.monotonic() < end:
            found = self.of_type(name)
            if len(found) >= count:
                return found
            time.sleep(0.02)
        raise AssertionError(
            f"no {name} (x{count}) within {HANG_S} s; got {sorted({m.get_type() for m in self.received})}"
        )

    def send_raw(self, raw: bytes) -> None:
        self._socket.sendto(raw, self._target)

    def _run(self) -> None:
        tick, before = 0, time.monotonic()
        while not self._stop.is_set():
            self.tick(tick)
            self._receive()
            tick += 1
            time.sleep(1.0 / self._rate)
            # The boot clock is true even where this thread is slow: a slow clock would look like late messages.
            now = time.monotonic()
            self.boot_s += now - before
            before = now

    def _receive(self) -> None:
        while True:
            try:
                data = self._socket.recv(65536)
            except OSError:
                return
            self.hear(data)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
