"""The vehicle in its air: whether it flies, and what the air does to it by the model."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.control.landed import Airborne
from companion.disturbance.records import Disturbance

_AIRBORNE = Airborne()


@dataclass(frozen=True)
class Air:
    """The modelled air around the vehicle."""

    airborne: Airborne = _AIRBORNE
    disturbance: Disturbance | None = None
    disturbance_s: float = -math.inf
    """When it was computed: after a position, so that an attitude is answered without waiting for the model."""
    lift_share: float = 1.0
    """Modelled free-air lift over the weight, averaged while the vehicle flies."""
