"""What is heard: frames go into the pipeline, and a setpoint that one brings is sent at once."""

from __future__ import annotations

from companion.config import PipelineConfig
from companion.flight.hand_over import HandOver
from companion.flight.housekeeping import Housekeeping
from companion.flight.latency import Latencies
from companion.flight.outbox import Outbox
from companion.flight.pilot import Pilot
from companion.flight.reports import Reports
from companion.flight.requests import Requests
from companion.mavlink import AUTOPILOT_COMPONENT, OWN_COMPONENT
from companion.mavlink.firmware import stack_of
from companion.mavlink.link import Link
from companion.mavlink.message_filter import HEARTBEAT, Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Attitude, Heartbeat, Sample, SetPositionTarget
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET
from companion.mavlink.wire_frames import Frame
from companion.pipeline import answer, initial_state
from companion.settle import settle


class Incoming:
    """Owns the state of the pipeline, and keeps the books of what was heard."""

    def __init__(
        self,
        *,
        config: PipelineConfig,
        intake: Intake,
        upstream: Link | None,
        outbox: Outbox,
        pilot: Pilot,
        requests: Requests,
        housekeeping: Housekeeping,
        hand_over: HandOver,
        reports: Reports,
    ) -> None:
        self.state = initial_state(config)
        self.latencies = Latencies()
        self.reboots = 0
        self._config = config
        self._intake = intake
        self._upstream = upstream
        self._outbox = outbox
        self._pilot = pilot
        self._requests = requests
        self._housekeeping = housekeeping
        self._hand_over = hand_over
        self._reports = reports
        self._set_back_s = 0.0
        """By how much the vehicle's clock was set back, as last told."""

    def take(self, arrival_us: int, frame: Frame) -> None:
        """A frame of the vehicle's link; an upstream controller hears what the vehicle says."""
        self._outbox.record(arrival_us, frame.raw)
        if self._upstream is not None and frame.system == self._intake.system:
            self._upstream.forward(frame.raw)
        if frame.id in LAYOUTS:
            self._feed(arrival_us, frame)

    def take_upstream(self, arrival_us: int, frame: Frame) -> None:
        """A frame of an upstream controller: its setpoints count."""
        if frame.id == SET_ATTITUDE_TARGET:
            self._outbox.record(arrival_us, frame.raw)
            self._feed(arrival_us, frame)

    def _feed(self, arrival_us: int, frame: Frame) -> None:
        """One frame into the pipeline; a setpoint that it brings is sent before anything else is done."""
        intake = self._intake
        sample = intake.sample(frame, arrival_us)
        self._watch_vehicle_clock()
        if frame.system in intake.others:
            self._pilot.say_once(
                f"companion: ignoring system {frame.system}; flying with system {intake.system}"
            )
        if sample is None:
            if frame.system == intake.system:
                self._note_unread(frame)
            return
        self.state, decision = answer(self.state, sample, self._config)
        if decision is not None and decision.command is not None and not self._config.dry_run:
            self.latencies.add(self._outbox.command(decision.command) - arrival_us)
        self.state = settle(self.state, sample, decision, self._config)
        self._note(frame, sample)
        if decision is not None:
            self._reports.tell(self.state, decision)

    def _watch_vehicle_clock(self) -> None:
        """Whether the vehicle has rebooted, or its clock was set back."""
        clock = self._intake.clock
        if clock.boot != self.reboots:
            self.reboots = clock.boot
            self._pilot.say("companion: the vehicle rebooted; starting over")
            self._requests.start_over()
        if clock.set_back_s != self._set_back_s:
            self._set_back_s = clock.set_back_s
            self._pilot.tell(
                "companion: the vehicle's clock was set back, or stood still, by "
                f"{self._set_back_s:.2f} s"
            )

    def _note_unread(self, frame: Frame) -> None:
        """Of what is not for ``step``: streams that are only recorded, and another program that is this component."""
        if frame.id in self._intake.unread:
            self._requests.streams.heard(frame.id)
        own = frame.id == HEARTBEAT and frame.component == OWN_COMPONENT
        if own and not self._outbox.sent_lately(frame.raw):
            self._pilot.tell_once(
                "twin",
                "companion: another program is component 191 too: stop it or give it another id",
            )

    def _note(self, frame: Frame, sample: Sample) -> None:
        """Streams, heartbeats, targets to others, a survey's progress."""
        self._requests.streams.heard(frame.id)
        if isinstance(sample, Attitude):
            self._hand_over.hear_attitude()
        elif isinstance(sample, Heartbeat) and sample.component == AUTOPILOT_COMPONENT:
            self._housekeeping.hear_heartbeat()
            self._outbox.identify()
            self._requests.connect(stack_of(sample))
        elif isinstance(sample, SetPositionTarget) and self.state.held.hold is not None:
            self._note_target(sample.target_component)
        if self._config.survey is not None:
            self._pilot.hear_survey(self.state.requests.survey)

    def _note_target(self, component: int) -> None:
        if component not in (0, OWN_COMPONENT):
            self._pilot.tell_once(
                "stray target",
                f"companion: that target went to component {component}; 191 moves the hold",
            )
