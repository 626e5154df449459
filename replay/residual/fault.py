"""What a fault of a log is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LogFault:
    """A channel that is not to be believed, and why."""

    channel: str
    what: str
