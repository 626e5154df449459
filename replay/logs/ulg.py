"""A PX4 log (.ulg) as a FlightLog, through pyulog. Times: microseconds since boot, of the sample where it is given."""

from __future__ import annotations

import contextlib
import io
import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.range_beams import beam_direction
from companion.mavlink.sample_builders import obstacle_distance
from companion.mavlink.samples import Ring
from models.errors import LogError
from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, LogSummary, Series
from replay.logs.columns import Messages, believable, imu_record, mounting, range_beam, runs, time_span, unflipped
from replay.logs.files import read_file
from replay.logs.ulg_repair import repaired

_HEAD = b"ULog\x01\x12\x35"
_PX4 = 12
"""MAV_AUTOPILOT_PX4."""
_MAIN_MODE = {0: 1, 1: 2, 2: 3, 10: 5, 14: 6, 15: 7}
"""nav_state to the main mode in HEARTBEAT.custom_mode; what is not here is AUTO (4)."""
_AUTO, _MAIN_MODE_BITS = 4, 16
_ARMED, _GROUND, _AIR = 2, 1, 2
"""arming_state; MAV_LANDED_STATE_ON_GROUND and _IN_AIR."""
_OUTPUTS, _ESCS = 16, 8
"""Fields of actuator_outputs and esc_status."""
_MOTOR_1, _MOTORS = 101, range(101, 113)
"""Output functions of motors (PWM_MAIN_FUNCn, esc_status.actuator_function)."""
_DSHOT, _DSHOT_FULL, _CAN_FULL, _LONGEST_US = range(-5, -1), 1999.0, 8191.0, 2500.0
"""PWM_MAIN_TIMn of DShot 150 to 1200; full throttle of DShot and of CAN; no pulse is longer [us]."""
_DOWN, _DOWNWARD = (0.0, 0.0, 1.0), 25
_DIRECTIONS, _UNKNOWN_CM, _CENTI, _BODY_FRD = 72, 65535, 0.01, 12
"""Of obstacle_distance: fields, what stands for not known, cm, and MAV_FRAME_BODY_FRD, its frame by default."""
_ROUNDS, _SPARE = 16, 1 << 28
"""A sound log is read twice at most, a damaged one again from every byte of the damage [bytes]."""
_TOPICS = [
    "vehicle_attitude", "vehicle_angular_velocity", "sensor_combined", "vehicle_local_position", "distance_sensor",
    "esc_status", "actuator_outputs", "battery_status", "vehicle_air_data", "vehicle_status", "vehicle_land_detected",
    "vehicle_attitude_setpoint", "wind", "wind_estimate", "obstacle_distance", "obstacle_distance_fused",
]  # fmt: skip


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """The boots in the file, more than one where logs were joined. ``target_system`` is for links."""
    data = read_file(path, _HEAD[:4], "PX4 log")
    begins = [0, *(match.start() for match in re.finditer(re.escape(_HEAD), data) if match.start())]
    logs: list[FlightLog] = []
    problems: list[LogError] = []
    for start, end in itertools.pairwise([*begins, len(data)]):
        try:
            logs.append(replace(_boot(path, data[start:end], len(data)), boot=len(logs)))
        except LogError as error:
            problems.append(error)
    if not logs:
        raise problems[0]
    return logs


class _Bounded(io.BytesIO):
    """A log of which so much may be read; then EOFError. A damaged length leads pyulog back and forth for ever."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self._left = _ROUNDS * len(data) + _SPARE

    def read(self, size: int | None = -1, /) -> bytes:
        """The next bytes, counted."""
        data = super().read(size)
        self._left -= len(data)
        if self._left < 0:
            raise EOFError("a damaged length leads in circles")
        return data


def _boot(path: Path, data: bytes, size: int) -> FlightLog:
    try:
        from pyulog import ULog
    except ImportError:
        raise LogError(f"{path}: .ulg needs the package pyulog: pip install pyulog") from None
    sound = repaired(data)
    log: Any = None
    problem: Exception | None = None
    # What still misleads pyulog lies behind the first damage.
    for part in dict.fromkeys((sound.data, data[: sound.first_damage])):
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                log = ULog(_Bounded(part), _TOPICS)
            break
        except Exception as error:  # pyulog raises whatever a damaged file makes of it
            problem = error
    if log is None:
        raise LogError(f"{path}: cannot be read as a PX4 log ({problem})")
    try:
        return _Reader(path, log, size, sound.notes).flightlog()
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise LogError(f"{path}: its topics make no sense ({type(error).__name__}: {error}); damaged?") from None


def _topic(name: str, data: dict[str, NDArray[Any]]) -> Messages:
    stamp = data.get("timestamp_sample", data["timestamp"])
    # Some topics leave timestamp_sample at 0.
    return Messages(name, believable(np.where(stamp > 0, stamp, data["timestamp"]).astype(float) / 1e6), data)


def _last(topic: Messages, field: str, missing: int) -> int:
    """The last value of a whole-number field; ``missing`` where there is none."""
    return int(np.nan_to_num(topic.column(field)[-1], nan=missing)) if len(topic) else missing


class _Reader:
    """Builds one FlightLog."""

    def __init__(self, path: Path, log: Any, size: int, notes: tuple[str, ...]) -> None:
        self._path, self._log, self._size = path, log, size
        self._topics: dict[str, list[Messages]] = {}
        for item in sorted(log.data_list, key=lambda d: d.multi_id):
            if len(item.data.get("timestamp", ())):
                self._topics.setdefault(item.name, []).append(_topic(item.name, item.data))
        self._notes = list(notes)
        if log.file_corruption:
            self._notes.append("the file is damaged in places; what could be read was")
        if log.dropouts:
            lost = sum(d.duration for d in log.dropouts) / 1000.0
            self._notes.append(f"{len(log.dropouts)} dropouts of the logger, {lost:.1f} s in all")

    def _first(self, name: str) -> Messages:
        """The first instance of a topic; an empty one where the log has none."""
        return next(iter(self._topics.get(name, [])), Messages(name, np.empty(0), {}))

    def _series(self, name: str, *fields: str) -> Series | None:
        topic = self._first(name)
        return topic.series(topic.columns(*fields))

    def flightlog(self) -> FlightLog:
        """All columns."""
        names = ("vehicle_attitude", "sensor_combined")
        stamps = [t.t_s for n in names for t in self._topics.get(n, [])]
        start, end = time_span(self._path, stamps, " or ".join(names))
        status, attitude = self._first("vehicle_status"), self._first("vehicle_attitude")
        setpoint, landed = self._first("vehicle_attitude_setpoint"), self._first("vehicle_land_detected")
        armed = status.column("arming_state") == _ARMED
        states = np.nan_to_num(status.column("nav_state")).astype(int).tolist()
        modes = [_MAIN_MODE.get(state, _AUTO) << _MAIN_MODE_BITS for state in states]
        frames = sum(len(topic) for topics in self._topics.values() for topic in topics)
        servos = self._servos()
        position, velocity = self._position()
        return FlightLog(
            path=self._path,
            system=_last(status, "system_id", 1),
            boot=0,
            start_s=start,
            end_s=end,
            vehicle_type=_last(status, "system_type", 0) if len(status) else None,
            autopilot=_PX4,
            attitude=attitude.series(unflipped(attitude.array("q", 4))),
            rates=self._series("vehicle_angular_velocity", "xyz[0]", "xyz[1]", "xyz[2]"),
            position=position,
            velocity=velocity,
            imus=self._imus(),
            beams=self._beams(),
            rings=tuple(self._rings()),
            escs=self._escs(),
            servo=next(iter(servos.values()), None),
            servo_ports=servos,
            battery=self._battery(),
            pressure=self._series("vehicle_air_data", "baro_pressure_pa", "baro_temp_celcius"),
            thrust_command=setpoint.series(-setpoint.columns("thrust_body[2]")),
            attitude_target=setpoint.series(unflipped(setpoint.array("q_d", 4))),
            wind=self._wind(),
            armed=tuple(i for i in runs(status.t_s, armed.astype(int), end) if i.value),
            modes=runs(status.t_s, np.array(modes), end),
            landed=runs(landed.t_s, np.where(landed.column("landed") > 0.0, _GROUND, _AIR), end),
            parameters={k: float(v) for k, v in self._log.initial_parameters.items() if isinstance(v, int | float)},
            texts=tuple(
                (m.timestamp / 1e6, max(min(int(m.log_level) - ord("0"), 7), 0), str(m.message))
                for m in self._log.logged_messages
            ),
            summary=LogSummary(self._size, frames, tuple(self._notes)),
        )

    def _servos(self) -> dict[int, Series]:
        """Outputs [us] by instance, those that are used first: an instance that is all zeros drives nothing."""
        topics = self._topics.get("actuator_outputs", [])
        ports = enumerate(topic.series(self._in_us(topic.array("output", _OUTPUTS))) for topic in topics)
        found = [(port, series) for port, series in ports if series is not None]
        return dict(sorted(found, key=lambda item: not np.nan_to_num(item[1].values).any()))

    def _in_us(self, output: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outputs (n, 16) as pulses of 1000 to 2000 us; DShot gives its motors 0 to 1999, CAN 0 to 8191."""
        parameters = self._log.initial_parameters
        dshot = parameters.get("DSHOT_CONFIG", 0) > 0 or any(
            parameters.get(f"PWM_{side}_TIM{k}", 0) in _DSHOT for side in ("MAIN", "AUX") for k in range(_OUTPUTS)
        )
        most = float(np.nan_to_num(output).max(initial=0.0))
        full = _CAN_FULL if most > _LONGEST_US else _DSHOT_FULL if dshot else None
        if full is None:
            return output
        functions = np.array([parameters.get(f"PWM_MAIN_FUNC{k + 1}", 0) for k in range(output.shape[1])])
        motor = (
            np.isin(functions, _MOTORS) if full == _DSHOT_FULL and functions.any() else np.ones(len(functions), bool)
        )
        return np.where(motor & (output > 0.0), 1000.0 + 1000.0 * output / full, output)

    def _position(self) -> tuple[Series | None, Series | None]:
        topic = self._first("vehicle_local_position")
        placed = topic.columns("xy_valid", "xy_valid", "z_valid") > 0.0
        moving = topic.columns("v_xy_valid", "v_xy_valid", "v_z_valid") > 0.0
        position = np.where(placed, topic.columns("x", "y", "z"), np.nan)
        velocity = np.where(moving, topic.columns("vx", "vy", "vz"), np.nan)
        return topic.series(position), topic.series(velocity)

    def _imus(self) -> tuple[ImuRecord, ...]:
        topic = self._first("sensor_combined")
        force, gyro = topic.series(topic.array("accelerometer_m_s2", 3)), topic.series(topic.array("gyro_rad", 3))
        flagged = int((np.nan_to_num(topic.columns("accelerometer_clipping")) > 0.0).sum())
        record = imu_record(topic.name, force, gyro, flagged)
        return () if record is None else (record,)

    def _beams(self) -> tuple[Beam, ...]:
        out = []
        for number, topic in enumerate(self._topics.get("distance_sensor", [])):
            orientation = _last(topic, "orientation", -1)
            direction = beam_direction(orientation, mounting(topic.array("q", 4)))
            series = topic.series(topic.columns("current_distance", "signal_quality"))
            if direction is None or series is None:
                self._notes.append(f"distance_sensor {number}: orientation {orientation} cannot be resolved; ignored")
                continue
            low, high = (float(v) for v in np.median(topic.columns("min_distance", "max_distance"), axis=0))
            quality = series.values[:, 1]
            # uORB says -1 for "not known" and 0 for "no signal"; on MAVLink these are 0 and 1.
            wire = np.nan_to_num(np.where(quality < 0.0, 0.0, np.maximum(quality, 1.0)))
            variance = topic.columns("variance")[:, 0]
            sigma = math.sqrt(float(np.median(variance))) if (variance > 0.0).all() else math.nan
            distance = Series(series.t_s, series.values[:, :1], topic.name)
            out.append(range_beam(direction, (1, number, orientation), distance, (low, high), wire, sigma))
        return tuple(out) or self._terrain()

    def _rings(self) -> Iterator[Ring]:
        """obstacle_distance as sensors send it, else what PX4 made of all of them; its fields are those of MAVLink."""
        topic = self._first("obstacle_distance" if "obstacle_distance" in self._topics else "obstacle_distance_fused")
        if not len(topic):
            return
        distances = topic.array("distances", _DIRECTIONS)
        distances = np.where(distances >= _UNKNOWN_CM, np.nan, distances * _CENTI)
        limits, steps = _CENTI * topic.columns("min_distance", "max_distance"), topic.columns("increment")
        offset, frame = topic.columns("angle_offset"), np.nan_to_num(topic.column("frame"), nan=_BODY_FRD)
        for k in np.flatnonzero(np.isfinite(topic.t_s)).tolist():
            low, high = limits[k].tolist()
            step, start = math.radians(steps[k, 0]), math.radians(offset[k, 0])
            head = (float(topic.t_s[k]), 1, 1)
            ring = obstacle_distance(
                head, topic.name, tuple(distances[k].tolist()), (low, high), (0.0, step), start, int(frame[k])
            )
            if ring is not None:
                yield ring

    def _terrain(self) -> tuple[Beam, ...]:
        """Without a rangefinder's own readings: the estimator's height over ground, where it calls it valid."""
        topic = self._first("vehicle_local_position")
        height = topic.columns("dist_bottom")
        height[~(topic.columns("dist_bottom_valid")[:, 0] > 0.0)] = np.nan
        series = topic.series(height)
        if series is None:
            return ()
        self._notes.append(
            "no distance_sensor: height over ground from the estimator (dist_bottom), vertical, not slant"
        )
        return (range_beam(_DOWN, (1, 0, _DOWNWARD), replace(series, source="dist_bottom"), step_m=0.0),)

    def _escs(self) -> dict[int, EscRecord]:
        topic = self._first("esc_status")
        out = {}
        for i in range(_ESCS):
            rpm = topic.columns(f"esc[{i}].esc_rpm")
            if not np.nan_to_num(rpm).any():
                continue
            function = _last(topic, f"esc[{i}].actuator_function", 0)
            motor = function - _MOTOR_1 + 1 if function in _MOTORS else i + 1
            out[motor] = EscRecord(topic.series(rpm), topic.series(topic.columns(f"esc[{i}].esc_temperature")))
        return dict(sorted(out.items()))

    def _battery(self) -> Series | None:
        topic = self._first("battery_status")
        values = topic.columns("voltage_v", "current_a")
        values[~(values[:, 0] > 0.0), 0] = np.nan
        values[values[:, 1] == -1.0, 1] = np.nan
        return topic.series(values)

    def _wind(self) -> Series | None:
        topic = self._first("wind") if "wind" in self._topics else self._first("wind_estimate")
        horizontal = topic.columns("windspeed_north", "windspeed_east")
        return topic.series(np.hstack([horizontal, np.full((len(horizontal), 1), np.nan)]))
