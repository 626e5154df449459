"""The simulator's process: pacing, the UDP socket, and the end."""

from __future__ import annotations

import contextlib
import json
import math
import select
import socket
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from companion.sim.air import surrogate_error
from companion.sim.body import DT
from companion.sim.flight import Flight, TruthFile
from companion.sim.link import VehicleLink
from companion.sim.pilot import Hand, ScriptedPilot
from companion.sim.scenario import build
from models.errors import LinkError
from models.vehicle import Vehicle

BEHIND_S = 0.05
"""Wall-clock lag after which the simulation gives up the lost time instead of hurrying."""


STREAM_GAP_S = 0.025
"""Simulated time a running attitude stream may be behind before a hurried simulation waits for it."""
PATIENCE_S = 0.25
"""Wall-clock time it waits: a companion that stopped for good is not waited for again until it speaks."""


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


def run(options: Options) -> int:
    """Fly until the duration is over, the script has ended (with a truth file), or we are told to stop."""
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
        pilot = ScriptedPilot(flight, link, options.hand, endless=options.truth is None and options.duration_s is None)
        truth = stack.enter_context(contextlib.closing(TruthFile(options.truth, flight))) if options.truth else None
        print(json.dumps(_announcement(options, flight)), flush=True)
        _loop(options, flight, link, pilot, truth, sock)
    return 0


def _announcement(options: Options, flight: Flight) -> dict[str, object]:
    """The line that says the vehicle is up; it also tells how wrong the undisturbed law is in this air."""
    wrong = surrogate_error(flight.body.law)
    return {
        "endpoint": f"udpin:127.0.0.1:{options.port}",
        "scenario": options.scenario,
        "seed": options.seed,
        "surrogate_error": {"lift": round(wrong.lift, 3), "pull": round(wrong.pull, 3), "tilt": round(wrong.tilt, 3)},
    }


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
) -> None:
    wall_dt = DT / options.speed
    clock = time.monotonic
    patience = _Patience(link, sock) if options.speed > 1.0 and options.hand is Hand.COMPANION else None
    watched: list[object] = [sys.stdin] if options.until_stdin_closes else []
    end_s = _end_of(options, flight)
    due = clock()
    checked = due
    given_up_s = -math.inf
    while flight.time_s < end_s(flight):
        now = clock()
        if now < due:
            # Wake for whatever the peer says, too: a command is taken at the next step.
            time.sleep(due - now)
        elif now - due > BEHIND_S:
            due = now
        due += wall_dt
        _receive(sock, link)
        # Faster than life, a loaded machine would make the companion slower than it is: keep in step with its stream.
        if options.speed > 1.0 and link.attitude_stream_s != given_up_s and math.isfinite(link.attitude_stream_s):
            until = now + PATIENCE_S
            while flight.time_s - link.attitude_basis_s > STREAM_GAP_S:
                if clock() > until:
                    given_up_s = link.attitude_stream_s
                    break
                select.select([sock], [], [], 0.01)
                _receive(sock, link)
        flight.step()
        pilot.step()
        link.step()
        if truth is not None:
            truth.step()
        if watched and now - checked > 0.2:
            checked = now
            if select.select(watched, [], [], 0.0)[0] and not sys.stdin.buffer.read1(1024):
                return


def _receive(sock: socket.socket, link: VehicleLink) -> None:
    while True:
        try:
            data = sock.recv(4096)
        except OSError:
            return
        link.receive(data)


class _Patience:
    """Faster than time, the simulator waits for the companion rather than run away from it.

    On a busy machine a companion that is scheduled 20 ms late would at fourfold speed fly with 80 ms of delay that no
    real vehicle has, and one with a backlog would stay behind for good. So the clock stands while the companion's last
    setpoint was computed from news older than ``LATE_S`` (its ``time_boot_ms``), for 50 ms of wall clock at most;
    a stream that does not come again is no longer waited for. At real time nothing waits for anybody.
    """

    LATE_S = 0.04
    WALL_S = 0.05

    def __init__(self, link: VehicleLink, sock: socket.socket) -> None:
        self._link = link
        self._sock = sock
        self._vain = 0
        self._given_up_at = -1.0

    def wait(self, now_s: float) -> None:
        """Hold the clock while the next setpoint is overdue."""
        link = self._link
        if now_s - link.command_stamp_s < self.LATE_S or now_s - link.attitude_stream_s > 1.0 or self._vain > 20:
            return
        if link.attitude_stream_s == self._given_up_at:
            return
        until = time.monotonic() + self.WALL_S
        while now_s - link.command_stamp_s >= self.LATE_S:
            left = until - time.monotonic()
            if left <= 0.0:
                self._vain += 1
                self._given_up_at = link.attitude_stream_s
                return
            if select.select([self._sock], [], [], left)[0]:
                try:
                    data = self._sock.recv(4096)
                except OSError:
                    continue
                link.receive(data)
        self._vain = 0


def _end_of(options: Options, flight: Flight):  # type: ignore[no-untyped-def]
    length = flight.scenario.duration_s

    def end(f: Flight) -> float:
        if options.duration_s is not None:
            return options.duration_s
        if options.truth is not None and f.script_s > length:
            return f.time_s
        return float("inf")

    return end
