"""The live loop: one thread that waits on the sockets, feeds ``step``, and sends what it decides."""

from __future__ import annotations

import math
from typing import Any

from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.flight.hand_over import HandOver
from companion.flight.housekeeping import Housekeeping
from companion.flight.latency import Latencies
from companion.flight.options import FlightOptions
from companion.flight.outbox import Outbox
from companion.flight.pilot import Pilot
from companion.flight.requests import Requests
from companion.flight.timers import Timers
from companion.mavlink import AUTOPILOT_COMPONENT, OWN_COMPONENT
from companion.mavlink.firmware import stack_of
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.message_filter import HEARTBEAT, Intake, unread
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Attitude, Heartbeat, Sample, SetPositionTarget
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET
from companion.mavlink.tlog_writer import Recorder, Records
from companion.mavlink.wire_frames import Frame
from companion.page.snapshot import snapshot
from companion.pipeline import answer, initial_state, ready_to_leave, stopped
from companion.settle import settle
from companion.state.decision import Decision
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
        config: PipelineConfig,
        link: Link,
        upstream: Link | None,
        recorder: Records | None,
        arrivals: Arrivals,
        options: FlightOptions,
    ) -> None:
        self.summary = Summary(config.dry_run)
        self.reboots = 0
        self._latencies = Latencies()
        self._config = config
        self._link = link
        self._upstream = upstream
        self._recorder = recorder
        self._arrivals = arrivals
        self._options = options
        self._state = initial_state(config)
        adapting = config.adapt is not Adapt.OFF
        self._intake = Intake(options.target_system, unread(adapting=adapting))
        self._outbox = Outbox(link, recorder, arrivals, self._intake)
        self.pilot = Pilot(self._outbox, options.watchdog)
        self._requests = Requests(config, self._outbox, self.pilot, recorded=recorder is not None)
        self._housekeeping = Housekeeping(
            config, link, arrivals, self._outbox, self.pilot, self._requests
        )
        self._hand_over = HandOver(config, link, arrivals, self._outbox, self._intake, options)
        self._timers = Timers()
        self._set_back_s = 0.0
        """By how much the vehicle's clock was set back, as last told."""
        self._turn_s = math.inf
        """When the loop last ran."""
        self._excused_until_s = -math.inf
        """Until when its own stall explains what came late."""
        self._stop_s: float | None = None
        self._hurried = False

    # -- the loop --------------------------------------------------------------------------------

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
                self._take(arrival_us, frame)
            if self._upstream is not None:
                for arrival_us, frame in self._upstream.drain():
                    self._take_upstream(arrival_us, frame)
        watchdog.stopping()
        self._hand_over.finish(self._state, watchdog.alive)

    def _over(self, now_s: float, start_s: float) -> bool:
        """Whether the flight ends: asked for, or its duration is over, and offsets have faded."""
        self._options.watchdog.alive(now_s)
        if self._options.duration_s is not None and now_s - start_s >= self._options.duration_s:
            self.stop()
        if self._stop_s is None:
            return False
        if not self._state.requests.stopping:
            self._state = stopped(self._state)
        return self._hurried or ready_to_leave(self._state) or now_s - self._stop_s > _STOP_S

    def _keep_house(self, now_s: float) -> None:
        self._housekeeping.speak(now_s, self._state)
        if not self._requests.connected:
            self._housekeeping.wait_for_autopilot(now_s)
            return
        self._hand_over.renew(now_s, self._state)
        self._hand_over.stay_while_deaf(now_s, self._state)
        self._housekeeping.ask(now_s, self._state)

    def _watch_own_stall(self, now_s: float) -> None:
        """What came late because nobody read it is not the telemetry's fault."""
        stood_s = now_s - self._turn_s
        self._turn_s = now_s
        if stood_s < _STALL_S:
            return
        self._excused_until_s = now_s + _AFTER_STALL_S
        self._requests.streams.restart(now_s)
        self.pilot.tell(f"companion: stood still for {stood_s:.1f} s (this computer)")

    # -- what is heard ---------------------------------------------------------------------------

    def _take(self, arrival_us: int, frame: Frame) -> None:
        self._outbox.record(arrival_us, frame.raw)
        if self._upstream is not None and frame.system == self._intake.system:
            self._upstream.forward(frame.raw)
        if frame.id in LAYOUTS:
            self._feed(arrival_us, frame)

    def _take_upstream(self, arrival_us: int, frame: Frame) -> None:
        if frame.id == SET_ATTITUDE_TARGET:
            self._outbox.record(arrival_us, frame.raw)
            self._feed(arrival_us, frame)

    def _feed(self, arrival_us: int, frame: Frame) -> None:
        """One frame into the pipeline; a setpoint that it brings is sent before anything else is done."""
        intake = self._intake
        sample = intake.sample(frame, arrival_us)
        self._watch_vehicle_clock()
        if frame.system in intake.others:
            self.pilot.say_once(
                f"companion: ignoring system {frame.system}; flying with system {intake.system}"
            )
        if sample is None:
            if frame.system == intake.system:
                self._note_unread(frame)
            return
        self._state, decision = answer(self._state, sample, self._config)
        if decision is not None and decision.command is not None and not self._config.dry_run:
            self._latencies.add(self._outbox.command(decision.command) - arrival_us)
        self._state = settle(self._state, sample, decision, self._config)
        self._note(frame, sample)
        if decision is not None:
            self._report(decision)

    def _watch_vehicle_clock(self) -> None:
        """Whether the vehicle has rebooted, or its clock was set back."""
        clock = self._intake.clock
        if clock.boot != self.reboots:
            self.reboots = clock.boot
            self.pilot.say("companion: the vehicle rebooted; starting over")
            self._requests.start_over()
        if clock.set_back_s != self._set_back_s:
            self._set_back_s = clock.set_back_s
            self.pilot.tell(
                "companion: the vehicle's clock was set back, or stood still, by "
                f"{self._set_back_s:.2f} s"
            )

    def _note_unread(self, frame: Frame) -> None:
        """Of what is not for ``step``: streams that are only recorded, and another program that is this component."""
        if frame.id in self._intake.unread:
            self._requests.streams.heard(frame.id)
        own = frame.id == HEARTBEAT and frame.component == OWN_COMPONENT
        if own and not self._outbox.sent_lately(frame.raw):
            self.pilot.tell_once(
                "twin",
                "companion: another program is component 191 too: stop it or give it another id",
            )

    def _note(self, frame: Frame, sample: Sample) -> None:
        """Keep the books of what was heard: streams, heartbeats, targets to others, a survey's progress."""
        self._requests.streams.heard(frame.id)
        if isinstance(sample, Attitude):
            self._hand_over.hear_attitude()
        elif isinstance(sample, Heartbeat) and sample.component == AUTOPILOT_COMPONENT:
            self._housekeeping.hear_heartbeat()
            self._outbox.identify()
            self._requests.connect(stack_of(sample))
        elif isinstance(sample, SetPositionTarget) and self._state.held.hold is not None:
            self._note_target(sample.target_component)
        if self._config.survey is not None:
            self.pilot.hear_survey(self._state.requests.survey)

    def _note_target(self, component: int) -> None:
        if component not in (0, OWN_COMPONENT):
            self.pilot.tell_once(
                "stray target",
                f"companion: that target went to component {component}; 191 moves the hold",
            )

    # -- what is told ----------------------------------------------------------------------------

    def _report(self, decision: Decision) -> None:
        """Tell summary, watchers, ground station and terminal of a decision."""
        self.summary.add(decision)
        if self._options.watch is not None:
            self._options.watch(decision)
        now_s = self._arrivals.now_s()
        if self._options.page is not None:
            self._options.page.offer(
                lambda: snapshot(decision, self._state, self._config, self._requests.streams, now_s)
            )
        excused = now_s < self._excused_until_s
        self.pilot.hear_decision(self._state, decision, excused=excused)

    @property
    def last_word(self) -> bytes:
        """The frame that the second process sends if this one is killed now; empty where others fly."""
        return self._hand_over.frame(self._state)

    @property
    def unheard(self) -> str | None:
        """Why nothing was flown at all, in words; None where an autopilot was heard."""
        if self._requests.connected:
            return None
        received = self._link.received
        bad = self._link.bad
        if not received and not bad:
            return "nothing was heard; does the autopilot send there?"
        if not received:
            return (
                f"{bad} damaged or unsigned frames and no good one: check baud rate and signing key"
            )
        if self._options.target_system:
            who = f" of system {self._options.target_system}"
        else:
            who = ""
        return (
            f"{received} messages but no HEARTBEAT of an autopilot{who}: check "
            "--target-system, routing"
        )

    def as_json(self) -> dict[str, Any]:
        """The flight in numbers."""
        link = self._link
        messages = {
            "received": link.received,
            "sent": link.sent,
            "bad": link.bad,
            "dropped": link.dropped,
            "ignored": self._intake.ignored,
        }
        record = self._recorder.as_json() if isinstance(self._recorder, Recorder) else None
        streams = self._requests.streams
        out = {
            "endpoint": link.endpoint,
            "system": self._intake.system,
            "autopilot": self._requests.stack.name.lower(),
            "dry_run": self._config.dry_run,
            "messages": messages,
            "reboots": self.reboots,
            "ignored_systems": sorted(self._intake.others),
            "latency_ms": self._latencies.percentiles_ms(),
            "record": record,
            "slow_messages_hz": dict(streams.in_vain),
            "set_back": dict(streams.set_back),
        }
        if self._config.survey is not None:
            out["survey"] = self._state.requests.survey.as_json()
        return out | self.summary.as_json()
