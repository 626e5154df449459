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
from replay.spill import AT_ONCE, blocks, release, spilled

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
_DEBUG = 7
"""The least severity."""
_CLOCK = SourceChoice(quantity="clock", chosen="timestamps since boot", why="the only one")
_SPANNING = ("vehicle_attitude", "sensor_combined")
"""Topics that begin and end with the flight."""
_OUTPUTS = 16
_ESCS = 8
"""Fields of actuator_outputs and esc_status."""
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
    heads = []
    for rows in blocks(len(data), AT_ONCE):
        # A head may lie across the end of a block.
        window = data[rows.start : rows.stop + len(_HEAD) - 1]
        heads += [rows.start + match.start() for match in re.finditer(re.escape(_HEAD), window)]
    begins = [0, *(start for start in heads if start)]
    logs: list[FlightLog] = []
    problems: list[LogError] = []
    for start, end in itertools.pairwise([*begins, len(data)]):
        own = data if len(begins) == 1 else data[start:end]
        try:
            log = _boot(path, own, len(data))
            logs.append(replace(log, boot=len(logs)))
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
        self._release_at = self._left - AT_ONCE

    def read(self, size: int) -> bytes:
        """The next bytes, counted."""
        data = self._data[self._at : self._at + size]
        self._at += len(data)
        self._left -= len(data)
        if self._left < 0:
            raise EOFError("a damaged length leads in circles")
        if self._left < self._release_at:
            self._release_at = self._left - AT_ONCE
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
    sent = data["timestamp"]
    taken = data.get("timestamp_sample", sent)
    # Some topics leave timestamp_sample at 0.
    stamp_us = np.where(taken > 0, taken, sent).astype(float)
    return Messages(name, believable(stamp_us / 1e6), data)


def _last(topic: Messages, field: str, missing: int = 0) -> int:
    """The last value of a whole-number field; ``missing`` where there is none."""
    if not len(topic):
        return missing
    return int(topic.whole(field, missing)[-1])


_VTOL = 22
_MAV_TYPE_OF_KIND = {2: 1, 3: 10, 4: 7}
"""MAV_TYPE of ``vehicle_status.vehicle_type``: aeroplane, rover, airship; 1 is any multirotor."""


def _mav_type(status: Messages) -> int | None:
    """MAV_TYPE by ``system_type``, else as far as ``is_vtol`` and ``vehicle_type`` say it; None where nothing does."""
    if not len(status):
        return None
    by_kind = _MAV_TYPE_OF_KIND.get(_last(status, "vehicle_type"), 0)
    if _last(status, "is_vtol"):
        by_kind = _VTOL
    return _last(status, "system_type") or by_kind


def _text(message: Any) -> tuple[float, int, str]:
    """Time [s], MAV_SEVERITY and text of a message of the logger."""
    severity = int(message.log_level) - ord("0")
    return message.timestamp / 1e6, min(max(severity, 0), _DEBUG), str(message.message)


class _Reader:
    """Builds one FlightLog."""

    def __init__(self, path: Path, log: Any, size: int, notes: tuple[str, ...]) -> None:
        self._path = path
        self._log = log
        self._size = size
        self._topics: dict[str, list[tuple[int, Messages]]] = {}
        for item in sorted(log.data_list, key=lambda item: item.multi_id):
            if len(item.data.get("timestamp", ())):
                topic = _topic(item.name, item.data)
                item.data = {}
                instances = self._topics.setdefault(item.name, [])
                instances.append((int(item.multi_id), topic))
        self._notes = list(notes)
        if log.file_corruption:
            self._notes.append("the file is damaged in places; what could be read was")
        if log.dropouts:
            lost_s = sum(dropout.duration for dropout in log.dropouts) / 1000.0
            self._notes.append(f"{len(log.dropouts)} dropouts of the logger, {lost_s:.1f} s in all")

    def _instances(self, name: str) -> list[tuple[int, Messages]]:
        """Every instance of a topic, by its number in the log."""
        return self._topics.get(name, [])

    def _first(self, name: str) -> Messages:
        """The first instance of a topic; an empty one where the log has none."""
        for _, topic in self._instances(name):
            return topic
        return Messages(name, np.empty(0), {})

    def _first_of(self, name: str, other: str) -> Messages:
        """The first instance of a topic, or of another one where the log has none."""
        return self._first(name if name in self._topics else other)

    def _series(self, name: str, *fields: str) -> Series | None:
        topic = self._first(name)
        return topic.series(topic.columns(*fields))

    def flightlog(self) -> FlightLog:
        """All columns."""
        stamps = []
        for name in _SPANNING:
            for _, topic in self._instances(name):
                stamps.append(topic.t_s)
        start, end = time_span(self._path, stamps, " or ".join(_SPANNING))
        status = self._first("vehicle_status")
        attitude = self._first("vehicle_attitude")
        setpoint = self._first("vehicle_attitude_setpoint")
        gps = self._first("vehicle_gps_position")
        landed = self._first("vehicle_land_detected")
        states = status.whole("nav_state").tolist()
        modes = [_MAIN_MODE.get(state, _AUTO) << _MAIN_MODE_BITS for state in states]
        on_ground = landed.column("landed") > 0.0
        position, velocity = self._position()
        arming = runs(status.t_s, status.column("arming_state") == _ARMED, end)
        armed = tuple(interval for interval in arming if interval.value)
        parameters, changes = in_force(self._parameters(), take_off(armed))
        self._notes += change_notes(changes)
        frames = 0
        for instances in self._topics.values():
            frames += sum(len(topic) for _, topic in instances)
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
            armed=armed,
            modes=runs(status.t_s, np.array(modes), end),
            landed=runs(landed.t_s, np.where(on_ground, _GROUND, _AIR), end),
            parameters=parameters,
            parameter_changes=changes,
            sources=(_CLOCK,),
            texts=tuple(map(_text, self._log.logged_messages)),
            summary=LogSummary(self._size, frames, tuple(self._notes)),
        )

    def _parameters(self) -> list[Row]:
        """Those at the start of the log, then those that were set later."""
        rows = [(-math.inf, name, value) for name, value in self._log.initial_parameters.items()]
        for t_us, name, value in self._log.changed_parameters:
            rows.append((t_us / 1e6, name, value))
        return [(t_s, name, float(v)) for t_s, name, v in rows if isinstance(v, int | float)]

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
        pulses = np.zeros((len(topic), _OUTPUTS))
        pulses[:, :_MOTOR_COUNT] = 1000.0 + 1000.0 * thrust_to_output(thrust, factor)
        pulses[~np.isfinite(pulses)] = 0.0
        return topic.series(pulses)

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
        source = force.source if force else ""
        record = imu_record(source, force, gyro, flagged)
        return (record,) if record else ()

    def _beams(self) -> tuple[Beam, ...]:
        out = []
        for number, (_, topic) in enumerate(self._instances("distance_sensor")):
            orientation = _last(topic, "orientation", -1)
            direction = beam_direction(orientation, mounting(topic.array("q", 4)))
            series = topic.series(topic.columns("current_distance", "signal_quality"))
            if direction is None or series is None:
                self._notes.append(
                    f"distance_sensor {number}: orientation {orientation} cannot be resolved; "
                    "ignored"
                )
                continue
            limits = topic.columns("min_distance", "max_distance")
            low, high = np.median(limits, axis=0).tolist()
            # uORB says -1 for "not known" and 0 for "no signal"; on MAVLink these are 0 and 1.
            quality = series.values[:, 1]
            on_mavlink = np.where(quality < 0.0, 0.0, np.maximum(quality, 1.0))
            sigma_m = math.nan
            variance = topic.column("variance")
            if (variance > 0.0).all():
                sigma_m = math.sqrt(float(np.median(variance)))
            beam = range_beam(
                direction=direction,
                sensor=(1, number, orientation),
                readings=Series(series.t_s, series.values[:, :1], topic.name),
                limits=(low, high),
                quality=np.nan_to_num(on_mavlink),
                sigma_m=sigma_m,
            )
            out.append(beam)
        return tuple(out) or self._terrain()

    def _rings(self) -> Iterator[Ring]:
        """obstacle_distance as sensors send it, else what PX4 made of all of them; its fields are those of MAVLink."""
        topic = self._first_of("obstacle_distance", "obstacle_distance_fused")
        distances_cm = topic.array("distances", _DIRECTIONS)
        distances_m = np.where(distances_cm >= _UNKNOWN_CM, np.nan, distances_cm * _CENTI)
        limits_m = _CENTI * topic.columns("min_distance", "max_distance")
        step_deg = topic.column("increment")
        offset_deg = topic.column("angle_offset")
        frame = topic.whole("frame", _BODY_FRD)
        for k in np.flatnonzero(np.isfinite(topic.t_s)).tolist():
            ring = obstacle_distance(
                head=(float(topic.t_s[k]), 1, 1),
                _=topic.name,
                distances=tuple(distances_m[k].tolist()),
                limits=tuple(limits_m[k].tolist()),
                steps=(0.0, math.radians(step_deg[k])),
                offset=math.radians(offset_deg[k]),
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
            sensors = topic.whole("dist_bottom_sensor_bitfield")
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
        readings = replace(series, source="dist_bottom")
        return (range_beam(_DOWN, (1, 0, _DOWNWARD), readings, step_m=0.0),)

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
            rpm = topic.column(f"esc[{i}].esc_rpm")
            if not np.nan_to_num(rpm).any():
                continue
            temperature = topic.column(f"esc[{i}].esc_temperature")
            function = _last(topic, f"esc[{i}].actuator_function")
            motor = _MOTORS.index(function) if function in _MOTORS else i
            out[motor + 1] = EscRecord(topic.series(rpm), topic.series(temperature))
        return dict(sorted(out.items()))

    def _batteries(self) -> dict[str, Series]:
        """battery_status by instance; one that calls itself not connected is left out."""
        out = {}
        for instance, topic in self._instances("battery_status"):
            connected = topic.column("connected")
            if np.nanmax(connected, initial=-1.0) == 0.0:
                continue
            values = topic.columns("voltage_v", "current_a")
            voltage, current = values.T
            voltage[~(voltage > 0.0)] = np.nan
            current[current == -1.0] = np.nan
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
        topic = self._first_of("wind", "wind_estimate")
        # PX4 estimates no vertical wind: unknown.
        return topic.series(topic.columns("windspeed_north", "windspeed_east", "windspeed_down"))
