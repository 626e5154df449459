"""What goes out to the autopilot, from one setpoint to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.control.compensation import Offsets
from companion.control.hand_over import HandOver
from companion.control.position_hold import BaseSetpoint

_NO_OFFSETS = Offsets()


@dataclass(frozen=True)
class Sending:
    """The newest setpoint and its offsets."""

    offsets: Offsets = _NO_OFFSETS
    decided_s: float = -math.inf
    last: BaseSetpoint | None = None
    """What was sent last, offsets included."""
    hand_over: HandOver | None = None
    """The end of a hold, while it lasts."""
