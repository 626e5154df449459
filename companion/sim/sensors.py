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

_PARALLEL = 1e-6
"""A beam whose direction has less than this share towards a surface never meets it."""
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
        tilt_rad = math.radians(0.1)
        # Half the angles of a small rotation of the body: q * (1, ex, ey, ez).
        ex, ey, ez = (0.5 * (tilt_rad * s + b) for s, b in zip(slow, self._tilt_bias, strict=True))
        w, x, y, z = body.quaternion
        qw = w - x * ex - y * ey - z * ez
        qx = x + w * ex - z * ey + y * ez
        qy = y + z * ex + w * ey - x * ez
        qz = z - y * ex + x * ey + w * ez
        size = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        unit = (qw / size, qx / size, qy / size, qz / size)
        roll, pitch, yaw = euler(unit)
        gyro_noise = [gauss(0.0, 0.008) for _ in range(3)]
        accel_noise = [gauss(0.0, 0.15) for _ in range(3)]
        return Estimate(
            quaternion=unit,
            roll=roll,
            pitch=pitch,
            yaw=yaw,
            rates=_sum(body.rates, self._gyro_bias, gyro_noise),
            position=_sum(body.position, self._position_bias, [0.004 * v for v in where]),
            velocity=_sum(body.velocity, [0.01 * v for v in speed]),
            specific_force=_sum(body.specific_force, self._accel_bias, accel_noise),
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
    step_rad = 2.0 * math.pi / sensor.ring
    beams = []
    for k in range(sensor.ring):
        direction = (math.cos(k * step_rad), math.sin(k * step_rad), 0.0)
        beams.append(RangeSensor(sensor, f"{seed} {k}", direction))
    return beams


def true_range(body: Body, position: Vec, direction: Vec) -> float:
    """Distance [m] along a body-fixed beam to the ground or the wall, inf where it meets neither."""
    rot = body.rotation()
    on, oe, od = turned(rot, position)
    dn, de, dd = turned(rot, direction)
    wall = body.surroundings
    nearest = math.inf
    if dd > _PARALLEL:
        height = -(body.position[2] + od)
        nearest = max(0.0, height / dd)
    c = math.cos(wall.wall_azimuth_rad)
    s = math.sin(wall.wall_azimuth_rad)
    towards = dn * c + de * s
    if towards > _PARALLEL and math.isfinite(wall.wall_m):
        gap = body.wall_gap_m - on * c - oe * s
        nearest = min(nearest, max(0.0, gap / towards))
    return nearest


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
        self.rpm = list(map(self._read, self._late[0]))
        self.count += 1
        # It follows the current within 40 s.
        warm_c = 25.0 + 0.8 * body.pack.current_a
        self.temperature_c += (warm_c - self.temperature_c) * 0.02 / 40.0

    def _read(self, speed: float) -> float:
        if speed <= 1.0:
            return 0.0
        quantum = 100.0 / 7.0
        steps = speed * self._rng.gauss(1.0, 0.002) / quantum
        return round(steps) * quantum
