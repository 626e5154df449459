"""What range and rotors say about being in the air, beside the autopilot's land detector."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from companion.mavlink.samples import RotorSpeeds

ON_GROUND = 1
"""MAV_LANDED_STATE_ON_GROUND."""
_FLIES_SHARE = 0.6
"""Lift, as the square of rotor speeds, that carries a vehicle, of that in flight."""
_FLOWN_SHARE = 0.02
"""Of a new value in the average of that."""
_ABOVE_STANDING_M = 0.08
"""So much further away is the ground than where the vehicle stood."""


@dataclass(slots=True)
class AirEvidence:
    """What range and rotors say about being in the air, beside the autopilot's land detector. Lengths in metres."""

    landed_state: int = 0
    down_m: float = math.nan
    standing_m: float = math.nan
    """What the ground range read as the vehicle stood."""
    rpm2: dict[int, float] = field(default_factory=dict)
    """Square of the newest speed of each ESC."""
    flown_rpm2: float = math.nan
    """Their mean in the air, averaged."""

    def hear_range(self, distance_m: float) -> None:
        """A reading of the ground range."""
        self.down_m = distance_m
        if self.landed_state == ON_GROUND and not self._turns_as_in_flight:
            self.standing_m = distance_m

    def hear_rotors(self, sample: RotorSpeeds) -> None:
        """Rotor speeds."""
        known = {
            esc: rpm * rpm
            for esc, rpm in enumerate(sample.rpm, sample.first_esc)
            if math.isfinite(rpm)
        }
        self.rpm2 |= known
        if self.landed_state != ON_GROUND and (mean := self._mean_rpm2) > 0.0:
            if math.isnan(self.flown_rpm2):
                old = mean
            else:
                old = self.flown_rpm2
            self.flown_rpm2 = old + _FLOWN_SHARE * (mean - old)

    @property
    def _mean_rpm2(self) -> float:
        return sum(self.rpm2.values()) / max(len(self.rpm2), 1)

    @property
    def _turns_as_in_flight(self) -> bool:
        return self._mean_rpm2 >= _FLIES_SHARE * self.flown_rpm2  # False while that is not known

    @property
    def contradicts_landing(self) -> bool:
        """Whether it cannot stand on the ground."""
        return self._turns_as_in_flight and self.down_m > self.standing_m + _ABOVE_STANDING_M
