"""The live loop: one thread that waits on the sockets, feeds ``step``, and sends what it decides."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.config import Base, PipelineConfig
from companion.mavlink.firmware import Stack, needed_parameters, stack_of
from companion.mavlink.frames import Frame
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.message_filter import AUTOPILOT_COMPONENT, OWN_COMPONENT, Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Heartbeat
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET, Command, PositionCommand, encode
from companion.mavlink.stream_rates import StreamKeeper, interval_request, wanted_streams
from companion.mavlink.tlog_writer import Recorder
from companion.pipeline import initial_state, step, stopped
from companion.telemetry.status import StatusReporter
from companion.telemetry.summary import Summary

_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _ACTIVE = 18, 8, 4
_LOST_S = 3.0
_STOP_S = 0.7
_PARAMETER_RETRY_S = 1.0
_PARAMETER_TRIES = 10


@dataclass(frozen=True)
class FlightOptions:
    """What the command line decided about a flight."""

    duration_s: float | None = None
    target_system: int | None = None
    quiet: bool = False


class Flight:
    """One run of the companion on open links. ``stop`` may be called from a signal handler."""

    def __init__(
        self,
        config: PipelineConfig,
        link: Link,
        upstream: Link | None,
        recorder: Recorder | None,
        arrivals: Arrivals,
        options: FlightOptions,
    ) -> None:
        self.summary = Summary()
        self.reboots = 0
        self.unused = 0
        """Frames of messages that nobody here reads."""
        self._config = config
        self._link = link
        self._upstream = upstream
        self._recorder = recorder
        self._arrivals = arrivals
        self._options = options
        self._intake = Intake(options.target_system)
        self._state = initial_state(config)
        self._status = StatusReporter()
        self._streams: StreamKeeper | None = None
        self._stack = Stack.OTHER
        self._heard_s = -np.inf
        self._started_s = arrivals.now_s()
        self._complained = False
        self._beat_s = self._asked_s = self._flushed_s = -np.inf
        self._asked = 0
        self._stop_s: float | None = None
        self._latencies_us: list[int] = []
        link.identify(self._system, OWN_COMPONENT)

    def stop(self) -> None:
        """Fade the offsets out, hand back, end."""
        if self._stop_s is None:
            self._stop_s = self._arrivals.now_s()

    def run(self) -> None:
        """Fly until stopped or until the duration is over."""
        links = [self._link] if self._upstream is None else [self._link, self._upstream]
        start = self._arrivals.now_s()
        while True:
            now = self._arrivals.now_s()
            if self._options.duration_s is not None and now - start >= self._options.duration_s:
                self.stop()
            if self._stop_s is not None:
                if not self._state.stopping:
                    self._state = stopped(self._state)
                if self._faded() or now - self._stop_s > _STOP_S:
                    break
            self._arrivals.clock.wait(links, 0.02)
            for arrival_us, frame in self._link.drain():
                self._take(arrival_us, frame)
            if self._upstream is not None:
                for arrival_us, frame in self._upstream.drain():
                    self._take_upstream(arrival_us, frame)
            self._housekeeping(self._arrivals.now_s())
        self._hand_back()

    def _faded(self) -> bool:
        return self._state.authority <= 0.0

    def _take(self, arrival_us: int, frame: Frame) -> None:
        if self._recorder is not None:
            self._recorder.write(arrival_us, frame.raw)
        if self._upstream is not None and frame.system == self._intake.system:
            self._upstream.forward(frame.raw)
        if frame.id in LAYOUTS:
            self._feed(arrival_us, frame)
        else:
            self.unused += 1

    def _take_upstream(self, arrival_us: int, frame: Frame) -> None:
        if frame.id != SET_ATTITUDE_TARGET:
            return
        if self._recorder is not None:
            self._recorder.write(arrival_us, frame.raw)
        self._feed(arrival_us, frame)

    def _feed(self, arrival_us: int, frame: Frame) -> None:
        intake = self._intake
        boot, ignored = intake.clock.boot, len(intake.others)
        sample = intake.sample(frame, arrival_us)
        if intake.clock.boot != boot:
            self._rebooted()
        if len(intake.others) > ignored:
            self._say(f"companion: ignoring system {frame.system}; flying with system {intake.system}")
        if sample is None:
            return
        if isinstance(sample, Heartbeat) and sample.component == AUTOPILOT_COMPONENT:
            self._connected(sample)
        if self._streams is not None:
            self._streams.heard(frame.id, self._arrivals.now_s())
        self._state, decision = step(self._state, sample, self._config)
        if decision is None:
            return
        if decision.command is not None and not self._config.dry_run:
            self._latencies_us.append(self._send_command(decision.command) - arrival_us)
        self.summary.add(decision)
        for outgoing, text in self._status.messages(self._link.mav, self._state, decision):
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
        if self._streams is None or stack is not self._stack:
            self._stack = stack
            self._streams = StreamKeeper(wanted_streams(self._config.vehicle, stack))
            self._say(f"companion: connected to system {self._system} ({stack.name.lower()})")

    def _rebooted(self) -> None:
        self.reboots += 1
        self._say("companion: the vehicle rebooted; starting over")
        if self._streams is not None:
            self._streams.forget()
        self._asked_s, self._asked = -np.inf, 0

    def _housekeeping(self, now_s: float) -> None:
        if now_s - self._flushed_s > 0.5 and self._recorder is not None:
            self._flushed_s = now_s
            self._recorder.flush()
        if now_s - self._beat_s >= 1.0:
            self._beat_s = now_s
            self._send(self._link.mav.heartbeat_encode(_ONBOARD_CONTROLLER, _NO_AUTOPILOT, 0, 0, _ACTIVE))
        if self._streams is None:
            if not self._complained and now_s - self._started_s > _LOST_S:
                self._complained = True
                self._say(f"companion: no heartbeat on {self._link.endpoint} yet; does the autopilot send there?")
            return
        if now_s - self._heard_s > _LOST_S:
            self._streams.forget()
            return
        for wanted in self._streams.due(now_s):
            self._send(interval_request(self._link.mav, wanted, self._system))
        if now_s - self._asked_s >= _PARAMETER_RETRY_S:
            self._asked_s = now_s
            for name in self._missing_parameters():
                self._send(
                    self._link.mav.param_request_read_encode(self._system, AUTOPILOT_COMPONENT, name.encode(), -1)
                )

    def _missing_parameters(self) -> list[str]:
        """What to ask for: what was not answered, a few times; GUID_OPTIONS until its bit is set, even if late."""
        known = self._state.parameters
        self._asked += 1
        tries_left = self._asked <= _PARAMETER_TRIES
        out = [name for name in needed_parameters(self._stack) if name not in known and tries_left]
        if self._stack is Stack.ARDUPILOT and not int(known.get("GUID_OPTIONS", 0.0)) & 8 and "GUID_OPTIONS" not in out:
            out.append("GUID_OPTIONS")
        return out

    def _send(self, message: Any) -> None:
        raw = self._link.send(message)
        if self._recorder is not None:
            self._recorder.write(self._arrivals.stamp(), raw)

    def _send_command(self, command: Command) -> int:
        """Send and record a setpoint; returns when it was sent [us]."""
        raw = self._link.send_payload(*encode(command, self._system))
        sent_us = self._arrivals.stamp()
        if self._recorder is not None:
            self._recorder.write(sent_us, raw)
        return sent_us

    def _hand_back(self) -> None:
        """Leave an ArduPilot holding where it is rather than with the last attitude for all of GUID_TIMEOUT."""
        hold = self._state.hold
        if hold is None or self._config.dry_run or self._config.base is not Base.HOLD:
            return
        if self._stack is Stack.ARDUPILOT:
            north, east, down = map(float, hold.reference.position)
            place = PositionCommand(self._state.t_s, (north, east, down), hold.target.yaw)
            self._send_command(place)

    def _say(self, text: str) -> None:
        if not self._options.quiet:
            print(text, file=sys.stderr, flush=True)

    def as_json(self) -> dict[str, Any]:
        """The flight in numbers."""
        latencies = np.array(self._latencies_us, dtype=float) / 1000.0
        return {
            "endpoint": self._link.endpoint,
            "system": self._intake.system,
            "autopilot": self._stack.name.lower(),
            "dry_run": self._config.dry_run,
            "messages": {
                "received": self._link.received,
                "sent": self._link.sent,
                "bad": self._link.bad,
                "unused": self.unused,
            },
            "reboots": self.reboots,
            "ignored_systems": sorted(self._intake.others),
            "latency_ms": None
            if not latencies.size
            else {"p50": float(np.percentile(latencies, 50)), "p99": float(np.percentile(latencies, 99))},
            "asked_again": {} if self._streams is None else dict(self._streams.asked_again),
            **self.summary.as_json(),
        }
