"""What the vehicle knows of itself: noise, bias, delay and quantisation of real sensors, and an EKF-like estimate."""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from companion.sim.air import Unsteadiness
from companion.sim.body import Body, euler, turned
from companion.sim.fan_wrench import Vec
from models.common.frames import GRAVITY
from models.vehicle import Rangefinder

OUT_OF_RANGE_M = 60.0
"""What a lidar reports without an echo: beyond its greatest distance, as real ones do."""
RANGE_MIN_M = 0.03
RANGE_MAX_M = 40.0
"""Least and greatest distance of the simulated lidar, as it announces them."""
BEAM_DIRECTIONS: dict[int, Vec] = {
    **{k: (math.cos(k * math.pi / 4), math.sin(k * math.pi / 4), 0.0) for k in range(8)},
    12: (-1.0, 0.0, 0.0),
    24: (0.0, 0.0, -1.0),
    25: (0.0, 0.0, 1.0),
}
"""Beam directions, body FRD, of the orientations that a simulated rangefinder may have."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """The autopilot's belief: attitude, rates [rad/s], NED position and velocity, specific force [m/s^2]."""

    quaternion: tuple[float, float, float, float]
    roll: float
    pitch: float
    yaw: float
    rates: Vec
    position: Vec
    velocity: Vec
    specific_force: Vec
    trusted: bool = True
    """What the EKF says of its own position."""

    @property
    def down_acceleration(self) -> float:
        """Acceleration towards the ground [m/s^2], from the accelerometers."""
        cr = math.cos(self.roll)
        sr = math.sin(self.roll)
        cp = math.cos(self.pitch)
        sp = math.sin(self.pitch)
        fx, fy, fz = self.specific_force
        return -sp * fx + sr * cp * fy + cr * cp * fz + GRAVITY


class Estimator:
    """IMU and EKF. Errors: attitude 0.1 deg, position 4 mm (10 s), velocity 1 cm/s (1 s), each about a fixed bias.

    Its random streams depend on the seed and on time alone, never on the flight: two flights with one seed are paired.
    """

    def __init__(self, body: Body, seed: int) -> None:
        self._body = body
        rng = random.Random(f"bias {seed}")
        self._white = random.Random(f"imu {seed}")
        self._slow = Unsteadiness(f"attitude {seed}", 3, body.dt, tau=20.0)
        self._position = Unsteadiness(f"position {seed}", 3, body.dt, tau=10.0)
        self._velocity = Unsteadiness(f"velocity {seed}", 3, body.dt, tau=1.0)
        self._tilt_bias = [rng.gauss(0.0, math.radians(0.15)) for _ in range(3)]
        self._position_bias = [rng.gauss(0.0, 0.008) for _ in range(3)]
        self._accel_bias = [rng.gauss(0.0, 0.02) for _ in range(3)]
        self._gyro_bias = [rng.gauss(0.0, 0.0005) for _ in range(3)]

    def step(self) -> Estimate:
        """Measure and estimate at the body's present instant."""
        body = self._body
        gauss = self._white.gauss
        slow = self._slow.step()
        where = self._position.step()
        speed = self._velocity.step()
        a = math.radians(0.1)
        ex, ey, ez = (0.5 * (a * s + b) for s, b in zip(slow, self._tilt_bias, strict=True))
        w, x, y, z = body.quaternion
        q = (
            w - x * ex - y * ey - z * ez,
            x + w * ex - z * ey + y * ez,
            y + z * ex + w * ey - x * ez,
        )
        qz = z - y * ex + x * ey + w * ez
        size = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + qz * qz)
        unit = (q[0] / size, q[1] / size, q[2] / size, qz / size)
        roll, pitch, yaw = euler(unit)
        return Estimate(
            quaternion=unit,
            roll=roll,
            pitch=pitch,
            yaw=yaw,
            rates=_sum(body.rates, self._gyro_bias, [gauss(0.0, 0.008) for _ in range(3)]),
            position=_sum(body.position, self._position_bias, [0.004 * v for v in where]),
            velocity=_sum(body.velocity, [0.01 * v for v in speed]),
            specific_force=_sum(
                body.specific_force, self._accel_bias, [gauss(0.0, 0.15) for _ in range(3)]
            ),
        )


def _sum(*parts: Sequence[float]) -> Vec:
    x, y, z = map(sum, zip(*parts, strict=True))
    return (x, y, z)


class RangeFault(Enum):
    """How a range may go wrong."""

    LOST = "no echo"
    FROZEN = "the last reading again and again"


class RangeSensor:
    """One lidar: 50 Hz, 20 ms late, sd 8 mm, 1 cm steps, one sample in a hundred lost (reads out of range)."""

    def __init__(self, sensor: Rangefinder, seed: str, direction: Vec | None = None) -> None:
        self.sensor = sensor
        self.direction = direction or BEAM_DIRECTIONS.get(sensor.orientation, (1.0, 0.0, 0.0))
        self._rng = random.Random(seed)
        self._late: deque[float] = deque(maxlen=2)
        self._next_s = 0.0
        self.reading_m = OUT_OF_RANGE_M
        self.fault: RangeFault | None = None

    def step(self, body: Body) -> None:
        """Sample when due; ``reading_m`` is what the driver then reports."""
        if body.time_s < self._next_s:
            return
        self._next_s = body.time_s + 0.02
        if self.fault is RangeFault.FROZEN:
            return
        if len(self._late) == 2:
            true = self._late[0]
            lost = self._rng.random() < 0.01 or self.fault is RangeFault.LOST
            if lost or not RANGE_MIN_M <= true <= RANGE_MAX_M:
                self.reading_m = OUT_OF_RANGE_M
            else:
                self.reading_m = round(max(RANGE_MIN_M, true + self._rng.gauss(0.0, 0.008)), 2)
        self._late.append(true_range(body, self.sensor.position_m, self.direction))


def ring_beams(sensor: Rangefinder, seed: str) -> list[RangeSensor]:
    """A ring of lidars: the first looks ahead, the others follow to the right."""
    angles = [k * (2.0 * math.pi / sensor.ring) for k in range(sensor.ring)]
    return [
        RangeSensor(sensor, f"{seed} {k}", (math.cos(a), math.sin(a), 0.0))
        for k, a in enumerate(angles)
    ]


def true_range(body: Body, position: Vec, direction: Vec) -> float:
    """Distance [m] along a body-fixed beam to the ground or the wall, inf where it meets neither."""
    rot = body.rotation()
    (on, oe, od), (dn, de, dd) = turned(rot, position), turned(rot, direction)
    s = body.surroundings
    best = math.inf
    if dd > 1e-6:
        best = max(0.0, -(body.position[2] + od) / dd)
    c = math.cos(s.wall_azimuth_rad)
    sn = math.sin(s.wall_azimuth_rad)
    towards = dn * c + de * sn
    if towards > 1e-6 and math.isfinite(s.wall_m):
        best = min(best, max(0.0, (body.wall_gap_m - on * c - oe * sn) / towards))
    return best


class EscTelemetry:
    """Rotor speeds as ESCs report them: 50 Hz, 20 ms late, in steps of 100 electrical rpm over 7 pole pairs."""

    def __init__(self, body: Body, seed: int) -> None:
        self._rng = random.Random(f"esc {seed}")
        self._next_s = 0.0
        self._late: deque[list[float]] = deque(maxlen=2)
        self.rpm = [0.0] * len(body.rpm)
        self.count = 0
        self.temperature_c = 25.0

    def step(self, body: Body) -> None:
        """Sample when due."""
        if body.time_s < self._next_s:
            return
        self._next_s = body.time_s + 0.02
        self._late.append(list(body.rpm))
        quantum = 100.0 / 7.0
        late = self._late[0]
        self.rpm = [
            round(v * self._rng.gauss(1.0, 0.002) / quantum) * quantum if v > 1.0 else 0.0
            for v in late
        ]
        self.count += 1
        self.temperature_c += (
            ((25.0 + 0.8 * body.pack.current_a) - self.temperature_c) * 0.02 / 40.0
        )
