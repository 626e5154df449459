"""What to correct first so that offsets act: the reason that stopped them longest, except those of every flight."""

from __future__ import annotations

from collections.abc import Iterable

from companion.control.authority import Reason

_ORDINARY = (Reason.NOT_ARMED, Reason.LANDED, Reason.TAKING_OFF, Reason.STOPPING)


def to_mend(refusals: Iterable[tuple[Reason, float]]) -> tuple[Reason, float] | None:
    """The reason with most seconds, and these; None where there are only those that every flight has."""
    own = [(reason, seconds) for reason, seconds in refusals if reason not in _ORDINARY and seconds > 0.0]
    return max(own, key=lambda item: item[1], default=None)


def lasted(seconds: float) -> str:
    """A length of time in words."""
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} minutes"
