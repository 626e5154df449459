"""How the vehicle answers, as far as it is known, and the gains that were chosen for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from companion.control.attitude_response import AttitudeResponse
from companion.control.plant import AttitudeLoop, HoldTuning, Timing
from companion.control.swing_detector import SwingDetector

_NO_RESPONSE = AttitudeResponse()


@dataclass(frozen=True, kw_only=True)
class Plant:
    """The vehicle and its autopilot as the hold sees them."""

    timing: Timing = field(default_factory=Timing)
    response: AttitudeResponse = _NO_RESPONSE
    """What the measured attitude loop comes from."""
    loop: AttitudeLoop = field(default_factory=AttitudeLoop)
    """How the attitude answers, as far as known."""
    tuned: HoldTuning | None = None
    tuned_s: float = -math.inf
    swing: SwingDetector = field(default_factory=SwingDetector)
