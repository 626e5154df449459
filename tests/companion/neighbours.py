"""Real programs that share a vehicle's link with the flight program: started, wired, and ended.

The vehicle is the built-in one, over UDP, with nobody at its sticks. A hub (mavlink-router or MAVProxy) has its port
and gives the flight program and a ground station ports of their own.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from fake_autopilot import free_port
from flight_process import flight_command
from patience import HANG_S
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated import Nobody, simulated

from companion.sim.process import launch
from companion.sim.scenario import build
from companion.vehicles import default_vehicle

PROGRAMS = {"mavlink-router": "mavlink-routerd", "mavproxy": "mavproxy.py"}
TO_COMPANION = 191
_PLACE = 0x38 | 0x1C0 | 0x400 | 0x800
"""type_mask: a position alone."""


@contextlib.contextmanager
def running(command: list[str], **how: Any) -> Iterator[subprocess.Popen[str]]:
    """A process that ends with the block: asked to, then made to."""
    process = subprocess.Popen(command, text=True, **how)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(HANG_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def missing(kind: str) -> str | None:
    """Why a test that needs this program is skipped; None where it is installed."""
    return None if shutil.which(PROGRAMS[kind]) else f"{PROGRAMS[kind]} is not installed"


@contextlib.contextmanager
def hub(kind: str, folder: Path, vehicle_port: int, *ports: int) -> Iterator[None]:
    """Forwards between the vehicle, which sends to ``vehicle_port``, and programs that listen on ``ports``."""
    silent = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
        "cwd": folder,
    }
    if kind == "mavproxy":
        outs = [f"--out=udpout:127.0.0.1:{port}" for port in ports]
        options = ["--non-interactive", "--daemon", f"--state-basedir={folder}", *outs]
        with running(
            [PROGRAMS[kind], f"--master=udpin:127.0.0.1:{vehicle_port}", *options], **silent
        ):
            yield
        return
    lines = ["[General]", "TcpServerPort=0"]
    for name, mode, port in [
        ("vehicle", "Server", vehicle_port),
        *((f"p{p}", "Normal", p) for p in ports),
    ]:
        lines += [f"[UdpEndpoint {name}]", f"Mode={mode}", "Address=127.0.0.1", f"Port={port}"]
    (folder / "router.conf").write_text("\n".join(lines) + "\n", encoding="utf-8")
    with running([PROGRAMS[kind], "-c", "router.conf"], **silent):
        yield


class Station:
    """A ground station: system 255, component 190. Keeps what it hears."""

    def __init__(self, port: int) -> None:
        self.link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{port}", source_system=255, source_component=190
        )
        self.heard: list[Any] = []
        self._lock = threading.Lock()
        self._open = True
        self._threads = [
            threading.Thread(target=f, daemon=True) for f in (self._listen, self._beat)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Station:
        return self

    def __exit__(self, *_: object) -> None:
        self._open = False
        for thread in self._threads:
            thread.join(HANG_S)
        self.link.close()

    def _listen(self) -> None:
        while self._open:
            message = self.link.recv_match(blocking=True, timeout=0.2)
            if message is not None and message.get_type() != "BAD_DATA":
                self.heard.append(message)

    def _beat(self) -> None:
        while self._open:
            self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            time.sleep(0.5)

    def send(self, message: Any) -> None:
        with self._lock:
            self.link.mav.send(message)

    def command(self, number: int, *values: float) -> None:
        p = [*values, *[0.0] * (7 - len(values))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *p))

    def rate(self, message_id: int, hz: float) -> None:
        self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / hz)

    def of(self, kind: str, component: int = 1) -> list[Any]:
        return [
            m
            for m in list(self.heard)
            if m.get_type() == kind and m.get_srcComponent() == component
        ]

    def until(self, reached: Callable[[], Any], seconds: float, what: str) -> None:
        end = time.monotonic() + seconds
        while not reached():
            assert time.monotonic() < end, f"waited {seconds:g} s for {what}"
            time.sleep(0.05)

    @property
    def place(self) -> tuple[float, float, float]:
        """Where the autopilot says it is: north, east, height [m]."""
        last = self.of("LOCAL_POSITION_NED")[-1]
        return last.x, last.y, -last.z

    def take_off(self) -> None:
        """GUIDED, armed, and up to 1.5 m."""
        self.until(lambda: self.of("HEARTBEAT"), 40.0, "the autopilot's heartbeat")
        self.rate(32, 10.0)

        def armed() -> bool:
            self.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0)
            self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            time.sleep(0.5)
            return bool(self.of("HEARTBEAT") and self.of("HEARTBEAT")[-1].base_mode & 128)

        self.until(armed, 20.0, "arming")
        self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5)
        self.until(
            lambda: self.of("LOCAL_POSITION_NED") and self.place[2] > 1.3, 30.0, "the take-off"
        )

    def go(self, north: float, east: float, height: float) -> None:
        """A place for the flight program."""
        target = (1, TO_COMPANION, 1, _PLACE, north, east, -height)
        self.send(mavlink.MAVLink_set_position_target_local_ned_message(0, *target, *[0.0] * 8))


class Companion:
    """The flight program as a process of its own. ``result`` is its JSON once it has ended."""

    def __init__(self, process: subprocess.Popen[str], folder: Path, port: int) -> None:
        self.process, self.port = process, port
        self._json, self._words = folder / f"{port}.json", folder / f"{port}.txt"

    @property
    def words(self) -> str:
        return self._words.read_text(encoding="utf-8")

    def end(self) -> dict[str, Any]:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(HANG_S)
        return json.loads(self._json.read_text(encoding="utf-8"))


@contextlib.contextmanager
def companion(folder: Path, port: int, *options: str) -> Iterator[Companion]:
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = flight_command(port, "--json", str(folder / f"{port}.json"), *options)
    with (
        (folder / f"{port}.txt").open("w", encoding="utf-8") as words,
        running(
            command, stdin=subprocess.DEVNULL, stdout=words, stderr=words, env=environment
        ) as process,
    ):
        yield Companion(process, folder, port)


@contextlib.contextmanager
def wired(
    kind: str, folder: Path, *options: str, more: int = 0
) -> Iterator[tuple[Station, Companion, list[int]]]:
    """Vehicle, hub, flight program and station; ``more`` ports of the hub for others."""
    port, ours, theirs, *others = (free_port() for _ in range(3 + more))
    flight = simulated(default_vehicle(), build("hover", default_vehicle()), 5)
    with (
        hub(kind, folder, port, ours, theirs, *others),
        launch(flight, Nobody, port=port),
        Station(theirs) as station,
        companion(folder, ours, *options) as flying,
    ):
        yield station, flying, others
