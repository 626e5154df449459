"""The live loop: one thread that waits on the sockets, feeds ``step``, and sends what it decides."""

from __future__ import annotations

import math
from typing import Any

from companion.config import PipelineConfig
from companion.flight import outcome
from companion.flight.hand_over import HandOver
from companion.flight.housekeeping import Housekeeping
from companion.flight.incoming import Incoming
from companion.flight.options import FlightOptions
from companion.flight.outbox import Outbox
from companion.flight.pilot import Pilot
from companion.flight.reports import Reports
from companion.flight.requests import Requests
from companion.flight.timers import Timers
from companion.last_word import Word
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.message_filter import UNREAD, Intake
from companion.mavlink.tlog_writer import Records
from companion.pipeline import ready_to_leave, stopped
from companion.telemetry.summary import Summary

_PERIOD_S = 0.02
"""What is due by time alone is looked at this often, however many messages come: late by no more than a setpoint."""
_STOP_S = 3.0
"""At most so long for offsets to fade and the vehicle to come to rest after a stop."""
_STALL_S = 0.3
_AFTER_STALL_S = 1.5
"""A loop that did not run for so long stood still; for so long after it nothing that came late is blamed."""


class Flight:
    """One run of the companion on open links. ``stop`` may be called from a signal handler."""

    def __init__(
        self,
        *,
        config: PipelineConfig,
        link: Link,
        upstream: Link | None = None,
        recorder: Records | None = None,
        arrivals: Arrivals,
        options: FlightOptions,
    ) -> None:
        self._config = config
        self._link = link
        self._upstream = upstream
        self._recorder = recorder
        self._arrivals = arrivals
        self._options = options
        self._intake = Intake(options.target_system, UNREAD)
        self.outbox = Outbox(link, recorder, arrivals, self._intake)
        self.pilot = Pilot(self.outbox, options.watchdog)
        self._requests = Requests(config, self.outbox, self.pilot, recorded=recorder is not None)
        self._housekeeping = Housekeeping(
            config=config,
            link=link,
            arrivals=arrivals,
            outbox=self.outbox,
            pilot=self.pilot,
            requests=self._requests,
        )
        self._hand_over = HandOver(
            config=config,
            link=link,
            arrivals=arrivals,
            outbox=self.outbox,
            intake=self._intake,
            options=options,
        )
        self._reports = Reports(
            config=config,
            pilot=self.pilot,
            requests=self._requests,
            arrivals=arrivals,
            options=options,
        )
        self.incoming = Incoming(
            config=config,
            intake=self._intake,
            upstream=upstream,
            outbox=self.outbox,
            pilot=self.pilot,
            requests=self._requests,
            housekeeping=self._housekeeping,
            hand_over=self._hand_over,
            reports=self._reports,
        )
        self._timers = Timers()
        self._turn_s = math.inf
        """When the loop last ran."""
        self._stop_s: float | None = None
        self._hurried = False

    def stop(self) -> None:
        """Fade the offsets out, come to rest, hand over, end. Called twice: hand over at once."""
        if self._stop_s is None:
            self._stop_s = self._arrivals.now_s()
        else:
            self._hurried = True

    def run(self) -> None:
        """Fly until stopped or until the duration is over."""
        self._hand_over.open()
        try:
            self._fly()
        finally:
            self._hand_over.close()

    def _fly(self) -> None:
        if self._upstream is None:
            links = [self._link]
        else:
            links = [self._link, self._upstream]
        watchdog = self._options.watchdog
        start = self._arrivals.now_s()
        watchdog.ready()
        while True:
            now = self._arrivals.now_s()
            if self._timers.due("housekeeping", _PERIOD_S, now):
                if self._over(now, start):
                    break
                self._keep_house(now)
            self._arrivals.clock.wait(links, _PERIOD_S)
            self._watch_own_stall(self._arrivals.now_s())
            for arrival_us, frame in self._link.drain():
                self.incoming.take(arrival_us, frame)
            if self._upstream is not None:
                for arrival_us, frame in self._upstream.drain():
                    self.incoming.take_upstream(arrival_us, frame)
        watchdog.stopping()
        self._hand_over.finish(self.incoming.state, watchdog.alive)

    def _over(self, now_s: float, start_s: float) -> bool:
        """Whether the flight ends: asked for, or its duration is over, and offsets have faded."""
        self._options.watchdog.alive(now_s)
        if self._options.duration_s is not None and now_s - start_s >= self._options.duration_s:
            self.stop()
        if self._stop_s is None:
            return False
        if not self.incoming.state.requests.stopping:
            self.incoming.state = stopped(self.incoming.state)
        if self._hurried or ready_to_leave(self.incoming.state):
            return True
        return now_s - self._stop_s > _STOP_S

    def _keep_house(self, now_s: float) -> None:
        state = self.incoming.state
        self._housekeeping.speak(now_s, state)
        if not self._requests.connected:
            self._housekeeping.wait_for_autopilot(now_s)
            return
        self._hand_over.renew(now_s, state)
        self._hand_over.stay_while_deaf(now_s, state)
        self._housekeeping.ask(now_s, state)

    def _watch_own_stall(self, now_s: float) -> None:
        """What came late because nobody read it is not the telemetry's fault."""
        stood_s = now_s - self._turn_s
        self._turn_s = now_s
        if stood_s < _STALL_S:
            return
        self._reports.excuse(now_s + _AFTER_STALL_S)
        self._requests.streams.restart(now_s)
        self.pilot.tell(f"companion: stood still for {stood_s:.1f} s (this computer)")

    @property
    def summary(self) -> Summary:
        """Of all decisions."""
        return self._reports.summary

    @property
    def last_word(self) -> Word:
        """What the second process says if this one is killed now; nothing where others fly."""
        return self._hand_over.word(self.incoming.state)

    @property
    def unheard(self) -> str | None:
        """Why nothing was flown at all, in words; None where an autopilot was heard."""
        if self._requests.connected:
            return None
        return outcome.why_unheard(self._link, self._options.target_system)

    def as_json(self) -> dict[str, Any]:
        """The flight in numbers."""
        out = outcome.as_json(
            link=self._link,
            recorder=self._recorder,
            intake=self._intake,
            incoming=self.incoming,
            requests=self._requests,
            dry_run=self._config.dry_run,
        )
        if self._config.survey is not None:
            out["survey"] = self.incoming.state.requests.survey.as_json()
        return out | self.summary.as_json()
