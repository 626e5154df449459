"""A recorded flight as named columns: SI, world NED, body FRD, one boot axis; every quantity with its own stamps.

``replay.load(path)`` reads any format of ``logs/formats.py`` and gives one ``FlightLog`` per boot of the vehicle. What
the log does not hold is None or empty; what was dropped or repaired is in ``summary``. How to use it: docs/logs.md.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict, Ring
from models.air_state import DIRECTIONS
from models.common.errors import ConfigError
from models.common.frames import Array
from replay.spill import picked, release

_AXES = dict(zip(DIRECTIONS, (25, 24, 0, 2, 4, 6), strict=True))
"""MAV_SENSOR_ORIENTATION of each body axis."""
OTHER = "other"
"""Name of a direction that is none of them."""
_SAME_DIRECTION = math.cos(math.radians(20.0))
"""A beam belongs to the body axis within 20 degrees of it: mounts are seldom truer, neighbouring orientations are 45
degrees apart."""

_STRETCH_S = 2100.0
_ONE_STRETCH_BYTES = 32 * 2**20
"""A stretch is no longer than 35 minutes; a log of so many bytes is one."""


@dataclass(frozen=True)
class Series:
    """One quantity: ``values`` (n, k) at boot times ``t_s`` (n,), strictly increasing. NaN is unknown."""

    t_s: Array
    values: Array
    source: str = ""
    """Message (and field, where it matters) that it was read from."""

    def __len__(self) -> int:
        return len(self.t_s)

    def __repr__(self) -> str:
        rows, columns = self.values.shape
        return f"Series({self.source!r}, {rows} x {columns}, {self.rate_hz:.3g} Hz)"

    @property
    def rate_hz(self) -> float:
        """One over the median step; NaN below two samples."""
        if len(self) > 1:
            return float(1.0 / np.median(np.diff(self.t_s)))
        return math.nan

    def at(self, t_s: Array, max_gap_s: float = math.inf, *, hold: bool = False) -> Array:
        """Values (m, k) at other times: linear, or the previous sample where ``hold``.

        NaN outside the record, next to a NaN, and inside gaps longer than ``max_gap_s``.
        """
        out = np.full((len(t_s), self.values.shape[1]), np.nan)
        if not len(self):
            return out
        right = np.clip(np.searchsorted(self.t_s, t_s, side="right"), 1, max(len(self) - 1, 1))
        left = right - 1
        right = np.minimum(right, len(self) - 1)
        if hold:
            latest = np.searchsorted(self.t_s, t_s, side="right") - 1
            good = (latest >= 0) & (t_s - self.t_s[np.maximum(latest, 0)] <= max_gap_s)
            out[good] = self.values[latest[good]]
            return out
        width = self.t_s[right] - self.t_s[left]
        share = np.where(
            width > 0.0, (t_s - self.t_s[left]) / np.where(width > 0.0, width, 1.0), 0.0
        )
        good = (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1]) & (width <= max_gap_s)
        blend = self.values[left] + share[:, None] * (self.values[right] - self.values[left])
        out[good] = blend[good]
        return out

    def rows(self, chosen: NDArray[np.bool_]) -> Series:
        """The samples (n,) that are chosen."""
        return Series(picked(self.t_s, chosen), picked(self.values, chosen), self.source)

    def between(self, start_s: float, end_s: float) -> Series:
        """The part with start <= t < end."""
        i, j = np.searchsorted(self.t_s, (start_s, end_s))
        return Series(self.t_s[i:j], self.values[i:j], self.source)


@dataclass(frozen=True, kw_only=True)
class ImuRecord:
    """One accelerometer and gyro: specific force [m/s^2] (n, 3) and rates [rad/s] (n, 3), body FRD, at the sensor."""

    source: str
    specific_force: Series
    gyro: Series
    force_step: float
    """Smallest step of the specific force [m/s^2], 1 mg in RAW_IMU and SCALED_IMU; 0 where none can be seen."""
    clipped: int
    """Samples that the autopilot counted as clipped (VIBRATION), or that stand at the record's extreme three times or
    more above 3 g. Above 0 the mean of the specific force is not to be trusted."""
    instance: int = 0
    """The autopilot's number of it, from 0."""
    healthy: bool | None = None
    """What the autopilot says of it; None where it says nothing."""


@dataclass(frozen=True)
class Beam:
    """One rangefinder: slant distance [m] along ``direction_frd``, with a verdict for every sample."""

    direction_frd: tuple[float, float, float]
    component: int
    sensor_id: int
    orientation: int
    source: str
    distance: Series
    """(n, 1). All readings, good or not."""
    verdicts: tuple[RangeVerdict, ...]
    """One per reading."""
    min_m: float
    max_m: float
    sigma_m: float
    """Median of what the sensor says of itself; NaN where it gives none."""
    step_m: float
    """Smallest step of the readings, 0 where none can be seen."""

    @property
    def name(self) -> str:
        """``down up forward right back left``, or ``other``."""
        return direction_name(self.direction_frd)

    def judged(self, *verdicts: RangeVerdict) -> NDArray[np.bool_]:
        """Which readings (n,) have one of these verdicts."""
        return np.array([v in verdicts for v in self.verdicts], bool)

    @property
    def good(self) -> Series:
        """The readings with verdict OK."""
        return self.distance.rows(self.judged(RangeVerdict.OK))

    @property
    def share_good(self) -> float:
        """Share of the readings with verdict OK."""
        return len(self.good) / max(len(self.distance), 1)


@dataclass(frozen=True)
class EscRecord:
    """One ESC, counted from 1: speed [rpm], and where telemetered temperature [deg C]."""

    rpm: Series | None
    temperature_c: Series | None = None


@dataclass(frozen=True, kw_only=True)
class MotorLoss:
    """Thrust that a motor loses in flight, from a moment on."""

    motors: tuple[int, ...]
    """By number; several where one of them fails."""
    share: float
    """Of its thrust."""
    interval: tuple[float, float]
    """Of the share, 95 %."""
    probability: float
    explains: float = 0.0
    """Share of the residual after the beginning that the loss removes; 0 where the rotor's speed tells the loss."""


@dataclass(frozen=True)
class LogFault:
    """A channel that is not to be believed, and why."""

    channel: str
    what: str
    since_s: float | None = None
    """When it begins [s, boot axis], where it does in flight."""
    loss: MotorLoss | None = None
    """Where a motor fails."""

    @property
    def motors(self) -> tuple[int, ...]:
        """Motors that fail, by number; several where one of them does."""
        if self.loss is None:
            return ()
        return self.loss.motors

    def as_json(self) -> dict[str, Any]:
        """The keys of ``log_faults``: what a fault does not have is left out."""
        out: dict[str, Any] = {"channel": self.channel, "what": self.what}
        if self.since_s is not None:
            out["since_s"] = self.since_s
        if self.motors:
            out["motors"] = list(self.motors)
        return out


@dataclass(frozen=True)
class Lane:
    """One lane (core) of the autopilot's estimator; columns as in ``FlightLog``."""

    position: Series | None
    velocity: Series | None
    attitude: Series | None = None


@dataclass(frozen=True)
class MotorOutputs:
    """Where the outputs of the motors are."""

    port: int = 0
    """SERVO_OUTPUT_RAW.port of ``FlightLog.servo``."""
    group: str = ""
    """``MAIN``, ``AUX``, ``CAN`` ... of PX4; empty elsewhere."""
    numbers: Mapping[int, int] = field(default_factory=dict)
    """Motor number to output, both from 1; empty where no parameter says it."""


@dataclass(frozen=True)
class Stated:
    """The instance that the autopilot says it uses, and the message or parameter that says so."""

    name: str
    by: str


@dataclass(frozen=True, kw_only=True)
class SourceChoice:
    """Which of several instances a quantity was read from, and why."""

    quantity: str
    """``battery imu outputs position pressure clock frame``, or what else was chosen."""
    chosen: str
    """Name of the instance, such as ``BATTERY_STATUS id 1``."""
    others: tuple[str, ...] = ()
    """Names of the instances that were left aside."""
    why: str


@dataclass(frozen=True)
class Interval:
    """start <= t < end [s, boot axis], and what held then (a mode number, a landed state)."""

    start_s: float
    end_s: float
    value: int = 1


@dataclass(frozen=True)
class ParameterChange:
    """A parameter that was set in flight."""

    t_s: float
    name: str
    before: float
    after: float


@dataclass(frozen=True)
class LogSummary:
    """What a file held, for people."""

    bytes: int
    frames: int
    """Messages of the boot, of every kind and sender."""
    notes: tuple[str, ...]
    """What was dropped, repaired or chosen, one sentence each."""


def _cut(column: Any, start_s: float, end_s: float) -> Any:
    """What of a column lies at start <= t < end, as views; None where nothing does. What has no time stays whole."""
    match column:
        case Series():
            return column.between(start_s, end_s) or None
        case Interval():
            part = Interval(max(column.start_s, start_s), min(column.end_s, end_s), column.value)
            if part.start_s < part.end_s:
                return part
            return None
        case Ring(t_s=t_s) | (float(t_s), int(), str()):
            if start_s <= t_s < end_s:
                return column
            return None
        case ImuRecord():
            force = _cut(column.specific_force, start_s, end_s)
            gyro = _cut(column.gyro, start_s, end_s)
            if force and gyro:
                return replace(column, specific_force=force, gyro=gyro)
            return None
        case Beam():
            i, j = column.distance.t_s.searchsorted((start_s, end_s)).tolist()
            distance = column.distance.between(start_s, end_s)
            if distance:
                return replace(column, distance=distance, verdicts=column.verdicts[i:j])
            return None
        case Lane():
            position = _cut(column.position, start_s, end_s)
            velocity = _cut(column.velocity, start_s, end_s)
            attitude = _cut(column.attitude, start_s, end_s)
            return Lane(position, velocity, attitude)
        case EscRecord():
            return EscRecord(
                _cut(column.rpm, start_s, end_s), _cut(column.temperature_c, start_s, end_s)
            )
        case tuple():
            return tuple(
                part for item in column if (part := _cut(item, start_s, end_s)) is not None
            )
        case Mapping():
            return {
                key: part
                for key, item in column.items()
                if (part := _cut(item, start_s, end_s)) is not None
            }
    return column


@dataclass(frozen=True, kw_only=True)
class FlightLog:
    """One boot of one vehicle: named columns, SI, world NED, body FRD. What a log does not hold is None or empty.

    Examples
    --------
    >>> import replay
    >>> (flight,) = replay.load("flight.tlog")
    >>> flight.missing("attitude", "gps_fix")
    ['gps_fix']
    >>> part = flight.between(flight.start_s + 5.0, flight.start_s + 15.0)
    >>> round(part.duration_s)
    10
    """

    path: Path
    """Of the log."""
    system: int
    """MAVLink system."""
    boot: int
    """0 for the first boot in the file."""
    start_s: float
    """Boot time of the first message [s]."""
    end_s: float
    """Boot time of the last message [s]."""
    vehicle_type: int | None = None
    """MAV_TYPE; None where no heartbeat was recorded."""
    autopilot: int | None = None
    """MAV_AUTOPILOT: 3 ArduPilot, 12 PX4, 0 generic; None where no heartbeat was recorded."""

    attitude: Series | None = None
    """(n, 4) unit quaternions FRD -> NED, w first, without sign flips: ATTITUDE_QUATERNION or ATTITUDE, the faster."""
    rates: Series | None = None
    """(n, 3) rad/s, body FRD, from the same message (the autopilot's estimate; raw gyros are in ``imus``)."""
    position: Series | None = None
    """(n, 3) m NED."""
    velocity: Series | None = None
    """(n, 3) m/s NED."""
    imus: tuple[ImuRecord, ...] = ()
    """The chosen one first, then float before quantised, fast before slow."""
    beams: tuple[Beam, ...] = ()
    """Rangefinders."""
    rings: tuple[Ring, ...] = ()
    """In order of time."""
    escs: Mapping[int, EscRecord] = field(default_factory=dict)
    """By ESC number, from 1; ESCs that never turned nor counted are left out."""
    servo: Series | None = None
    """(n, 16) outputs of the port that drives the motors, as sent: pulses in us, DShot of PX4 0 to 1999, CAN 0 to 8191;
    0 is no pulse."""
    servo_ports: Mapping[int, Series] = field(default_factory=dict)
    """The same by port: PX4 sends its AUX outputs, ArduPilot outputs 17-32, as port 1."""
    motor_commands: Series | None = None
    """(n, 16) thrust that PX4 asks of each motor (actuator_motors), as pulses of 1000 to 2000 us by motor number."""
    motor_outputs: MotorOutputs = field(default_factory=MotorOutputs)
    """Which outputs drive the motors."""
    battery: Series | None = None
    """(n, 2) V, A of the battery that feeds the motors; NaN where not measured."""
    batteries: Mapping[str, Series] = field(default_factory=dict)
    """Every battery, by name."""
    pressure: Series | None = None
    """(n, 2) Pa, deg C of the chosen barometer."""
    pressures: Mapping[str, Series] = field(default_factory=dict)
    """Every barometer, by name."""
    lanes: Mapping[str, Lane] = field(default_factory=dict)
    """Every lane of the estimator, by name, where a log holds them apart."""
    stated: Mapping[str, Stated] = field(default_factory=dict)
    """What the log says of the instances in use, by quantity."""
    thrust_command: Series | None = None
    """(n, 1) thrust of ATTITUDE_TARGET, 0...1 (as its firmware means it), before angle boost on ArduPilot."""
    attitude_target: Series | None = None
    """(n, 4) quaternion of ATTITUDE_TARGET."""
    commands: Series | None = None
    """(n, 5) quaternion and thrust of SET_ATTITUDE_TARGET sent to the vehicle, by any sender."""
    wind: Series | None = None
    """(n, 3) m/s NED, where the air moves to; the autopilot's estimate."""
    vibration: Series | None = None
    """(n, 3) m/s^2, as the autopilot measures it."""
    gps_fix: Series | None = None
    """(n, 1) GPS_FIX_TYPE of the first receiver: 0 none, 1 no fix, 2 without height, 3 and above a place in space."""

    armed: tuple[Interval, ...] = ()
    """While the motors were armed."""
    modes: tuple[Interval, ...] = ()
    """Value: custom_mode."""
    landed: tuple[Interval, ...] = ()
    """Value: MAV_LANDED_STATE; empty where the autopilot does not report it."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """As they were at take-off."""
    parameter_changes: tuple[ParameterChange, ...] = ()
    """What was set after that, in order of time."""
    parameters_expected: int = 0
    """How many the autopilot says it has; 0 where it does not say."""
    texts: tuple[tuple[float, int, str], ...] = ()
    """STATUSTEXT: time [s], severity, text."""
    sources: tuple[SourceChoice, ...] = ()
    """Which instance each quantity was read from."""
    summary: LogSummary = field(repr=False, default=LogSummary(0, 0, ()))
    """What the file held, and what was dropped or repaired."""

    def __repr__(self) -> str:
        held = [f.name for f in fields(self) if isinstance(getattr(self, f.name), Series)]
        return f"FlightLog({self.path.name!r}, {self.duration_s:.1f} s, with {', '.join(held)})"

    @property
    def duration_s(self) -> float:
        """Length of the boot in the log [s]."""
        return self.end_s - self.start_s

    def between(self, start_s: float, end_s: float) -> FlightLog:
        """A part of the flight.

        Parameters
        ----------
        start_s, end_s : float
            start <= t < end, boot time [s].

        Returns
        -------
        FlightLog
            Views. What has no sample in it is None or left out.
        """
        columns = {f.name: _cut(getattr(self, f.name), start_s, end_s) for f in fields(self)}
        columns |= {"start_s": max(self.start_s, start_s), "end_s": min(self.end_s, end_s)}
        return FlightLog(**columns)

    def stretches(self) -> Iterator[FlightLog]:
        """The log in parts of equal length, for work whose memory grows with the time.

        Yields
        ------
        FlightLog
            A small log is one part.
        """
        if self.summary.bytes <= _ONE_STRETCH_BYTES:
            count = 1
        else:
            count = math.ceil(self.duration_s / _STRETCH_S)
        if count <= 1:
            yield self
            return
        cuts = np.linspace(self.start_s, self.end_s, count + 1)[1:-1].tolist()
        for start_s, end_s in itertools.pairwise([-math.inf, *cuts, math.inf]):
            yield self.between(start_s, end_s)
            release()

    def beam(self, direction: str) -> Beam | None:
        """The best rangefinder in one direction.

        DISTANCE_SENSOR before RANGEFINDER, unless both tell the same distance and RANGEFINDER is finer and no slower;
        among equals the one with more good readings.

        Parameters
        ----------
        direction : str
            ``down``, ``up``, ``forward``, ``right``, ``back`` or ``left``, of the body.

        Returns
        -------
        Beam or None
            None where none looks there.

        Raises
        ------
        ConfigError
            There is no such direction.
        """
        if direction not in (*_AXES, OTHER):
            raise ConfigError(f"{direction}: is no direction; give one of {', '.join(_AXES)}")
        beams = [b for b in self.beams if b.name == direction]
        own = sorted((b for b in beams if b.source != "RANGEFINDER"), key=lambda b: -len(b.good))
        old = next((b for b in beams if b.source == "RANGEFINDER"), None)
        if not own:
            return old
        best = own[0]
        if old is None or not len(best.good) or not len(old.good):
            return best
        finer = old.step_m < best.step_m and not old.good.rate_hz < best.good.rate_hz
        difference = np.abs(old.good.at(best.good.t_s) - best.good.values)
        if np.isfinite(difference).any():
            same = bool(np.nanmedian(difference) <= best.step_m)
        else:
            same = False
        if finer and same:
            return old
        return best

    def missing(self, *names: str) -> list[str]:
        """Which columns this log does not hold.

        Parameters
        ----------
        *names : str
            ``"attitude"``, ``"imus"`` ...

        Returns
        -------
        list of str
            Those that are missing.
        """
        return [name for name in names if not getattr(self, name)]


def direction_name(direction: tuple[float, float, float]) -> str:
    """Name of the axis within 20 degrees of a beam, or ``other``."""
    for name, orientation in _AXES.items():
        axis = orientation_direction(orientation)
        assert axis is not None
        if float(np.dot(axis, direction)) >= _SAME_DIRECTION:
            return name
    return OTHER
