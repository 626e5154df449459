"""What the pilot reads of a flight: in the ground station, in the terminal, and each thing once."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from companion.control.survey import Phase, Survey
from companion.flight.outbox import Outbox
from companion.mavlink.outgoing import Message
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState
from companion.telemetry.status import StatusReporter
from companion.watchdog import Watchdog

_LOG = logging.getLogger(__name__)


class Pilot:
    """Words for the ground station (``tell``) and for terminal and service manager (``say``)."""

    def __init__(self, outbox: Outbox, watchdog: Watchdog) -> None:
        self._outbox = outbox
        self._watchdog = watchdog
        self._status = StatusReporter()
        self._told: set[str] = set()
        """What is said once a flight, and was."""
        self._survey: tuple[Phase, str] = (Phase.WAITING, "")
        """What was last said of a survey."""

    def tell(self, text: str) -> None:
        """To the ground station and to the log."""
        self._pass_on(self._status.tell(text))

    def tell_once(self, about: str, text: str) -> None:
        """The same, the first time only."""
        if about not in self._told:
            self._told.add(about)
            self.tell(text)

    def say(self, text: str) -> None:
        """To the log."""
        self._watchdog.status(text)
        _LOG.info(text)

    def say_once(self, text: str) -> None:
        """The same, the first time only."""
        if text not in self._told:
            self._told.add(text)
            self.say(text)

    def hear_decision(self, state: PipelineState, decision: Decision, *, excused: bool) -> None:
        """What changed. ``excused``: what comes late is this computer's own fault."""
        self._pass_on(self._status.messages(state, decision, excused=excused))

    def hear_survey(self, survey: Survey) -> None:
        """How a survey goes on, where that is new."""
        if (survey.phase, survey.why) == self._survey:
            return
        self._survey = (survey.phase, survey.why)
        text = f"companion: {survey.phase.value}"
        if survey.why:
            text += f": {survey.why}"
        self._pass_on(self._status.tell(text, warning=False))

    def _pass_on(self, messages: Iterable[tuple[Message, str | None]]) -> None:
        """Each message to the ground station, and its text to the log."""
        for outgoing, text in messages:
            self._outbox.send(outgoing)
            if text is not None:
                self.say(text)
