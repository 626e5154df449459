"""The simulator's process: pacing, the UDP socket, and the end."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from companion.sim.body import DT
from companion.sim.flight import Flight, TruthFile
from companion.sim.link import VehicleLink
from companion.sim.narrator import Narrator
from companion.sim.pilot import Hand, ScriptedPilot
from companion.sim.scenario import build
from models.errors import LinkError
from models.vehicle import Vehicle

BEHIND_S = 0.05
"""Wall-clock lag after which the simulation gives up the lost time instead of hurrying."""


@dataclass(frozen=True)
class Options:
    """Everything the command line decides."""

    vehicle: Vehicle
    scenario: str
    port: int
    seed: int = 0
    speed: float = 1.0
    air: bool = True
    hand: Hand = Hand.COMPANION
    truth: Path | None = None
    duration_s: float | None = None
    px4: bool = False
    until_stdin_closes: bool = False
    narrate: bool = False


def run(options: Options) -> int:
    """Fly until the duration is over, the script has ended (with a truth file), or it is interrupted."""
    flight = Flight(
        options.vehicle, build(options.scenario, options.vehicle, air=options.air), options.seed, px4=options.px4
    )
    with contextlib.ExitStack() as stack:
        sock = stack.enter_context(_socket(options.port))
        peer = ("127.0.0.1", options.port)

        def send(frame: bytes) -> None:
            # Nobody listening yet is no error: a vehicle speaks whether heard or not.
            with contextlib.suppress(OSError):
                sock.sendto(frame, peer)

        link = VehicleLink(flight, send)
        pilot = ScriptedPilot(
            flight,
            link,
            options.hand,
            endless=options.truth is None and options.duration_s is None,
            speed=options.speed,
        )
        truth = stack.enter_context(contextlib.closing(TruthFile(options.truth, flight))) if options.truth else None
        print(json.dumps(_announcement(options)), flush=True)
        _loop(options, flight, link, pilot, truth, sock, Narrator(flight) if options.narrate else None)
    return 0


def _announcement(options: Options) -> dict[str, object]:
    """The line that says the vehicle is up."""
    return {"endpoint": f"udpin:127.0.0.1:{options.port}", "scenario": options.scenario, "seed": options.seed}


def _socket(port: int) -> socket.socket:
    try:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(("127.0.0.1", 0))
    except OSError as error:
        raise LinkError(f"simulator: no UDP socket towards port {port}: {error.strerror}") from None
    sock.setblocking(False)
    return sock


def _loop(
    options: Options,
    flight: Flight,
    link: VehicleLink,
    pilot: ScriptedPilot,
    truth: TruthFile | None,
    sock: socket.socket,
    narrator: Narrator | None,
) -> None:
    wall_dt = DT / options.speed
    clock = time.monotonic
    due = clock()
    checked = due
    while not _over(options, flight):
        now = clock()
        if now < due:
            # Wake for whatever the peer says, too: a command is taken at the next step.
            time.sleep(due - now)
        elif now - due > BEHIND_S:
            due = now
        due += wall_dt
        _receive(sock, link)
        flight.step()
        pilot.step()
        link.step()
        if truth is not None:
            truth.step()
        if narrator is not None:
            narrator.step()
        if options.until_stdin_closes and now - checked > 0.2:
            checked = now
            if select.select([sys.stdin.fileno()], [], [], 0.0)[0] and not os.read(sys.stdin.fileno(), 1024):
                return


def _receive(sock: socket.socket, link: VehicleLink) -> None:
    while True:
        try:
            data = sock.recv(4096)
        except OSError:
            return
        link.receive(data)


def _over(options: Options, flight: Flight) -> bool:
    """Whether the flight has lasted as long as it was to."""
    if options.duration_s is not None:
        return flight.time_s >= options.duration_s
    return options.truth is not None and flight.script_s > flight.scenario.duration_s
