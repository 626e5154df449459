"""What is due by time alone: the record reaches its file, our heartbeat goes out, and what is wanted is asked for."""

from __future__ import annotations

from companion.config import PipelineConfig
from companion.control.lateness import lateness
from companion.flight.outbox import Outbox
from companion.flight.pilot import Pilot
from companion.flight.requests import Requests
from companion.flight.timers import Timers
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.outgoing import heartbeat, timesync
from companion.state.pipeline_state import PipelineState

_LOST_S = 3.0
"""Three heartbeats at the 1 Hz of the protocol."""
_FLUSH_S = 0.5
_HEARTBEAT_S = 1.0
_ASK_CLOCK_S = 0.1
"""Telemetry later than this may be a clock that stood still: the hold would allow for lateness that is none."""


class Housekeeping:
    """Looked at every few hundredths of a second (``turn``), and told of every heartbeat of the autopilot."""

    def __init__(
        self,
        *,
        config: PipelineConfig,
        link: Link,
        arrivals: Arrivals,
        outbox: Outbox,
        pilot: Pilot,
        requests: Requests,
    ) -> None:
        self._config = config
        self._link = link
        self._arrivals = arrivals
        self._outbox = outbox
        self._pilot = pilot
        self._requests = requests
        self._timers = Timers()
        self._started_s = arrivals.now_s()
        self._heard_s = self._started_s
        """When the autopilot's newest heartbeat arrived."""

    def hear_heartbeat(self) -> None:
        """The autopilot lives."""
        self._heard_s = self._arrivals.now_s()

    def speak(self, now_s: float, state: PipelineState) -> None:
        """The record, and that we live."""
        if self._timers.due("flush", _FLUSH_S, now_s):
            self._outbox.flush()
        if not self._timers.due("heartbeat", _HEARTBEAT_S, now_s):
            return
        self._outbox.send(heartbeat())
        if lateness(state.estimates, self._config) > _ASK_CLOCK_S:
            # Is the link late, or has the clock stood still?
            self._outbox.send(timesync(self._arrivals.stamp()))

    def wait_for_autopilot(self, now_s: float) -> None:
        """Nobody was heard yet."""
        if now_s - self._started_s > _LOST_S:
            self._pilot.say_once(
                f"companion: no heartbeat on {self._link.endpoint} yet; does the autopilot "
                "send there?"
            )

    def ask(self, now_s: float, state: PipelineState) -> None:
        """What is wanted of an autopilot that was heard; nothing while it is silent."""
        if self._link.dropped:
            where = self._link.endpoint
            self._pilot.say_once(
                f"companion: {where} is full: messages are dropped; a higher --baud, fewer streams"
            )
        if now_s - self._heard_s > _LOST_S:
            self._requests.streams.forget()
        else:
            self._requests.ask(now_s, state.heard.parameters)
