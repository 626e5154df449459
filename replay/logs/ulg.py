"""A PX4 log (.ulg) as a FlightLog, through pyulog. Times: microseconds since boot, of the sample where it is given."""

from __future__ import annotations

import contextlib
import io
import itertools
import math
import os
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
from companion.mavlink.wire_frames import Content
from models.common.errors import LogError
from models.common.frames import Array, Mask
from models.vehicle.estimate import thrust_to_output
from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, LogSummary, Series, SourceChoice
from replay.logs.columns import (
    Messages,
    believable,
    imu_record,
    mounting,
    range_beam,
    runs,
    time_span,
    unflipped,
)
from replay.logs.files import read_file
from replay.logs.parameters import Row, change_notes, in_force, take_off
from replay.logs.ulg_repair import repaired
from replay.spill import release, spilled

_HEAD = b"ULog\x01\x12\x35"
_PX4 = 12
"""MAV_AUTOPILOT_PX4."""
_MAIN_MODE = {0: 1, 1: 2, 2: 3, 10: 5, 14: 6, 15: 7}
"""nav_state to the main mode in HEARTBEAT.custom_mode; what is not here is AUTO (4)."""
_AUTO = 4
_MAIN_MODE_BITS = 16
_ARMED = 2
_GROUND = 1
_AIR = 2
"""arming_state; MAV_LANDED_STATE_ON_GROUND and _IN_AIR."""
_OUTPUTS = 16
_ESCS = 8
"""Fields of actuator_outputs and esc_status."""
_MOTOR_1 = 101
_MOTORS = range(101, 113)
"""Output functions of motors (PWM_MAIN_FUNCn, esc_status.actuator_function)."""
_MOTOR_COUNT = 12
"""Fields of actuator_motors."""
_DOWN = (0.0, 0.0, 1.0)
_DOWNWARD = 25
_BY_RANGE = 1
"""Bit of dist_bottom_sensor_bitfield: a range sensor. The other one is optical flow."""
_DIRECTIONS = 72
_UNKNOWN_CM = 65535
_CENTI = 0.01
_BODY_FRD = 12
"""Of obstacle_distance: fields, what stands for not known, cm, and MAV_FRAME_BODY_FRD, its frame by default."""
_ROUNDS = 16
_SPARE = 1 << 28
"""A sound log is read twice at most, a damaged one again from every byte of the damage [bytes]."""
_AT_ONCE = 16 * 2**20
"""Bytes that are read before their memory is given back."""
_TOPICS = [
    "vehicle_attitude",
    "vehicle_angular_velocity",
    "sensor_combined",
    "vehicle_local_position",
    "distance_sensor",
    "esc_status",
    "actuator_outputs",
    "battery_status",
    "vehicle_air_data",
    "vehicle_status",
    "vehicle_land_detected",
    "vehicle_attitude_setpoint",
    "wind",
    "wind_estimate",
    "obstacle_distance",
    "obstacle_distance_fused",
    "actuator_motors",
    "sensor_baro",
    "vehicle_acceleration",
    "vehicle_gps_position",
]


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """The boots in the file, more than one where logs were joined. ``target_system`` is for links."""
    data = read_file(path, _HEAD[:4], "PX4 log")
    begins = [0, *(match.start() for match in re.finditer(re.escape(_HEAD), data) if match.start())]
    logs: list[FlightLog] = []
    problems: list[LogError] = []
    for start, end in itertools.pairwise([*begins, len(data)]):
        own = data if len(begins) == 1 else data[start:end]
        try:
            logs.append(replace(_boot(path, own, len(data)), boot=len(logs)))
        except LogError as error:
            problems.append(error)
    if not logs:
        raise problems[0]
    return logs


class _Bounded:
    """A log of which so much may be read; then EOFError. A damaged length leads pyulog back and forth for ever."""

    def __init__(self, data: Content) -> None:
        self._data = data
        self._at = 0
        self._left = _ROUNDS * len(data) + _SPARE
        self._release_at = self._left - _AT_ONCE

    def read(self, size: int) -> bytes:
        """The next bytes, counted."""
        data = self._data[self._at : self._at + size]
        self._at += len(data)
        self._left -= len(data)
        if self._left < 0:
            raise EOFError("a damaged length leads in circles")
        if self._left < self._release_at:
            self._release_at = self._left - _AT_ONCE
            release()
        return data

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place, as of a file."""
        since = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: len(self._data)}
        self._at = max(since[whence] + offset, 0)
        return self._at

    def tell(self) -> int:
        """The place where ``read`` goes on."""
        return self._at

    def close(self) -> None:
        """Nothing is open."""


def _boot(path: Path, data: Content, size: int) -> FlightLog:
    try:
        from pyulog import ULog
    except ImportError:
        raise LogError(f"{path}: .ulg needs the package pyulog: pip install pyulog") from None
    sound = repaired(data)
    log: Any = None
    problem: Exception | None = None
    parts = [sound.data]
    if sound.first_damage < len(data):
        # What still misleads pyulog lies behind the first damage.
        parts.append(data[: sound.first_damage])
    for part in parts:
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
        raise LogError(
            f"{path}: its topics make no sense ({type(error).__name__}: {error}); damaged?"
        ) from None


def _topic(name: str, data: dict[str, NDArray[Any]]) -> Messages:
    # Copies: the fields of pyulog are views of all bytes of the topic.
    data = {field: spilled(np.ascontiguousarray(values)) for field, values in data.items()}
    stamp = data.get("timestamp_sample", data["timestamp"])
    # Some topics leave timestamp_sample at 0.
    return Messages(
        name, believable(np.where(stamp > 0, stamp, data["timestamp"]).astype(float) / 1e6), data
    )


def _last(topic: Messages, field: str, missing: int) -> int:
    """The last value of a whole-number field; ``missing`` where there is none."""
    if len(topic):
        return int(np.nan_to_num(topic.column(field)[-1], nan=missing))
    return missing


_VTOL = 22
_MAV_TYPE_OF_KIND = {2: 1, 3: 10, 4: 7}
"""MAV_TYPE of ``vehicle_status.vehicle_type``: aeroplane, rover, airship; 1 is any multirotor."""


def _mav_type(status: Messages) -> int | None:
    """MAV_TYPE by ``system_type``, else as far as ``is_vtol`` and ``vehicle_type`` say it; None where nothing does."""
    if not len(status):
        return None
    if _last(status, "is_vtol", 0):
        return _last(status, "system_type", 0) or _VTOL
    kind = _MAV_TYPE_OF_KIND.get(_last(status, "vehicle_type", 0), 0)
    return _last(status, "system_type", 0) or kind


class _Reader:
    """Builds one FlightLog."""

    def __init__(self, path: Path, log: Any, size: int, notes: tuple[str, ...]) -> None:
        self._path = path
        self._log = log
        self._size = size
        self._topics: dict[str, list[Messages]] = {}
        self._numbered: dict[str, list[tuple[int, Messages]]] = {}
        for item in sorted(log.data_list, key=lambda d: d.multi_id):
            if len(item.data.get("timestamp", ())):
                topic = _topic(item.name, item.data)
                item.data = {}
                self._topics.setdefault(item.name, []).append(topic)
                self._numbered.setdefault(item.name, []).append((int(item.multi_id), topic))
        self._notes = list(notes)
        if log.file_corruption:
            self._notes.append("the file is damaged in places; what could be read was")
        if log.dropouts:
            lost = sum(d.duration for d in log.dropouts) / 1000.0
            self._notes.append(f"{len(log.dropouts)} dropouts of the logger, {lost:.1f} s in all")

    def _first(self, name: str) -> Messages:
        """The first instance of a topic; an empty one where the log has none."""
        return next(iter(self._topics.get(name, [])), Messages(name, np.empty(0), {}))

    def _instances(self, name: str) -> Iterator[tuple[int, Messages]]:
        """Every instance of a topic, by its number in the log."""
        yield from self._numbered.get(name, [])

    def _series(self, name: str, *fields: str) -> Series | None:
        topic = self._first(name)
        return topic.series(topic.columns(*fields))

    def flightlog(self) -> FlightLog:
        """All columns."""
        names = ("vehicle_attitude", "sensor_combined")
        stamps = []
        for n in names:
            for t in self._topics.get(n, []):
                stamps.append(t.t_s)
        start, end = time_span(self._path, stamps, " or ".join(names))
        status = self._first("vehicle_status")
        attitude = self._first("vehicle_attitude")
        setpoint = self._first("vehicle_attitude_setpoint")
        gps = self._first("vehicle_gps_position")
        landed = self._first("vehicle_land_detected")
        armed = status.column("arming_state") == _ARMED
        states = np.nan_to_num(status.column("nav_state")).astype(int).tolist()
        modes = [_MAIN_MODE.get(state, _AUTO) << _MAIN_MODE_BITS for state in states]
        frames = sum(len(topic) for topics in self._topics.values() for topic in topics)
        position, velocity = self._position()
        on = tuple(i for i in runs(status.t_s, armed.astype(int), end) if i.value)
        parameters, changes = in_force(self._parameters(), take_off(on))
        self._notes += change_notes(changes)
        return FlightLog(
            path=self._path,
            system=_last(status, "system_id", 1),
            boot=0,
            start_s=start,
            end_s=end,
            vehicle_type=_mav_type(status),
            autopilot=_PX4,
            attitude=attitude.series(unflipped(attitude.array("q", 4))),
            rates=self._series("vehicle_angular_velocity", "xyz[0]", "xyz[1]", "xyz[2]"),
            position=position,
            velocity=velocity,
            imus=self._imus(),
            beams=self._beams(),
            rings=tuple(self._rings()),
            escs=self._escs(),
            servo_ports=self._servos(),
            motor_commands=self._motor_commands(),
            batteries=self._batteries(),
            pressures=self._pressures(),
            thrust_command=setpoint.series(-setpoint.columns("thrust_body[2]")),
            attitude_target=setpoint.series(unflipped(setpoint.array("q_d", 4))),
            wind=self._wind(),
            gps_fix=gps.series(gps.column("fix_type")),
            armed=on,
            modes=runs(status.t_s, np.array(modes), end),
            landed=runs(landed.t_s, np.where(landed.column("landed") > 0.0, _GROUND, _AIR), end),
            parameters=parameters,
            parameter_changes=changes,
            sources=(
                SourceChoice(quantity="clock", chosen="timestamps since boot", why="the only one"),
            ),
            texts=tuple(
                (m.timestamp / 1e6, max(min(int(m.log_level) - ord("0"), 7), 0), str(m.message))
                for m in self._log.logged_messages
            ),
            summary=LogSummary(self._size, frames, tuple(self._notes)),
        )

    def _parameters(self) -> list[Row]:
        """Those at the start of the log, then those that were set later."""
        initial = [(-math.inf, name, value) for name, value in self._log.initial_parameters.items()]
        changes = [(t_us / 1e6, name, value) for t_us, name, value in self._log.changed_parameters]
        return [
            (t_s, name, float(v))
            for t_s, name, v in [*initial, *changes]
            if isinstance(v, int | float)
        ]

    def _servos(self) -> dict[int, Series]:
        """Outputs by instance of the topic, as the drivers take them. An instance that is all zeros drives nothing."""
        out = {}
        for instance, topic in self._instances("actuator_outputs"):
            series = topic.series(topic.array("output", _OUTPUTS))
            if series is not None and np.nan_to_num(series.values).any():
                out[instance] = series
        return out

    def _motor_commands(self) -> Series | None:
        """actuator_motors: thrust asked of each motor, 0...1, as the pulses that THR_MDL_FAC makes of it."""
        topic = self._first("actuator_motors")
        thrust = np.clip(topic.array("control", _MOTOR_COUNT), 0.0, 1.0)
        factor = float(self._log.initial_parameters.get("THR_MDL_FAC", 0.0))
        output = thrust_to_output(thrust, factor)
        pulses = np.where(np.isfinite(output), 1000.0 + 1000.0 * output, 0.0)
        padded = np.zeros((len(topic), _OUTPUTS))
        padded[:, :_MOTOR_COUNT] = pulses
        if len(topic):
            return topic.series(padded)
        return None

    def _position(self) -> tuple[Series | None, Series | None]:
        topic = self._first("vehicle_local_position")
        placed = topic.columns("xy_valid", "xy_valid", "z_valid") > 0.0
        moving = topic.columns("v_xy_valid", "v_xy_valid", "v_z_valid") > 0.0
        position = np.where(placed, topic.columns("x", "y", "z"), np.nan)
        velocity = np.where(moving, topic.columns("vx", "vy", "vz"), np.nan)
        return topic.series(position), topic.series(velocity)

    def _imus(self) -> tuple[ImuRecord, ...]:
        """What the autopilot combined of its sensors, else what its controllers were given."""
        topic = self._first("sensor_combined")
        force = topic.series(topic.array("accelerometer_m_s2", 3))
        gyro = topic.series(topic.array("gyro_rad", 3))
        flagged = int((np.nan_to_num(topic.columns("accelerometer_clipping")) > 0.0).sum())
        if force is None:
            force = self._series("vehicle_acceleration", "xyz[0]", "xyz[1]", "xyz[2]")
            gyro = self._series("vehicle_angular_velocity", "xyz[0]", "xyz[1]", "xyz[2]")
        if force is None:
            source = ""
        else:
            source = force.source
        record = imu_record(source, force, gyro, flagged)
        if record is None:
            return ()
        return (record,)

    def _beams(self) -> tuple[Beam, ...]:
        out = []
        for number, topic in enumerate(self._topics.get("distance_sensor", [])):
            orientation = _last(topic, "orientation", -1)
            direction = beam_direction(orientation, mounting(topic.array("q", 4)))
            series = topic.series(topic.columns("current_distance", "signal_quality"))
            if direction is None or series is None:
                self._notes.append(
                    f"distance_sensor {number}: orientation {orientation} cannot be resolved; "
                    "ignored"
                )
                continue
            low, high = (
                float(v) for v in np.median(topic.columns("min_distance", "max_distance"), axis=0)
            )
            quality = series.values[:, 1]
            # uORB says -1 for "not known" and 0 for "no signal"; on MAVLink these are 0 and 1.
            wire = np.nan_to_num(np.where(quality < 0.0, 0.0, np.maximum(quality, 1.0)))
            variance = topic.columns("variance")[:, 0]
            if (variance > 0.0).all():
                sigma = math.sqrt(float(np.median(variance)))
            else:
                sigma = math.nan
            distance = Series(series.t_s, series.values[:, :1], topic.name)
            out.append(
                range_beam(direction, (1, number, orientation), distance, (low, high), wire, sigma)
            )
        return tuple(out) or self._terrain()

    def _rings(self) -> Iterator[Ring]:
        """obstacle_distance as sensors send it, else what PX4 made of all of them; its fields are those of MAVLink."""
        topic = self._first(
            "obstacle_distance"
            if "obstacle_distance" in self._topics
            else "obstacle_distance_fused"
        )
        if not len(topic):
            return
        distances = topic.array("distances", _DIRECTIONS)
        distances = np.where(distances >= _UNKNOWN_CM, np.nan, distances * _CENTI)
        limits = _CENTI * topic.columns("min_distance", "max_distance")
        steps = topic.columns("increment")
        offset = topic.columns("angle_offset")
        frame = np.nan_to_num(topic.column("frame"), nan=_BODY_FRD)
        for k in np.flatnonzero(np.isfinite(topic.t_s)).tolist():
            low, high = limits[k].tolist()
            step = math.radians(steps[k, 0])
            start = math.radians(offset[k, 0])
            head = (float(topic.t_s[k]), 1, 1)
            ring = obstacle_distance(
                head=head,
                _=topic.name,
                distances=tuple(distances[k].tolist()),
                limits=(low, high),
                steps=(0.0, step),
                offset=start,
                frame=int(frame[k]),
            )
            if ring is not None:
                yield ring

    def _terrain(self) -> tuple[Beam, ...]:
        """Without a rangefinder's own readings: the estimator's height over ground, where a rangefinder made it.

        PX4 calls ``dist_bottom`` valid on the ground, too, where no sensor measures it, and by optical flow.
        """
        topic = self._first("vehicle_local_position")
        measured = topic.column("dist_bottom_valid") > 0.0
        if "dist_bottom_sensor_bitfield" in topic:
            sensors = np.nan_to_num(topic.column("dist_bottom_sensor_bitfield")).astype(int)
            measured &= (sensors & _BY_RANGE) > 0
        elif not (measured & ~self._landed_at(topic.t_s)).any():
            measured[:] = False
        height = np.where(measured, topic.column("dist_bottom"), np.nan)
        series = topic.series(height)
        if series is None:
            return ()
        self._notes.append(
            "no distance_sensor: height over ground from the estimator (dist_bottom), vertical, "
            "not slant"
        )
        return (
            range_beam(_DOWN, (1, 0, _DOWNWARD), replace(series, source="dist_bottom"), step_m=0.0),
        )

    def _landed_at(self, t_s: Array) -> Mask:
        """Whether the autopilot says that the vehicle stands, at the times (n,); False where it says nothing."""
        topic = self._first("vehicle_land_detected")
        landed = topic.series(topic.column("landed"))
        if landed is None:
            return np.zeros(len(t_s), bool)
        return np.asarray(landed.at(t_s, hold=True)[:, 0] > 0.0)

    def _escs(self) -> dict[int, EscRecord]:
        topic = self._first("esc_status")
        out = {}
        for i in range(_ESCS):
            rpm = topic.columns(f"esc[{i}].esc_rpm")
            if not np.nan_to_num(rpm).any():
                continue
            function = _last(topic, f"esc[{i}].actuator_function", 0)
            if function in _MOTORS:
                motor = function - _MOTOR_1 + 1
            else:
                motor = i + 1
            out[motor] = EscRecord(
                topic.series(rpm), topic.series(topic.columns(f"esc[{i}].esc_temperature"))
            )
        return dict(sorted(out.items()))

    def _batteries(self) -> dict[str, Series]:
        """battery_status by instance; one that calls itself not connected is left out."""
        out = {}
        for instance, topic in self._instances("battery_status"):
            connected = topic.column("connected")
            if connected.size and np.nanmax(np.append(connected, -1.0)) == 0.0:
                continue
            values = topic.columns("voltage_v", "current_a")
            values[~(values[:, 0] > 0.0), 0] = np.nan
            values[values[:, 1] == -1.0, 1] = np.nan
            series = topic.series(values)
            if series is not None:
                out[f"battery_status {instance}"] = series
        return out

    def _pressures(self) -> dict[str, Series]:
        """What PX4 made of its barometers, else the barometers themselves."""
        series = self._series("vehicle_air_data", "baro_pressure_pa", "baro_temp_celcius")
        if series is not None:
            return {series.source: series}
        out = {}
        for instance, topic in self._instances("sensor_baro"):
            one = topic.series(topic.columns("pressure", "temperature"))
            if one is not None:
                out[f"sensor_baro {instance}"] = one
        return out

    def _wind(self) -> Series | None:
        if "wind" in self._topics:
            topic = self._first("wind")
        else:
            topic = self._first("wind_estimate")
        horizontal = topic.columns("windspeed_north", "windspeed_east")
        return topic.series(np.hstack([horizontal, np.full((len(horizontal), 1), np.nan)]))
