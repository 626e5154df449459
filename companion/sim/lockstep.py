"""The built-in vehicle and the flight program in one process, on the vehicle's clock: real MAVLink bytes between them.

The vehicle waits for each answer, so the numbers of a flight depend on its seed alone, not on the machine or its load;
an idle machine flies faster than real time. Stands in for the socket (``recv``, ``write``, ``close``) and the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing, nullcontext, suppress
from pathlib import Path
from typing import Protocol

from companion.clock import Readable
from companion.config import PipelineConfig
from companion.flight.loop import Flight
from companion.flight.options import FlightOptions
from companion.mavlink.dialect import mavlink
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.tlog_writer import Recorder, Records
from companion.sim.flight import SimulatedFlight
from companion.sim.link import VehicleLink

EPOCH_S = 1_767_225_600.0
"""Unix time of the vehicle's boot: 1 January 2026."""


class Pilot(Protocol):
    """Whoever commands the vehicle; called at every physics step."""

    @property
    def over(self) -> bool:
        """The flight has come to its end."""

    def step(self) -> None:
        """Act when due."""


class OverError(Exception):
    """The flight has come to its end: nobody looks at what the companion does after it."""


class Lockstep:
    """One simulated flight from boot to its end, with a companion or without.

    ``link`` is the kind of the vehicle's link, ``pilot`` builds whoever commands the vehicle, and ``watch`` is called
    after every physics step but for the hand-over at the end, which is not judged.
    """

    def __init__(
        self,
        flight: SimulatedFlight,
        link: Callable[[SimulatedFlight, Callable[[bytes], None]], VehicleLink],
        pilot: Callable[[Lockstep], Pilot],
        watch: Callable[[], None] | None = None,
    ) -> None:
        self.mav = mavlink.MAVLink(None)
        self.flight = flight
        self.link = link(flight, self.send_down)
        self.companion: Flight | None = None
        """The companion that runs, or ran last."""
        self._down = bytearray()
        self._up = bytearray()
        """What is on its way to the companion, and to the vehicle."""
        self._watch = watch
        self._pilot = pilot(self)

    # -- the flight -------------------------------------------------------------------------------------------------

    def fly(self, config: PipelineConfig | None, record: Path | None = None) -> None:
        """Until the pilot says that it is over; ``config`` None: without a companion.

        Raises ConfigError where ``record`` cannot be written.
        """
        with nullcontext() if record is None else closing(Recorder(record)) as recorder:
            self._fly(config, recorder)

    def _fly(self, config: PipelineConfig | None, recorder: Recorder | None) -> None:
        if config is not None:
            with suppress(OverError):
                self._run_companion(config, recorder, FlightOptions())
        while not self._pilot.over:
            self._step()

    def _run_companion(
        self, config: PipelineConfig, recorder: Records | None, options: FlightOptions
    ) -> None:
        arrivals = Arrivals(self)
        link = Link(self, "lockstep", arrivals)
        self.recv(0)  # sent before its socket was open
        self.companion = Flight(
            config=config,
            link=link,
            recorder=recorder,
            arrivals=arrivals,
            options=options,
        )
        self.companion.run()

    def _step(self) -> None:
        """One physics step of everything but the companion."""
        data = self._read_up()
        if data:
            self.link.receive(data)
        self.flight.step()
        self._pilot.step()
        self.link.step()
        if self._watch is not None and not self._pilot.over:
            self._watch()

    # -- the wire ---------------------------------------------------------------------------------------------------

    def send_down(self, frame: bytes) -> None:
        """The vehicle sends."""
        self._down += frame

    def ready(self) -> bool:
        """Whether something waits for the companion."""
        return bool(self._down)

    def _read_up(self) -> bytes:
        """Everything that has reached the vehicle."""
        data = bytes(self._up)
        self._up = bytearray()
        return data

    # -- the companion's clock --------------------------------------------------------------------------------------

    def wait(self, links: Sequence[Readable], timeout_s: float) -> None:
        """Let the vehicle fly until it has said something."""
        until_s = self.flight.time_s + timeout_s
        while not self.ready() and self.flight.time_s < until_s:
            self._step()
        if self._pilot.over:
            raise OverError

    def monotonic_ns(self) -> int:
        """Nanoseconds since the vehicle's boot."""
        return round(self.flight.time_s * 1e9)

    def time(self) -> float:
        """Unix time of the simulated day."""
        return EPOCH_S + self.flight.time_s

    # -- the companion's socket -------------------------------------------------------------------------------------

    def recv(self, _size: int) -> bytes:
        """What the vehicle sent."""
        data = bytes(self._down)
        self._down = bytearray()
        return data

    def write(self, data: bytes) -> None:
        """What the companion sends."""
        self._up += data

    def close(self) -> None:
        """Nothing to close."""
