"""What is sent and what is recorded: every frame of both directions, as it went over the wire."""

from __future__ import annotations

from collections import deque

from companion.mavlink import OWN_COMPONENT
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.message_filter import HEARTBEAT, Intake
from companion.mavlink.outgoing import Message
from companion.mavlink.setpoints import Command, encode
from companion.mavlink.tlog_writer import Records


class Outbox:
    """Sends as component 191 of the vehicle, and records what is sent."""

    def __init__(
        self, link: Link, recorder: Records | None, arrivals: Arrivals, intake: Intake
    ) -> None:
        self._link = link
        self.recorder = recorder
        self._arrivals = arrivals
        self._intake = intake
        self._beats: deque[bytes] = deque(maxlen=4)
        """Our own heartbeats, to tell them from another program's where a link sends them back."""
        self.identify()

    @property
    def system(self) -> int:
        """The vehicle's system id; 1 until one is heard."""
        return self._intake.system or 1

    def identify(self) -> None:
        """From now on frames carry the vehicle's system id."""
        self._link.identify(self.system, OWN_COMPONENT)

    def send(self, message: Message) -> int:
        """Send and record a message; returns when it was sent [us]."""
        raw = self._link.send(*message)
        sent_us = self._arrivals.stamp()
        if message[0] == HEARTBEAT:
            self._beats.append(raw)
        self.record(sent_us, raw)
        return sent_us

    def command(self, command: Command) -> int:
        """The same of a setpoint."""
        return self.send(encode(command, self.system))

    def record(self, at_us: int, raw: bytes) -> None:
        """A frame of either direction."""
        if self.recorder is not None:
            self.recorder.write(at_us, raw)

    def flush(self) -> None:
        """What is recorded reaches the file."""
        if self.recorder is not None:
            self.recorder.flush()

    def sent_lately(self, raw: bytes) -> bool:
        """Whether a heartbeat is one of our own last ones."""
        return raw in self._beats
