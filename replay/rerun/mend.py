"""What to correct first so that offsets act: the reason that stopped them longest, except those of every flight."""

from __future__ import annotations

from collections.abc import Iterable

from companion.control.authority import Reason

_ORDINARY = (Reason.NOT_ARMED, Reason.LANDED, Reason.TAKING_OFF, Reason.STOPPING)


def to_mend(refusals: Iterable[tuple[Reason, float]]) -> str:
    """The reason with most seconds, and these; empty where there are only those that every flight has."""
    own = [(seconds, reason.value) for reason, seconds in refusals if reason not in _ORDINARY and seconds > 0.0]
    seconds, reason = max(own, default=(0.0, ""))
    return f"{reason}, {lasted(seconds)}" if reason else ""


def lasted(seconds: float) -> str:
    """A length of time in words."""
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} minutes"
