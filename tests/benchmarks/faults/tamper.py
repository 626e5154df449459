"""Interference on the wire from the vehicle to the companion: messages changed, dropped, doubled, delayed, added."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

from lockstep_faults import Wire
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mavlink.signing import Signatures
from companion.mavlink.wire_frames import cut, pack

Edit = Callable[[Any], bool | None]
"""Changes a message in place; False: it is not sent at all."""
Path = Callable[[bytes], Iterable[tuple[float, bytes]]]
"""What becomes of a frame: (delay [s], bytes), none or several."""


class Tamper:
    """Stands before ``Wire.send_down``. ``edits``: messages of the autopilot, by id; ``paths``: all frames, in turn."""

    def __init__(self, wire: Wire, seed: int) -> None:
        self.rng = random.Random(f"tamper {seed}")
        self.edits: dict[int, Edit] = {}
        self.paths: list[Path] = []
        self.signatures: Signatures | None = None
        """Signs what the vehicle sends."""
        self.clock_ms = 0
        """What the autopilot's clock is ahead of the simulation's."""
        self._send = wire.send_down
        self._later: list[tuple[float, int, bytes]] = []
        self._number = count()
        self._parser = mavlink.MAVLink(None)
        self._writer = mavlink.MAVLink(None)
        wire.send_down = self._take  # type: ignore[method-assign]

    def clear(self) -> None:
        """All is well again."""
        self.edits.clear()
        self.paths.clear()

    def say(self, message: Any, now_s: float, system: int = 1, component: int = 1) -> None:
        """Add a message of anybody's."""
        self._writer.srcSystem = system
        self._writer.srcComponent = component
        self._send(message.pack(self._writer), now_s)
        self._writer.seq = (self._writer.seq + 1) % 256

    def inject(self, raw: bytes, now_s: float) -> None:
        """Add bytes of anybody's."""
        self._send(raw, now_s)

    def step(self, now_s: float) -> None:
        """Deliver what was delayed. Call at every physics step."""
        while self._later and self._later[0][0] <= now_s:
            self._send(heapq.heappop(self._later)[2], now_s)

    def _take(self, frame: bytes, now_s: float) -> None:
        edited = self._edited(frame)
        if edited is None:
            return
        if self.signatures is not None:
            edited = signed(edited, self.signatures)
        ways = [(0.0, edited)]
        for path in self.paths:
            ways = [(before + after, out) for before, one in ways for after, out in path(one)]
        for delay, out in ways:
            if delay <= 0.0:
                self._send(out, now_s)
            else:
                heapq.heappush(self._later, (now_s + delay, next(self._number), out))

    def _edited(self, frame: bytes) -> bytes | None:
        head = cut(frame, 0)
        edit = self.edits.get(head.id)
        if (edit is None and not self.clock_ms) or (head.system, head.component) != (1, 1):
            return frame
        if head.id not in mavlink.mavlink_map:
            return frame if edit is None or edit(None) is not False else None
        message = self._parser.parse_buffer(frame)[0]
        if hasattr(message, "time_boot_ms"):
            message.time_boot_ms = (message.time_boot_ms + self.clock_ms) % 2**32
        elif hasattr(message, "time_usec"):
            message.time_usec = (message.time_usec + 1000 * self.clock_ms) % 2 ** (
                32 if head.id == 36 else 64
            )
        if edit is not None and edit(message) is False:
            return None
        self._writer.srcSystem = 1
        self._writer.srcComponent = 1
        out: bytes = message.pack(self._writer)
        self._writer.seq = (self._writer.seq + 1) % 256
        return out


def signer(key: bytes) -> Signatures:
    """Signatures of a sender of its own, its clock at 0 as in every simulated flight."""
    state = mavlink.MAVLink(None).signing
    state.secret_key = key
    return Signatures(state)


def signed(frame: bytes, signatures: Signatures) -> bytes:
    """The same message in a signed frame."""
    f = cut(frame, 0)
    return signatures.sign(pack(f.id, f.payload, f.system, f.component, frame[4], signed=True))
