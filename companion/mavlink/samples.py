"""What messages become: frozen samples in SI, world NED, body FRD, quaternions w first.

``t_s`` is seconds on the vehicle's boot axis (boot_clock.py). Where a field may be NaN ("unknown") its docstring says
so; every other number is finite.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from models.vehicle import Vector3

Quaternion = tuple[float, float, float, float]


class RangeVerdict(Enum):
    """What one range reading is worth."""

    OK = "ok"
    BELOW_MIN = "below min"
    ABOVE_MAX = "above max"
    LOW_QUALITY = "low quality"
    UNMAPPED = "unmapped"


@dataclass(frozen=True, slots=True)
class Sample:
    """What every message has: boot time [s], and who sent it."""

    t_s: float
    system: int
    component: int
    late_s: float = field(default=0.0, kw_only=True)
    """How much later it arrived than the quickest message so far, by its own stamp (BootClock.late)."""


@dataclass(frozen=True, slots=True)
class Heartbeat(Sample):
    """HEARTBEAT. ``autopilot`` 8 is none (a ground station); ``custom_mode`` is the firmware's own number."""

    armed: bool
    custom_mode: int
    autopilot: int
    vehicle_type: int


@dataclass(frozen=True, slots=True)
class Attitude(Sample):
    """ATTITUDE or ATTITUDE_QUATERNION: unit quaternion FRD -> NED and body rates [rad/s]."""

    q_ned_frd: Quaternion
    rates_frd: Vector3
    source: str


@dataclass(frozen=True, slots=True)
class LocalPosition(Sample):
    """LOCAL_POSITION_NED [m, m/s]."""

    position_ned: Vector3
    velocity_ned: Vector3


@dataclass(frozen=True, slots=True)
class Imu(Sample):
    """Specific force [m/s^2] (at rest about (0, 0, -9.81)) and rotation rate [rad/s]. NaN in an axis not measured."""

    specific_force_frd: Vector3
    gyro_frd: Vector3
    source: str
    """Message name, with the sensor's id where it is not 0: ``HIGHRES_IMU``, ``RAW_IMU:1``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range(Sample):
    """One reading of a rangefinder along its own beam (slant, not height)."""

    direction_frd: Vector3 | None
    """Unit vector of the beam; None where the orientation cannot be resolved. It is never assumed."""
    orientation: int
    sensor_id: int
    distance_m: float
    min_m: float
    max_m: float
    """NaN where the sensor gives no limits (RANGEFINDER, or both 0)."""
    sigma_m: float | None
    quality: int | None
    """1 (worst) to 100, or None where not given."""
    verdict: RangeVerdict
    source: str


@dataclass(frozen=True, slots=True)
class Ring(Sample):
    """OBSTACLE_DISTANCE: slant ranges around the vehicle, inf where nothing is in range, NaN where unknown."""

    bearings_rad: tuple[float, ...]
    """Middle of each direction, positive to the right, from the nose (of a ring that tilts with the vehicle) or,
    ``northward``, from north (of one that stays level)."""
    distances_m: tuple[float, ...]
    northward: bool


@dataclass(frozen=True, slots=True)
class EscTemperatures(Sample):
    """ESC_INFO: temperatures of up to four ESCs [deg C]; NaN where unknown."""

    temperature_c: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class RotorSpeeds(Sample):
    """Rotor speeds [rpm] of the ESCs ``first_esc + i`` (from 1); negative in reverse, NaN where absurd or unknown.

    A place of a message of four whose ESC does not exist reads 0, as does an ESC whose telemetry dropped out.
    """

    first_esc: int
    rpm: tuple[float, ...]
    source: str
    count: tuple[int, ...] | None = None
    """Telemetry packets so far, by ESC (ESC_TELEMETRY): unchanged means a repeated old value."""
    temperature_c: tuple[float, ...] = ()
    """Of the ESCs, where the same message carries them (ESC_TELEMETRY); NaN where unknown."""


@dataclass(frozen=True, slots=True)
class Battery(Sample):
    """Pack voltage [V] and current [A], positive in discharge; either may be NaN, never both."""

    voltage_v: float
    current_a: float
    source: str


@dataclass(frozen=True, slots=True)
class Pressure(Sample):
    """Absolute pressure [Pa] and the sensor's temperature [deg C] (NaN where not given)."""

    pressure_pa: float
    temperature_c: float
    source: str


@dataclass(frozen=True, slots=True)
class ServoOutput(Sample):
    """Servo outputs [us] of channels ``16 port + 1 ...``, 16 of them; 0 is no pulse, NaN is not sent."""

    pwm_us: tuple[float, ...]
    port: int


@dataclass(frozen=True, slots=True)
class AttitudeTarget(Sample):
    """ATTITUDE_TARGET: what the autopilot's attitude controller follows. ``q_ned_frd`` may be NaN."""

    q_ned_frd: Quaternion
    thrust: float


@dataclass(frozen=True, slots=True)
class SetAttitudeTarget(Sample):
    """SET_ATTITUDE_TARGET, from an upstream controller or from us. What ``type_mask`` ignores may be NaN."""

    type_mask: int
    q_ned_frd: Quaternion
    rates_frd: Vector3
    thrust: float
    target_system: int
    target_component: int


@dataclass(frozen=True, slots=True)
class SetPositionTarget(Sample):
    """SET_POSITION_TARGET_LOCAL_NED in the axes of ``frame``. What ``type_mask`` ignores may be NaN."""

    type_mask: int
    frame: int
    position: Vector3
    velocity: Vector3
    acceleration: Vector3
    yaw: float
    target_system: int
    target_component: int


@dataclass(frozen=True, slots=True)
class Parameter(Sample):
    """PARAM_VALUE."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class LandedState(Sample):
    """EXTENDED_SYS_STATE: MAV_LANDED_STATE (0 unknown, 1 on ground, 2 in air, 3 take-off, 4 landing)."""

    landed_state: int


@dataclass(frozen=True, slots=True)
class EstimatorStatus(Sample):
    """EKF_STATUS_REPORT or ESTIMATOR_STATUS: what the autopilot's own estimator believes of its answer."""

    flags: int
    """EKF_STATUS_FLAGS or ESTIMATOR_STATUS_FLAGS; the first eight bits mean the same in both."""
    horizontal_accuracy_m: float
    """One standard deviation; NaN where not sent (ArduPilot)."""
    innovation: float
    """Largest of the test ratios of horizontal position and velocity: above 1 measurements are rejected. May be NaN."""
    source: str
