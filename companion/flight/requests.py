"""What the autopilot is asked for: streams of messages at a rate, and parameters."""

from __future__ import annotations

from collections.abc import Mapping

from companion.config import PipelineConfig
from companion.flight.outbox import Outbox
from companion.flight.pilot import Pilot
from companion.flight.timers import Timers
from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.firmware import Stack, needed_parameters
from companion.mavlink.outgoing import param_request_read
from companion.mavlink.stream_rates import StreamKeeper, interval_request, wanted_streams

_RETRY_S = 1.0
"""An answer takes 0.1 s on a link that is not full."""
_SLOW_RETRY_S = 5.0
"""After ten tries the parameters still missing are asked for this seldom, but never given up."""
_TRIES = 10
_SET_BACK = 2
"""Once may be a restart of the other program."""


class Requests:
    """Streams and parameters of one autopilot. None are wanted until an autopilot is heard."""

    def __init__(
        self, config: PipelineConfig, outbox: Outbox, pilot: Pilot, *, recorded: bool
    ) -> None:
        self.stack = Stack.OTHER
        self.streams = StreamKeeper(())
        self._config = config
        self._outbox = outbox
        self._pilot = pilot
        self._recorded = recorded
        self._timers = Timers()
        self._asked = 0
        """How often parameters were asked for since the vehicle's boot."""

    @property
    def connected(self) -> bool:
        """Whether an autopilot was ever heard."""
        return bool(self.streams.wanted)

    def connect(self, stack: Stack) -> None:
        """An autopilot speaks: what is wanted follows from its firmware."""
        if self.connected and stack is self.stack:
            return
        self.stack = stack
        wanted = wanted_streams(
            self._config.vehicle,
            stack,
            recorded=self._recorded,
        )
        self.streams = StreamKeeper(wanted)
        self._pilot.say(
            f"companion: connected to system {self._outbox.system} ({stack.name.lower()})"
        )

    def start_over(self) -> None:
        """The vehicle has rebooted: all is asked for again."""
        self.streams.forget()
        self._timers.start_over("parameters")
        self._asked = 0

    def ask(self, now_s: float, parameters: Mapping[str, float]) -> None:
        """Ask for what is due; tell of streams that stay slow. ``parameters``: those that are known."""
        for wanted in self.streams.due(now_s):
            self._outbox.send(interval_request(wanted, self._outbox.system))
        self._tell_of_streams()
        if self._asked <= _TRIES:
            retry_s = _RETRY_S
        else:
            retry_s = _SLOW_RETRY_S
        if not self._timers.due("parameters", retry_s, now_s):
            return
        self._asked += 1
        for name in self._missing(parameters):
            request = param_request_read(self._outbox.system, AUTOPILOT_COMPONENT, name)
            self._outbox.send(request)

    def _tell_of_streams(self) -> None:
        for name, hz in self.streams.in_vain.items():
            text = (
                f"companion: {name} comes at {hz:.0f} Hz only, although a higher rate was requested"
            )
            self._pilot.tell_once(f"slow {name}", text)
        for name, times in self.streams.set_back.items():
            if times >= _SET_BACK:
                text = f"companion: another program sets {name} to a lower rate again and again"
                self._pilot.tell_once(f"set back {name}", text)

    def _missing(self, parameters: Mapping[str, float]) -> list[str]:
        """What is not known, as long as it is not; GUID_OPTIONS until its bit is set, even if late."""
        known = {
            name for name, value in parameters.items() if name != "GUID_OPTIONS" or int(value) & 8
        }
        return [name for name in needed_parameters(self.stack) if name not in known]
