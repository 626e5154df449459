"""Telemetry that arrives late: from when on offsets fade, and from when on the hold lets go."""

from __future__ import annotations

from companion.config import Base, PipelineConfig
from companion.estimation.estimates import Estimates

LATE_FADE_S = 0.15
"""Attitudes or positions that arrive later than this by their own stamps fade the offsets: a hover offset moves by its
own size within about 0.5 s, and the attitude loop behind it has some 20 degrees of phase left."""
LATE_STOP_S = 0.18
"""Attitudes or positions that arrive later than this are not flown on: at 0.2 s the hold swung into a wall 0.3 m away
in the simulation (``link_late_0.2s`` of the fault campaign)."""
LATE_STOP_FOR_S = 0.2
"""Telemetry later than ``LATE_STOP_S`` for so long ends the hold. On the vehicle's clock: a short burst after a gap of
the link is caught up with instead."""


def lateness(estimates: Estimates, config: PipelineConfig) -> float:
    """How late [s] the newest attitude, and for the hold the newest position, arrived."""
    attitude = estimates.attitude
    position = estimates.position
    if attitude is None:
        late_s = 0.0
    else:
        late_s = attitude.late_s
    if position is not None and position.late_s > late_s and config.base is Base.HOLD:
        return position.late_s
    return late_s
