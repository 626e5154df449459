"""The built-in vehicle in a process of its own: at the pace of the clock, real MAVLink over loopback UDP."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection

from companion.sim.body import DT
from companion.sim.flight import SimulatedFlight
from companion.sim.link import VehicleLink
from companion.sim.pilot import ScriptedPilot
from models.common.errors import LinkError

BEHIND_S = 0.05
"""Wall-clock lag after which the simulation gives up the lost time instead of hurrying."""
START_S = 20.0
"""The process speaks within this time."""


@dataclass(frozen=True)
class SimProcess:
    """A running simulator: ``endpoint`` is a pymavlink string to listen at, ``news`` what it tells of its script."""

    endpoint: str
    process: multiprocessing.process.BaseProcess
    news: Connection


def follow(
    news: Connection, say: Callable[[str], None], over: Callable[[], None]
) -> threading.Thread:
    """Repeat the phases of the script to the user, and call ``over`` at its end. Ends with the process that tells."""

    def listen() -> None:
        with contextlib.suppress(EOFError, OSError):
            while text := news.recv():
                say(f"sim: {text}")
            say("sim: the flight is over; --duration S goes on longer")
            over()

    thread = threading.Thread(target=listen, daemon=True, name="sim narrator")
    thread.start()
    return thread


def free_port() -> int:
    """A UDP port on loopback that nobody holds now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@contextlib.contextmanager
def launch(
    flight: SimulatedFlight, pilot: type[ScriptedPilot] = ScriptedPilot, *, port: int | None = None
) -> Iterator[SimProcess]:
    """Fly in another process for the length of a ``with`` block, to a companion on ``port`` (default: a free one).

    Raises LinkError where it does not start.
    """
    if port is None:
        port = free_port()
    fresh = multiprocessing.get_context("spawn")
    news, tell = fresh.Pipe(duplex=False)
    process = fresh.Process(target=_run, args=(flight, pilot, port, tell), daemon=True)
    process.start()
    tell.close()
    try:
        started = False
        with contextlib.suppress(EOFError):
            started = news.poll(START_S) and bool(news.recv())
        if not started:
            raise LinkError(f"sim:{flight.scenario.name}: the built-in vehicle did not start")
        yield SimProcess(f"udpin:127.0.0.1:{port}", process, news)
    finally:
        process.kill()
        process.join()


class Narrator:
    """Tells which phase of the script begins, and with an empty text, once, that it is over."""

    def __init__(self, flight: SimulatedFlight, tell: Callable[[str], None]) -> None:
        self._flight = flight
        self._tell = tell
        self._phase: str | None = None

    def step(self) -> None:
        """Call once per physics step."""
        flight = self._flight
        left_s = flight.scenario.duration_s - flight.script_s
        if left_s >= 0.0:
            phase = flight.reference.phase
        else:
            phase = ""
        if flight.script_s > 0.0 and self._phase != "" and phase != self._phase:
            self._phase = phase
            self._tell(phase and f"{phase} ({round(left_s)} s to go)")


def _run(
    flight: SimulatedFlight, pilot_kind: type[ScriptedPilot], port: int, news: Connection
) -> None:
    """Fly again and again, until the parent ends this process or itself."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches us as well: the companion has the last word
    parent = multiprocessing.parent_process()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.setblocking(False)

        def send(frame: bytes) -> None:
            # Nobody listening yet is no error: a vehicle speaks whether heard or not.
            with contextlib.suppress(OSError):
                sock.sendto(frame, ("127.0.0.1", port))

        link = pilot_kind.link(flight, send)
        pilot = pilot_kind(flight, link, companion=True, endless=True)
        narrator = Narrator(flight, news.send)
        news.send("up")
        due = time.monotonic()
        while parent is not None and parent.is_alive():
            now = time.monotonic()
            if now < due:
                time.sleep(due - now)
            elif now - due > BEHIND_S:
                due = now
            due += DT
            _receive(sock, link)
            flight.step()
            pilot.step()
            link.step()
            narrator.step()


def _receive(sock: socket.socket, link: VehicleLink) -> None:
    with contextlib.suppress(OSError):  # nothing waits, or nobody listens yet
        while True:
            link.receive(sock.recv(4096))
