"""What the autopilot has said of itself, and whether its telemetry comes in time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from companion.control.engagement import Engagement
from companion.mavlink.firmware import (
    Stack,
    ThrustMeaning,
    stack_of,
    takes_setpoints,
    thrust_meaning,
)
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

    @cached_property
    def stack(self) -> Stack:
        """The firmware."""
        return stack_of(self.heartbeat)

    @cached_property
    def takes_setpoints(self) -> bool:
        """True in the modes in which an attitude setpoint is obeyed."""
        return takes_setpoints(self.heartbeat)

    @cached_property
    def thrust_meaning(self) -> ThrustMeaning:
        """What a thrust command would do now."""
        if self.heartbeat is None:
            return ThrustMeaning.UNKNOWN
        return thrust_meaning(self.heartbeat, self.parameters)
