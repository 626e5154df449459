"""Faults of a log, or of the vehicle file it is read with: told, left out, and never named as an effect."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LogFault:
    """A channel that is not to be believed, and why."""

    channel: str
    what: str
