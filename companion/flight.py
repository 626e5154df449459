"""The live loop: one thread that waits on the sockets, feeds ``step``, and sends what it decides."""

from __future__ import annotations

import logging
import math
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from companion.adapt_options import Adapt
from companion.config import Base, PipelineConfig
from companion.control.lateness import lateness
from companion.control.state import Decision
from companion.control.survey import Phase
from companion.last_word import LastWord
from companion.mavlink import AUTOPILOT_COMPONENT, OWN_COMPONENT
from companion.mavlink.firmware import (
    Stack,
    mode_name,
    needed_parameters,
    stack_of,
    takes_setpoints,
)
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.message_filter import HEARTBEAT, Intake, unread
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.outgoing import Message, heartbeat, param_request_read, timesync
from companion.mavlink.samples import Attitude, Heartbeat, Sample, SetPositionTarget
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET, Command, PositionCommand, encode
from companion.mavlink.stream_rates import StreamKeeper, interval_request, wanted_streams
from companion.mavlink.tlog_writer import Recorder, Records
from companion.mavlink.wire_frames import Frame
from companion.page.feed import PageFeed
from companion.page.snapshot import snapshot
from companion.pipeline import (
    answer,
    hand_over_place,
    initial_state,
    level_command,
    ready_to_leave,
    stopped,
)
from companion.settle import settle
from companion.telemetry.status import StatusReporter
from companion.telemetry.summary import Summary
from companion.watchdog import Watchdog

_PERIOD_S = 0.02
"""What is due by time alone is looked at this often, however many messages come: late by no more than a setpoint."""
_LOST_S = 3.0
"""Three heartbeats at the 1 Hz of the protocol."""
_STOP_S = 3.0
"""At most so long for offsets to fade and the vehicle to come to rest after a stop."""
_HAND_OVER_S = 1.0
"""For so long the autopilot is sent the place to stay at: PX4's controller has settled before the stream ends."""
_HAND_OVER_PERIOD_S = 0.05
"""As often as attitudes bring setpoints, or a little less."""
_LAST_WORD_PERIOD_S = 0.1
"""Three in the silence after which the second process speaks (last_word.SILENCE_S)."""
_DEAF_S = 0.3
_DEAF_UNTIL_S = 1.5
_DEAF_PERIOD_S = 0.1
"""Without attitudes for so long, and until then, the autopilot is sent a place: it would keep the last tilt."""
_STALL_S = 0.3
_AFTER_STALL_S = 1.5
"""A loop that did not run for so long stood still; for so long after it nothing that came late is blamed."""
_ASK_CLOCK_S = 0.1
"""Telemetry later than this may be a clock that stood still: the hold would allow for lateness that is none."""
_PARAMETER_RETRY_S = 1.0
"""An answer takes 0.1 s on a link that is not full."""
_PARAMETER_SLOW_RETRY_S = 5.0
"""After ten tries the ones still missing are asked for this seldom, but never given up."""
_PARAMETER_TRIES = 10
_LONGEST_US = 100_000
"""Setpoints that took longer are counted as this."""
_SET_BACK = 2
"""Once may be a restart of the other program."""


_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class FlightOptions:
    """What the command line decided about a flight."""

    duration_s: float | None = None
    target_system: int | None = None
    last_word: bool = False
    """Start the second process that sends the autopilot a place to stay at if this one is killed."""
    watch: Callable[[Decision], None] | None = None
    """Called with every decision."""
    watchdog: Watchdog = field(default_factory=lambda: Watchdog({}))
    """Kept informed that the loop runs; the default tells nobody."""
    page: PageFeed | None = None
    """Shown what is decided."""


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
        self._config = config
        self._link = link
        self._upstream = upstream
        self._options = options
        self._recorder = recorder
        self._arrivals = arrivals
        self._watchdog = options.watchdog
        self._adapting = config.adapt is not Adapt.OFF
        self._intake = Intake(options.target_system, unread(adapting=self._adapting))
        self._state = initial_state(config)
        self._status = StatusReporter()
        self._told: set[str] = set()
        """What is said once a flight, and was."""
        self._done_s: dict[str, float] = {}
        """When what is due by time was last done."""
        self._beats: deque[bytes] = deque(maxlen=4)
        """Our own heartbeats, to tell them from another program's where a link sends them back."""
        self._set_back_s = 0.0
        self._streams = StreamKeeper(())
        """Empty until an autopilot is heard."""
        self._stack = Stack.OTHER
        self._heard_s = self._attitude_s = -math.inf
        self._hears_attitudes = False
        """Whether one came since ``_attitude_s`` was last set."""
        self._started_s = arrivals.now_s()
        self._turn_s, self._excused_until_s = math.inf, -math.inf
        """When the loop last ran, and until when its own stall explains what came late."""
        self._asked = 0
        self._survey_reported: tuple[Phase, str] = (Phase.WAITING, "")
        self._stop_s: float | None = None
        self._latencies: Counter[int] = Counter()
        """Setpoints by how long they took, in bins of 10 us: the same memory after an hour as after a minute."""
        self._hurried = False
        self._last_word: LastWord | None = None
        link.identify(self._system, OWN_COMPONENT)

    def stop(self) -> None:
        """Fade the offsets out, come to rest, hand over, end. Called twice: hand over at once."""
        if self._stop_s is None:
            self._stop_s = self._arrivals.now_s()
        else:
            self._hurried = True

    def run(self) -> None:
        """Fly until stopped or until the duration is over."""
        if (
            self._options.last_word
            and self._config.base is Base.HOLD
            and self._link.signatures is None
        ):
            self._last_word = LastWord(self._link.fileno) if self._link.fileno >= 0 else None
        try:
            self._fly()
        finally:
            if self._last_word is not None:
                self._last_word.close()

    def _fly(self) -> None:
        if self._upstream is None:
            links = [self._link]
        else:
            links = [self._link, self._upstream]
        start = self._arrivals.now_s()
        self._watchdog.ready()
        while True:
            now = self._arrivals.now_s()
            if self._due("housekeeping", _PERIOD_S, now):
                if self._over(now, start):
                    break
                self._housekeeping(now)
            self._arrivals.clock.wait(links, _PERIOD_S)
            self._watch_own_stall(self._arrivals.now_s())
            for arrival_us, frame in self._link.drain():
                self._take(arrival_us, frame)
            if self._upstream is not None:
                for arrival_us, frame in self._upstream.drain():
                    self._take_upstream(arrival_us, frame)
        self._watchdog.stopping()
        self._hand_over()

    def _due(self, what: str, period_s: float, now_s: float) -> bool:
        """Whether the last time is that long ago; then this is the last time."""
        if now_s - self._done_s.get(what, -math.inf) < period_s:
            return False
        self._done_s[what] = now_s
        return True

    def _watch_own_stall(self, now_s: float) -> None:
        """What came late because nobody read it is not the telemetry's fault."""
        stood_s = now_s - self._turn_s
        self._turn_s = now_s
        if stood_s < _STALL_S:
            return
        self._excused_until_s = now_s + _AFTER_STALL_S
        self._streams.restart(now_s)
        self._tell(f"companion: stood still for {stood_s:.1f} s (this computer)")

    def _over(self, now_s: float, start_s: float) -> bool:
        """Whether the flight ends: asked for, or its duration is over, and offsets have faded."""
        self._watchdog.alive(now_s)
        if self._options.duration_s is not None and now_s - start_s >= self._options.duration_s:
            self.stop()
        if self._stop_s is None:
            return False
        if not self._state.stopping:
            self._state = stopped(self._state)
        return self._hurried or ready_to_leave(self._state) or now_s - self._stop_s > _STOP_S

    def _take(self, arrival_us: int, frame: Frame) -> None:
        self._record(arrival_us, frame.raw)
        if self._upstream is not None and frame.system == self._intake.system:
            self._upstream.forward(frame.raw)
        if frame.id in LAYOUTS:
            self._feed(arrival_us, frame)

    def _take_upstream(self, arrival_us: int, frame: Frame) -> None:
        if frame.id == SET_ATTITUDE_TARGET:
            self._record(arrival_us, frame.raw)
            self._feed(arrival_us, frame)

    def _feed(self, arrival_us: int, frame: Frame) -> None:
        """One frame into the pipeline; a setpoint that it brings is sent before anything else is done."""
        intake = self._intake
        sample = intake.sample(frame, arrival_us)
        if intake.clock.boot != self.reboots:
            self._rebooted()
        if intake.clock.set_back_s != self._set_back_s:
            self._set_back_s = intake.clock.set_back_s
            self._tell(
                "companion: the vehicle's clock was set back, or stood still, by "
                f"{self._set_back_s:.2f} s"
            )
        if frame.system in intake.others:
            self._say_once(
                f"companion: ignoring system {frame.system}; flying with system {intake.system}"
            )
        if sample is None:
            if frame.system == intake.system:
                self._note_unread(frame)
            return
        self._state, decision = answer(self._state, sample, self._config)
        if decision is not None and decision.command is not None and not self._config.dry_run:
            took_us = self._send_command(decision.command) - arrival_us
            self._latencies[min(max(took_us, 0), _LONGEST_US) // 10] += 1
        self._state = settle(self._state, sample, decision, self._config)
        self._note(frame, sample)
        if decision is not None:
            self._report(decision)

    def _note_unread(self, frame: Frame) -> None:
        """Of what is not for ``step``: streams that are only recorded, and another program that is this component."""
        if frame.id in self._intake.unread:
            self._streams.heard(frame.id)
        if (
            frame.id == HEARTBEAT
            and frame.component == OWN_COMPONENT
            and frame.raw not in self._beats
        ):
            self._tell_once(
                "twin",
                "companion: another program is component 191 too: stop it or give it another id",
            )

    def _note(self, frame: Frame, sample: Sample) -> None:
        """Keep the books of what was heard: streams, heartbeats, targets to others, a survey's progress."""
        self._streams.heard(frame.id)
        if isinstance(sample, Attitude):
            self._hears_attitudes = True
        elif isinstance(sample, Heartbeat) and sample.component == AUTOPILOT_COMPONENT:
            self._connected(sample)
        elif isinstance(sample, SetPositionTarget) and self._state.hold is not None:
            self._note_target(sample.target_component)
        survey = self._state.survey
        if self._config.survey is not None and (survey.phase, survey.why) != self._survey_reported:
            self._survey_reported = (survey.phase, survey.why)
            text = f"companion: {survey.phase.value}" + (f": {survey.why}" if survey.why else "")
            self._pass_on(self._status.tell(text, warning=False))

    def _note_target(self, component: int) -> None:
        if component not in (0, OWN_COMPONENT):
            self._tell_once(
                "stray target",
                f"companion: that target went to component {component}; 191 moves the hold",
            )

    def _report(self, decision: Decision) -> None:
        """Tell summary, watchers, ground station and terminal of a decision."""
        self.summary.add(decision)
        if self._options.watch is not None:
            self._options.watch(decision)
        if self._options.page is not None:
            now_s = self._arrivals.now_s()
            self._options.page.offer(
                lambda: snapshot(decision, self._state, self._config, self._streams, now_s)
            )
        excused = self._arrivals.now_s() < self._excused_until_s
        self._pass_on(self._status.messages(self._state, decision, excused=excused))

    def _pass_on(self, messages: Iterable[tuple[Message, str | None]]) -> None:
        """Each message to the ground station, and its text to the log."""
        for outgoing, text in messages:
            self._send(outgoing)
            if text is not None:
                self._say(text)

    @property
    def _system(self) -> int:
        """The vehicle's system id; 1 until one is heard."""
        return self._intake.system or 1

    def _connected(self, heartbeat: Heartbeat) -> None:
        self._heard_s = self._arrivals.now_s()
        self._link.identify(self._system, OWN_COMPONENT)
        stack = stack_of(heartbeat)
        if not self._streams.wanted or stack is not self._stack:
            self._stack, recorded = stack, self._recorder is not None
            wanted = wanted_streams(
                self._config.vehicle, stack, recorded=recorded, adapting=self._adapting
            )
            self._streams = StreamKeeper(wanted)
            self._say(f"companion: connected to system {self._system} ({stack.name.lower()})")

    def _rebooted(self) -> None:
        self.reboots = self._intake.clock.boot
        self._say("companion: the vehicle rebooted; starting over")
        self._streams.forget()
        self._done_s.pop("parameters", None)
        self._asked = 0

    def _housekeeping(self, now_s: float) -> None:
        if self._recorder is not None and self._due("flush", 0.5, now_s):
            self._recorder.flush()
        if self._due("heartbeat", 1.0, now_s):
            self._send(heartbeat())
            if lateness(self._state.estimates, self._config) > _ASK_CLOCK_S:
                self._send(
                    timesync(self._arrivals.stamp())
                )  # is the link late, or has the clock stood still?
        if not self._streams.wanted:
            if now_s - self._started_s > _LOST_S:
                self._say_once(
                    f"companion: no heartbeat on {self._link.endpoint} yet; does the autopilot "
                    "send there?"
                )
            return
        self._renew_last_word(now_s)
        self._stay_while_deaf(now_s)
        if self._link.dropped:
            where = self._link.endpoint
            self._say_once(
                f"companion: {where} is full: messages are dropped; a higher --baud, fewer streams"
            )
        if now_s - self._heard_s > _LOST_S:
            self._streams.forget()
            return
        for wanted in self._streams.due(now_s):
            self._send(interval_request(wanted, self._system))
        for name, hz in self._streams.in_vain.items():
            text = (
                f"companion: {name} comes at {hz:.0f} Hz only, although a higher rate was requested"
            )
            self._tell_once(f"slow {name}", text)
        for name, times in self._streams.set_back.items():
            if times >= _SET_BACK:
                text = f"companion: another program sets {name} to a lower rate again and again"
                self._tell_once(f"set back {name}", text)
        if self._asked <= _PARAMETER_TRIES:
            retry_s = _PARAMETER_RETRY_S
        else:
            retry_s = _PARAMETER_SLOW_RETRY_S
        if self._due("parameters", retry_s, now_s):
            for name in self._missing_parameters():
                self._send(param_request_read(self._system, AUTOPILOT_COMPONENT, name))

    def _stay_while_deaf(self, now_s: float) -> None:
        if self._hears_attitudes:
            self._hears_attitudes = False
            self._attitude_s = now_s
            return
        place = self._place
        deaf = _DEAF_S <= now_s - self._attitude_s <= _DEAF_UNTIL_S
        if place is not None and deaf and self._due("place", _DEAF_PERIOD_S, now_s):
            self._send_command(place)

    def _renew_last_word(self, now_s: float) -> None:
        if self._last_word is not None and self._due("last word", _LAST_WORD_PERIOD_S, now_s):
            self._last_word.renew(self.last_word, self._link.peers)

    def _missing_parameters(self) -> list[str]:
        """What to ask for: what is not known, as long as it is not; GUID_OPTIONS until its bit is set, even if late."""
        self._asked += 1
        known = {
            n
            for n, value in self._state.parameters.items()
            if n != "GUID_OPTIONS" or int(value) & 8
        }
        return [name for name in needed_parameters(self._stack) if name not in known]

    def _record(self, at_us: int, raw: bytes) -> None:
        if self._recorder is not None:
            self._recorder.write(at_us, raw)

    def _send(self, message: Message) -> int:
        """Send and record a message; returns when it was sent [us]."""
        raw = self._link.send(*message)
        sent_us = self._arrivals.stamp()
        if message[0] == HEARTBEAT:
            self._beats.append(raw)
        self._record(sent_us, raw)
        return sent_us

    def _send_command(self, command: Command) -> int:
        return self._send(encode(command, self._system))

    @property
    def _holds(self) -> bool:
        """Whether our own hold flies the vehicle."""
        return (
            self._state.hold is not None
            and not self._config.dry_run
            and self._config.base is Base.HOLD
        )

    @property
    def _place(self) -> PositionCommand | None:
        """Where the autopilot should stay without us; None where no hold flies, or where it takes no places."""
        state = self._state
        heartbeat = self._state.heartbeat
        if (
            not self._holds
            or state.hold is None
            or heartbeat is None
            or mode_name(heartbeat) == "GUIDED_NOGPS"
        ):
            return None
        return PositionCommand(state.t_s, hand_over_place(state, state.hold), state.hold.target.yaw)

    @property
    def last_word(self) -> bytes:
        """The frame that the second process sends if this one is killed now; empty where others fly."""
        place = self._place
        if place is None:
            return b""
        return self._link.frame(*encode(place, self._system))

    def _hand_over(self) -> None:
        """Never leave a tilt behind: send the autopilot the place to stay at, until its own controller has settled.

        Where it takes no places (GUIDED_NOGPS), a level setpoint at hover thrust.
        """
        if not self._holds:
            return
        command: Command = self._place or level_command(self._state, self._config)
        start = self._arrivals.now_s()
        while True:
            now = self._arrivals.now_s()
            self._watchdog.alive(now)
            self._renew_last_word(now)
            self._send_command(command)
            if now - start >= _HAND_OVER_S:
                return
            self._arrivals.clock.wait([], _HAND_OVER_PERIOD_S)
            for arrival_us, frame in self._link.drain():
                self._record(arrival_us, frame.raw)
                if self._taken_away(arrival_us, frame):
                    return

    def _taken_away(self, arrival_us: int, frame: Frame) -> bool:
        """Whether this says that the vehicle is disarmed, or in a mode in which it is not ours."""
        if frame.id in LAYOUTS:
            sample = self._intake.sample(frame, arrival_us)
        else:
            sample = None
        if not isinstance(sample, Heartbeat) or sample.component != AUTOPILOT_COMPONENT:
            return False
        return not (sample.armed and takes_setpoints(sample))

    def _tell(self, text: str) -> None:
        """To the ground station and to the log."""
        self._pass_on(self._status.tell(text))

    def _tell_once(self, about: str, text: str) -> None:
        if about not in self._told:
            self._told.add(about)
            self._tell(text)

    def _say_once(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self._say(text)

    @property
    def unheard(self) -> str | None:
        """Why nothing was flown at all, in words; None where an autopilot was heard."""
        if self._streams.wanted:
            return None
        if not self._link.received and not self._link.bad:
            return "nothing was heard; does the autopilot send there?"
        if not self._link.received:
            return (
                f"{self._link.bad} damaged or unsigned frames and no good one: check baud rate "
                "and signing key"
            )
        if self._options.target_system:
            who = f" of system {self._options.target_system}"
        else:
            who = ""
        return (
            f"{self._link.received} messages but no HEARTBEAT of an autopilot{who}: check "
            "--target-system, routing"
        )

    def _say(self, text: str) -> None:
        self._watchdog.status(text)
        _LOG.info(text)

    def as_json(self) -> dict[str, Any]:
        """The flight in numbers."""
        return {
            "endpoint": self._link.endpoint,
            "system": self._intake.system,
            "autopilot": self._stack.name.lower(),
            "dry_run": self._config.dry_run,
            "messages": {
                **{
                    name: getattr(self._link, name)
                    for name in ("received", "sent", "bad", "dropped")
                },
                "ignored": self._intake.ignored,
            },
            "reboots": self.reboots,
            "ignored_systems": sorted(self._intake.others),
            "latency_ms": percentiles_ms(self._latencies),
            "record": self._recorder.as_json() if isinstance(self._recorder, Recorder) else None,
            "slow_messages_hz": dict(self._streams.in_vain),
            "set_back": dict(self._streams.set_back),
            **({} if self._config.survey is None else {"survey": self._state.survey.as_json()}),
            **self.summary.as_json(),
        }


def percentiles_ms(bins: Counter[int]) -> dict[str, float] | None:
    """Median and 99th percentile of what was counted in bins of 10 us, as upper edges; None where nothing was."""
    took = sorted(bins.elements())
    if took:
        return {
            f"p{share}": (took[(len(took) - 1) * share // 100] + 1) / 100.0 for share in (50, 99)
        }
    return None
