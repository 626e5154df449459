"""What the autopilot has said of itself, and whether its telemetry comes in time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from companion.control.engagement import Engagement
from companion.mavlink.samples import Heartbeat


@dataclass(frozen=True)
class Heard:
    """The autopilot's mode and parameters."""

    heartbeat: Heartbeat | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    engagement: Engagement = field(default_factory=Engagement)
    """What its modes say about when the hold may take over."""
    late_since_s: float = math.inf
    """Since when attitude or position have been too late to fly on; inf while they are not."""
