"""An EKF whose GPS may be lost in flight."""

from __future__ import annotations

import math
import random
from dataclasses import replace

from companion.sim.body import Body
from companion.sim.sensors import Estimate, Estimator

DISTRUST_S = 5.0
"""Without GPS: after this long the real PX4's ESTIMATOR_STATUS clears its position flags."""
DEAD_RECKONING_M_S2 = 0.0086
"""1.9 m in 21 s, as the real PX4 went astray."""


class GpsEstimator(Estimator):
    """Without GPS it dead-reckons: position and velocity go on, and go wrong as an accelerometer's bias integrates.

    After ``DISTRUST_S`` it says so. When GPS returns they leap back.
    """

    relative = False
    """Whether its position has no place on Earth, as without GPS."""

    def __init__(self, body: Body, seed: int) -> None:
        super().__init__(body, seed)
        biases = random.Random(f"bias {seed}")
        for _ in range(
            12
        ):  # those of the estimator: the direction is the next number of the same stream
            biases.gauss(0.0, 1.0)
        bearing = biases.uniform(-math.pi, math.pi)
        self._astray = (
            DEAD_RECKONING_M_S2 * math.cos(bearing),
            DEAD_RECKONING_M_S2 * math.sin(bearing),
        )
        self.gps = True
        self._without_s = 0.0

    @property
    def trusted(self) -> bool:
        """Whether the estimator itself trusts its position."""
        return self._without_s < DISTRUST_S

    @property
    def test_ratio(self) -> float:
        """Largest test ratio of position and velocity: above 1 measurements are rejected."""
        return 0.05 if self.trusted else 1.5

    def step(self) -> Estimate:
        """Measure and estimate at the body's present instant."""
        base = super().step()
        self._without_s = 0.0 if self.gps else self._without_s + self._body.dt
        if self.gps:
            return base
        t, (n, e, d), (vn, ve, vd) = self._without_s, base.position, base.velocity
        (an, ae), half = self._astray, 0.5 * t * t
        position, velocity = (n + half * an, e + half * ae, d), (vn + t * an, ve + t * ae, vd)
        return replace(base, position=position, velocity=velocity, trusted=self.trusted)
