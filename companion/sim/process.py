"""The simulator's process: pacing, the UDP socket, and the end."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from companion.sim.body import DT
from companion.sim.flight import Flight, TruthFile
from companion.sim.link import VehicleLink
from companion.sim.narrator import Narrator
from companion.sim.pilot import Recipient, ScriptedPilot

BEHIND_S = 0.05
"""Wall-clock lag after which the simulation gives up the lost time instead of hurrying."""


@dataclass(frozen=True)
class Options:
    """How a flight is run."""

    port: int
    speed: float = 1.0
    recipient: Recipient = Recipient.COMPANION
    truth: Path | None = None
    duration_s: float | None = None
    until_stdin_closes: bool = False
    narrate: bool = False

    def over(self, flight: Flight) -> bool:
        """Whether the flight has lasted as long as it was to."""
        if self.duration_s is not None:
            return flight.time_s >= self.duration_s
        return self.truth is not None and flight.script_s > flight.scenario.duration_s


def run(flight: Flight, options: Options) -> None:
    """Fly until the duration is over, the script has ended (with a truth file), or it is interrupted."""
    with contextlib.ExitStack() as stack:
        sock = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        sock.bind(("127.0.0.1", 0))
        sock.setblocking(False)
        peer = ("127.0.0.1", options.port)

        def send(frame: bytes) -> None:
            # Nobody listening yet is no error: a vehicle speaks whether heard or not.
            with contextlib.suppress(OSError):
                sock.sendto(frame, peer)

        link = VehicleLink(flight, send)
        endless = options.truth is None and options.duration_s is None
        pilot = ScriptedPilot(flight, link, options.recipient, endless=endless, speed=options.speed)
        steps = [lambda: _receive(sock, link), flight.step, pilot.step, link.step]
        if options.truth is not None:
            steps.append(stack.enter_context(contextlib.closing(TruthFile(options.truth, flight))).step)
        if options.narrate:
            steps.append(Narrator(flight).step)
        up = {"endpoint": f"udpin:127.0.0.1:{options.port}", "scenario": flight.scenario.name, "seed": flight.seed}
        print(json.dumps(up), flush=True)
        _loop(options, flight, steps)


def _loop(options: Options, flight: Flight, steps: Sequence[Callable[[], None]]) -> None:
    wall_dt = DT / options.speed
    checked = due = time.monotonic()
    while not options.over(flight):
        now = time.monotonic()
        if now < due:
            time.sleep(due - now)
        elif now - due > BEHIND_S:
            due = now
        due += wall_dt
        for step in steps:
            step()
        if options.until_stdin_closes and now - checked > 0.2:
            checked = now
            if select.select([sys.stdin.fileno()], [], [], 0.0)[0] and not os.read(sys.stdin.fileno(), 1024):
                return


def _receive(sock: socket.socket, link: VehicleLink) -> None:
    with contextlib.suppress(OSError):  # nothing waits, or nobody listens yet
        while True:
            link.receive(sock.recv(4096))
