"""The time that the flight loop lives by: the system's, or that of a simulated vehicle which waits for every answer."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from typing import Protocol


class Readable(Protocol):
    """Something that ``wait`` can wait for."""

    @property
    def fileno(self) -> int:
        """What select() waits on; -1 while there is nothing."""


class Clock(Protocol):
    """A clock that only goes forward, the date, and a way to sleep until something arrives."""

    def monotonic_ns(self) -> int:
        """Nanoseconds since an arbitrary start."""

    def time(self) -> float:
        """Unix time [s]."""

    def wait(self, links: Sequence[Readable], timeout_s: float) -> None:
        """Sleep until a link has data, at most ``timeout_s``."""


class SystemClock:
    """The computer's own."""

    monotonic_ns = staticmethod(time.monotonic_ns)
    time = staticmethod(time.time)

    def wait(self, links: Sequence[Readable], timeout_s: float) -> None:
        """Sleep until a link has data, at most ``timeout_s``."""
        try:
            select.select([link.fileno for link in links if link.fileno >= 0], [], [], timeout_s)
        except (OSError, ValueError):
            time.sleep(min(timeout_s, 0.01))
