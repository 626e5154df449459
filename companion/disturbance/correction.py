"""What adaptation makes of the model: the measured sizes, as far as the disturbance asks for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from companion.disturbance.records import FanPlaces
from models.common.frames import Array
from models.vehicle import Vehicle


class Correction(Protocol):
    """Measured in flight, beside the model or in place of it."""

    def compensated(
        self, vehicle: Vehicle, above: Sequence[Sequence[float]], around: FanPlaces, effects: Array
    ) -> Array:
        """(6,), body FRD about the CG: what is compensated of wrenches at the fans (fans, 6) and effects (k, 6)."""

    def pull_change_n(self, modelled_n: float, around: FanPlaces, step_radii: float) -> float:
        """How much weaker the pull to the wall gets ``step_radii`` further off [N]; ``modelled_n`` by the model."""
