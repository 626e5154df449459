"""What the command line decided about a flight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from companion.page.feed import PageFeed
from companion.state.decision import Decision
from companion.watchdog import Watchdog


@dataclass(frozen=True, kw_only=True)
class FlightOptions:
    """What the command line decided about a flight."""

    duration_s: float | None = None
    target_system: int | None = None
    last_word: bool = False
    """Start the second process that sends the autopilot a place to stay at if this one is killed."""
    watch: Callable[[Decision], None] | None = None
    """Called with every decision."""
    watchdog: Watchdog = field(default_factory=lambda: Watchdog({}))
    """Kept informed that the loop runs; the default tells nobody."""
    page: PageFeed | None = None
    """Shown what is decided."""
