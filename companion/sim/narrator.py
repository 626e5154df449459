"""Writes to standard output, a line of JSON each, which phase of the script is flown and when it is over."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from typing import IO

from companion.sim.flight import Flight


class Narrator:
    """In the simulator's process: prints where the phase changes."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._phase = ""
        self._over = False

    def step(self) -> None:
        """Call once per physics step."""
        flight = self._flight
        if not flight.script_s > 0.0 or self._over:
            return
        self._over = flight.script_s > flight.scenario.duration_s
        if self._over:
            print(json.dumps({"over_s": round(flight.scenario.duration_s, 1)}), flush=True)
        elif flight.reference.phase != self._phase:
            self._phase = flight.reference.phase
            left = flight.scenario.duration_s - flight.script_s
            print(json.dumps({"phase": self._phase, "left_s": round(left)}), flush=True)


def follow(lines: IO[str], say: Callable[[str], None], over: Callable[[], None]) -> threading.Thread:
    """In the flight program: repeats the phases to the user and calls ``over`` at the end. Ends with the stream."""

    def listen() -> None:
        try:
            for line in lines:
                event = json.loads(line)
                if "phase" in event:
                    say(f"sim: {event['phase']} ({event['left_s']} s to go)")
                if "over_s" in event:
                    say("sim: the flight is over; --duration S goes on longer")
                    over()
        except ValueError:
            return  # the stream was closed under us, or is none of ours

    thread = threading.Thread(target=listen, daemon=True, name="sim narrator")
    thread.start()
    return thread
