"""What may happen to a companion's process and to its wire, in lockstep: killed, stalled, late, audited."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from arducopter_link import ArduCopterLink
from simulated import link_of
from truth_file import TruthFile

from companion import last_word
from companion.clock import Readable
from companion.config import PipelineConfig
from companion.flight.options import FlightOptions
from companion.invariants.auditor import Auditor
from companion.mavlink.tlog_writer import Recorder, Records
from companion.mavlink.wire_frames import cut
from companion.sim.flight import SimulatedFlight
from companion.sim.lockstep import Lockstep, OverError, Pilot

LAST_WORD_DELAY_S = 0.01
"""From the end of the companion to the first frame of its watchdog: a broken pipe wakes it at once."""
BUFFER_DATAGRAMS = 277
"""What a UDP socket of Linux holds by default: 212 992 bytes, 768 for each small datagram. The newest are lost."""


class Wire:
    """What is on its way from the vehicle to the companion and back, each datagram with the time of its arrival."""

    def __init__(self) -> None:
        self.down_delay_s = 0.0
        """From the vehicle to the companion; may change in flight."""
        self.up_delay_s = 0.0
        self.lost = 0
        self._down: deque[tuple[float, bytes]] = deque()
        self._up: deque[tuple[float, bytes]] = deque()

    def send_down(self, frame: bytes, now_s: float) -> None:
        """The vehicle sends."""
        waiting = (
            sum(1 for due, _ in self._down if due <= now_s)
            if len(self._down) >= BUFFER_DATAGRAMS
            else 0
        )
        if waiting >= BUFFER_DATAGRAMS:
            self.lost += 1
            return
        self._down.append((now_s + self.down_delay_s, frame))

    def send_up(self, frame: bytes, now_s: float) -> None:
        """The companion sends."""
        self._up.append((now_s + self.up_delay_s, frame))

    def ready(self, now_s: float) -> bool:
        """Whether something waits for the companion."""
        return bool(self._down) and self._down[0][0] <= now_s

    def read_down(self, now_s: float) -> bytes:
        """Everything that has reached the companion."""
        return _arrived(self._down, now_s)

    def read_up(self, now_s: float) -> bytes:
        """Everything that has reached the vehicle."""
        return _arrived(self._up, now_s)


def _arrived(queue: deque[tuple[float, bytes]], now_s: float) -> bytes:
    out = bytearray()
    while queue and queue[0][0] <= now_s:
        out += queue.popleft()[1]
    return bytes(out)


class _Audited:
    """A recording that is checked as it is written."""

    def __init__(self, auditor: Auditor, inner: Records | None) -> None:
        self._auditor, self._inner = auditor, inner

    def write(self, arrival_us: int, raw: bytes) -> None:
        self._auditor.frame(arrival_us, cut(raw, 0))
        if self._inner is not None:
            self._inner.write(arrival_us, raw)

    def flush(self) -> None:
        if self._inner is not None:
            self._inner.flush()


class _KilledError(Exception):
    """The companion's process has ended where it stood."""


class FaultyLockstep(Lockstep):
    """A flight whose pilot may also act upon the companion's process, as an operator or a bad computer would."""

    link: ArduCopterLink

    def __init__(
        self,
        flight: SimulatedFlight,
        pilot: Callable[[FaultyLockstep], Pilot],
        truth: Path | None = None,
    ) -> None:
        self.wire = Wire()
        self.start_companion_s = 0.0
        """Boot time at which the companion is started."""
        self.auditor: Auditor | None = None
        """Checks everything that is sent and decided, where one is given."""
        self.last_word = True
        """Whether the companion runs with its watchdog process, as it does by default."""
        self._words: deque[tuple[float, bytes]] = deque()
        self.stalled_until_s = -math.inf
        """Until then the companion is not scheduled."""
        self._turn_s = math.inf
        self._said = 0
        """When the companion last had its turn, and how often its watchdog process has spoken since."""
        self._killed = False
        self._truth = None if truth is None else TruthFile(truth, flight)
        watch = None if self._truth is None else self._truth.step
        super().__init__(flight, link_of, lambda _: pilot(self), watch)

    def stall(self, seconds: float) -> None:
        """The companion is not scheduled (swap, SD card, SIGSTOP); what the vehicle sends piles up in the socket.

        Its watchdog process says where to stay once it has missed its renewals.
        """
        self.stalled_until_s = self.flight.time_s + seconds

    def kill(self, restart_after_s: float = math.inf) -> None:
        """The companion ends where it stands (SIGKILL); started anew after ``restart_after_s``.

        Its watchdog process lives on and says the last word.
        """
        self._killed = True
        self._turn_s = math.inf
        start_s, word = self.flight.time_s + LAST_WORD_DELAY_S, self._word
        self._words.extend(
            (start_s + last_word.PERIOD_S * k, word.frame) for k in range(word.times)
        )
        self.start_companion_s = self.flight.time_s + restart_after_s

    def interrupt(self) -> None:
        """Ctrl-C."""
        if self.companion is not None:
            self.companion.stop()

    @property
    def _word(self) -> last_word.Word:
        """What the watchdog process holds."""
        if self.companion is None or not self.last_word:
            return last_word.SILENT
        return self.companion.last_word

    def _speak_for_a_silent_companion(self) -> None:
        due_s = self._turn_s + last_word.SILENCE_S + last_word.PERIOD_S * self._said
        if self.flight.time_s >= due_s and self._said < self._word.times:
            self._said += 1
            self.wire.send_up(self._word.frame, self.flight.time_s)

    def _fly(self, config: PipelineConfig | None, recorder: Recorder | None) -> None:
        while not self._pilot.over:
            if config is None or self.flight.time_s < self.start_companion_s:
                self._step()
                continue
            self.start_companion_s = math.inf
            self._killed = False
            self._words.clear()  # relieved by the new one
            watch = None if self.auditor is None else self.auditor.decision
            records = recorder if self.auditor is None else _Audited(self.auditor, recorder)
            with suppress(OverError, _KilledError):
                self._run_companion(config, records, FlightOptions(watch=watch))
        if self._truth is not None:
            self._truth.close()

    def _step(self) -> None:
        while self._words and self._words[0][0] <= self.flight.time_s:
            self.wire.send_up(self._words.popleft()[1], self.flight.time_s)
        self._speak_for_a_silent_companion()
        super()._step()

    def wait(self, links: Sequence[Readable], timeout_s: float) -> None:
        """Let the vehicle fly until it has said something, and the companion is scheduled again."""
        flight = self.flight
        until = flight.time_s + timeout_s
        self._turn_s, self._said = flight.time_s, 0
        while flight.time_s < self.stalled_until_s or not self.ready():
            if self._killed:
                raise _KilledError
            if flight.time_s >= max(until, self.stalled_until_s):
                break
            self._step()
        if self._killed:
            raise _KilledError
        if self._pilot.over:
            raise OverError

    def send_down(self, frame: bytes) -> None:
        """The vehicle sends."""
        self.wire.send_down(frame, self.flight.time_s)

    def ready(self) -> bool:
        """Whether something waits for the companion."""
        return self.wire.ready(self.flight.time_s)

    def _read_up(self) -> bytes:
        return self.wire.read_up(self.flight.time_s)

    def recv(self, _size: int) -> bytes:
        """What the vehicle sent."""
        return self.wire.read_down(self.flight.time_s)

    def write(self, data: bytes) -> None:
        """What the companion sends."""
        self.wire.send_up(bytes(data), self.flight.time_s)
