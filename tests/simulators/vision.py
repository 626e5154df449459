"""A position without GPS: visual odometry that drifts and relocalises, fused with the accelerometers as an EKF does."""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import replace

from gps import GpsEstimator

from companion.sim.body import Body
from companion.sim.fan_wrench import Vec
from companion.sim.sensors import Estimate
from models.common.frames import GRAVITY, rotation_rows

_PERIOD_S, _LATE_S = 1.0 / 30.0, 0.06
_DRIFT, _RELOCALISED_S = 0.02, 10.0
"""Of the path flown; and how often the odometry finds its place again, and the drift goes in one step."""
_NOISE_M = 0.005
_WITHIN_1_S = 4.0
"""Bandwidth of the fusion [rad/s]."""
_GATE_M = 1.0
"""Innovation from which ArduPilot rejects: VISO_POS_M_NSE 0.2 times EK3_POS_I_GATE 5."""


class VisionEstimator(GpsEstimator):
    """Attitude as ever. Place and velocity are integrated from the accelerometers and pulled to the odometry.

    x' = v + 2 z w e, v' = a + w^2 e with e = odometry - x at the time of the picture, w the bandwidth, z = 0.7. A
    relocalisation is told by the odometry's reset counter: both firmwares then set their position anew.
    """

    relative = True

    def __init__(self, body: Body, seed: int) -> None:
        super().__init__(body, seed)
        self._rng = random.Random(f"vision {seed}")
        direction = [self._rng.gauss(0.0, 1.0) for _ in range(3)]
        x, y, z = (d / math.hypot(*direction) for d in direction)
        self.drifts: Vec = (x, y, z)
        """Where to, unit."""
        self.relocalised_every_s = _RELOCALISED_S
        self._drift = [0.0, 0.0, 0.0]
        self._place, self._speed = list(body.position), list(body.velocity)
        steps = round(_LATE_S / body.dt) + 1
        self._seen: deque[Vec] = deque([self._true()] * steps, maxlen=steps)
        self._was: deque[list[float]] = deque([list(self._place)] * steps, maxlen=steps)
        self._next_s = 0.0
        self._relocalised_s = 0.0
        self._innovation_m = 0.0
        self.drift = _DRIFT
        self.frozen: Vec | None = None
        """The odometry says this place again and again."""
        self.turned_rad = 0.0
        """The odometry's own north, from north; turned about the place where that began."""
        self._pivot = self._true()

    @property
    def test_ratio(self) -> float:
        """Innovation over gate."""
        return self._innovation_m / _GATE_M if self.trusted else super().test_ratio

    def freeze(self, on: bool) -> None:
        """Repeat the present place under fresh stamps, or go on."""
        self.frozen = self._odometry() if on else None

    def turn(self, by_rad: float) -> None:
        """Say places in another frame from here on."""
        self._pivot, self.turned_rad = self._true(), by_rad

    def slip(self, by: Vec) -> None:
        """Say places that are off by ``by`` m more than before, and tell nobody."""
        self._drift = [d + b for d, b in zip(self._drift, by, strict=True)]

    def relocalise(self, jump: Vec = (0.0, 0.0, 0.0)) -> None:
        """Find the place again, ``jump`` m off: the estimate leaps there."""
        self._drift = list(jump)
        self._relocalised_s = self._body.time_s
        self._correct(1.0, 0.0)

    def step(self) -> Estimate:
        """Measure and estimate at the body's present instant."""
        body, base = self._body, super().step()
        dt = body.dt
        f = base.specific_force
        down = (0.0, 0.0, GRAVITY)
        for k, row in enumerate(rotation_rows(*base.quaternion)):
            self._place[k] += self._speed[k] * dt
            self._speed[k] += (row[0] * f[0] + row[1] * f[1] + row[2] * f[2] + down[k]) * dt
        path = math.dist(self._true(), self._seen[-1])
        self._drift = [
            d + self.drift * path * k for d, k in zip(self._drift, self.drifts, strict=True)
        ]
        self._seen.append(self._true())
        self._was.append(list(self._place))
        if self.gps and body.time_s >= self._next_s:
            self._next_s = body.time_s + _PERIOD_S
            if body.time_s - self._relocalised_s >= self.relocalised_every_s:
                self.relocalise()
            self._correct(1.4 * _WITHIN_1_S * _PERIOD_S, _WITHIN_1_S**2 * _PERIOD_S)
        place, speed = self._place, self._speed
        return replace(
            base, position=(place[0], place[1], place[2]), velocity=(speed[0], speed[1], speed[2])
        )

    def _true(self) -> Vec:
        x, y, z = self._body.position
        return (x, y, z)

    def _odometry(self) -> Vec:
        """The pose of ``_LATE_S`` ago."""
        if self.frozen is not None:
            return self.frozen
        c, s = math.cos(self.turned_rad), math.sin(self.turned_rad)
        n, e, d = (x - p for x, p in zip(self._seen[0], self._pivot, strict=True))
        turned = (c * n - s * e, s * n + c * e, d)
        x, y, z = (p + t + d for p, t, d in zip(self._pivot, turned, self._drift, strict=True))
        return (x, y, z)

    def _correct(self, place_share: float, speed_share: float) -> None:
        errors = [
            seen + self._rng.gauss(0.0, _NOISE_M) - was
            for seen, was in zip(self._odometry(), self._was[0], strict=True)
        ]
        self._innovation_m = math.hypot(*errors)
        for k, error in enumerate(errors):
            self._place[k] += place_share * error
            self._speed[k] += speed_share * error
        # What was estimated since is moved along: the next picture is compared with what is known now.
        for was in self._was:
            for k, error in enumerate(errors):
                was[k] += place_share * error
