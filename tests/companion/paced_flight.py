"""The live loop and scripted autopilots on one simulated clock: nothing waits for the wall clock.

The loop runs in a thread of its own, and the test in another. They take turns: the loop flies for as long as the test
lets it, and stands still in between. So the answers do not depend on the machine or on its load.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fake_autopilot import ScriptedAutopilot
from flying import CONFIG
from patience import HANG_S

from companion.clock import Readable
from companion.config import PipelineConfig
from companion.flight.loop import Flight
from companion.flight.options import FlightOptions
from companion.mavlink.dialect import mavlink
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.tlog_writer import Recorder

_TICK_S = 0.02
_EPOCH_S = 1_767_225_600.0
"""Unix time at the start: 1 January 2026."""
_PATIENCE_S = 60.0
"""Simulated, for what a test waits for."""


class Wire:
    """Stands in for a socket between the loop and autopilots."""

    def __init__(self) -> None:
        self.mav = mavlink.MAVLink(None)
        self.autopilots: list[PacedAutopilot] = []
        self.down = b""

    def recv(self, _size: int) -> bytes:
        data = self.down
        self.down = b""
        return data

    def write(self, data: bytes) -> None:
        for autopilot in self.autopilots:
            autopilot.hear(data)

    def close(self) -> None:
        """Nothing to close."""


class PacedAutopilot(ScriptedAutopilot):
    """On a wire."""

    def __init__(self, wire: Wire, system: int = 1, parameters: dict[str, float] | None = None):
        super().__init__(system, parameters)
        self._wire = wire
        wire.autopilots.append(self)

    def send_raw(self, raw: bytes) -> None:
        self._wire.down += raw


class PacedFlight:
    """A flight with an autopilot, as a context. ``recorder``, ``upstream``: as of the program."""

    def __init__(
        self,
        config: PipelineConfig = CONFIG,
        *,
        parameters: dict[str, float] | None = None,
        upstream: bool = False,
        record: Path | None = None,
    ) -> None:
        self.now_s = 0.0
        self._granted_s = 0.0
        self._tick = 0
        self._loops_turn = threading.Semaphore(0)
        self._tests_turn = threading.Semaphore(0)
        self._over = False
        self.wire = Wire()
        self.autopilot = PacedAutopilot(self.wire, parameters=parameters)
        arrivals = Arrivals(self)
        link = Link(self.wire, "paced", arrivals)
        self.controller: PacedAutopilot | None = None
        self._upper = Wire()
        upper_link = None
        if upstream:
            self.controller = PacedAutopilot(self._upper, 255)
            self.controller.silent = True
            upper_link = Link(self._upper, "paced", arrivals, number=1)
        self._recorder = None if record is None else Recorder(record)
        self.flight = Flight(
            config=config,
            link=link,
            upstream=upper_link,
            recorder=self._recorder,
            arrivals=arrivals,
            options=FlightOptions(),
        )
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> PacedFlight:
        self._thread.start()
        self._take_turn(self._tests_turn)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        if self._recorder is not None:
            self._recorder.close()

    def end(self) -> None:
        """Stop, as Ctrl-C does, and fly until that is over."""
        self.flight.stop()
        while not self._over:
            self.run(1.0)
        self._thread.join(HANG_S)
        assert not self._thread.is_alive()

    def run(self, seconds: float) -> None:
        """Fly on."""
        if self._over:
            return
        self._granted_s = self.now_s + seconds
        self._loops_turn.release()
        self._take_turn(self._tests_turn)

    def until(self, condition: Callable[[], object]) -> None:
        """Fly on until something has happened."""
        end_s = self.now_s + _PATIENCE_S
        while not condition():
            assert self.now_s < end_s, [m.get_type() for m in self.autopilot.received[-20:]]
            assert not self._over
            self.run(_TICK_S)

    def wait_for(self, name: str, count: int = 1) -> list[Any]:
        """Fly on until the autopilot has heard so many messages of a kind."""
        self.until(lambda: len(self.autopilot.of_type(name)) >= count)
        return self.autopilot.of_type(name)

    def said(self) -> str:
        """The texts to the pilot, put together."""
        return " ".join("".join(m.text for m in self.autopilot.of_type("STATUSTEXT")).split())

    def _run(self) -> None:
        try:
            self.flight.run()
        finally:
            self._over = True
            self._tests_turn.release()

    def _take_turn(self, turn: threading.Semaphore) -> None:
        assert turn.acquire(timeout=HANG_S), "the other thread hangs"

    # -- the loop's clock ---------------------------------------------------------------------------------------------

    def wait(self, links: Sequence[Readable], timeout_s: float) -> None:
        """Fly until something is heard, as far as the test lets it."""
        until_s = self.now_s + timeout_s
        while not (self.wire.down or self._upper.down) and self.now_s < until_s:
            while self.now_s >= self._granted_s:
                self._tests_turn.release()
                self._take_turn(self._loops_turn)
            self._step()

    def _step(self) -> None:
        self.now_s += _TICK_S
        for autopilot in (*self.wire.autopilots, *self._upper.autopilots):
            autopilot.boot_s += _TICK_S
            autopilot.tick(self._tick)
        self._tick += 1

    def monotonic_ns(self) -> int:
        """Nanoseconds since the start."""
        return round(self.now_s * 1e9)

    def time(self) -> float:
        """Unix time of the simulated day."""
        return _EPOCH_S + self.now_s
