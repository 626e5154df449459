"""A FlightLog as the samples that a MAVLink link would have given: how .BIN and .ulg reach the pipeline."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

import numpy as np

from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    Battery,
    Heartbeat,
    Imu,
    LandedState,
    LocalPosition,
    Parameter,
    Range,
    RotorSpeeds,
    Sample,
    ServoOutput,
    SetAttitudeTarget,
)
from companion.mavlink.setpoints import RATES_IGNORED
from replay.flightlog import Beam, FlightLog, ImuRecord, Interval, Series

_COMPONENT = 1
"""Component of an autopilot (MAV_COMP_ID_AUTOPILOT1)."""
_STATION = 255
_STATION_COMPONENT = 190
"""System and component of a ground station (MAV_COMP_ID_MISSIONPLANNER)."""
_HEARTBEAT_S = 1.0
"""Rate of an autopilot's heartbeat."""
_SAME_MESSAGE_S = 0.1
"""Two columns no further apart are taken to come of one message."""


def samples(log: FlightLog) -> Iterator[Sample]:
    """Samples of a boot in order of time. Heartbeats come once a second, parameters at the start."""
    head = (log.system, _COMPONENT)
    for name, value in log.parameters.items():
        yield Parameter(log.start_s, *head, name, value)
    streams: list[Iterator[Sample]] = [
        _heartbeats(log),
        _attitudes(log, head),
        _positions(log, head),
    ]
    streams += [_ranges(beam, head) for beam in log.beams if beam.source != "RANGEFINDER"]
    streams += [iter(log.rings)]
    streams += [_speeds(number, esc.rpm, head) for number, esc in log.escs.items()]
    streams += [_servos(port, series, head) for port, series in log.servo_ports.items()]
    streams += [_batteries(log.battery, head), _targets(log, head), _commands(log)]
    streams += [(LandedState(i.start_s, *head, i.value) for i in log.landed)]
    streams += [_imu(one, head) for one in log.imus[:1]]
    merged = heapq.merge(*streams, key=lambda sample: sample.t_s)
    yield from (sample for sample in merged if log.start_s <= sample.t_s)


Head = tuple[int, int]


def _rows(series: Series | None) -> Iterator[tuple[float, list[float]]]:
    if series is not None:
        yield from zip(series.t_s.tolist(), series.values.tolist(), strict=True)


def _imu(imu: ImuRecord, head: Head) -> Iterator[Sample]:
    """The first accelerometer; its gyro is taken where it was sampled with it."""
    force = imu.specific_force
    if len(imu.gyro):
        gyro = imu.gyro.at(force.t_s)
    else:
        gyro = np.full((len(force), 3), np.nan)
    for (t, (x, y, z)), (p, q, r) in zip(_rows(force), gyro.tolist(), strict=True):
        yield Imu(t, *head, (x, y, z), (p, q, r), imu.source)


def _value(intervals: tuple[Interval, ...], t: float) -> int:
    """What held at a time; 0 where nothing is known."""
    return next((i.value for i in intervals if i.start_s <= t < i.end_s), 0)


def _heartbeats(log: FlightLog) -> Iterator[Sample]:
    if log.autopilot is None:
        return
    for t in np.arange(log.start_s, log.end_s, _HEARTBEAT_S).tolist():
        armed = _value(log.armed, t) != 0
        mode = _value(log.modes, t)
        yield Heartbeat(
            t,
            log.system,
            _COMPONENT,
            armed=armed,
            custom_mode=mode,
            autopilot=log.autopilot,
            vehicle_type=log.vehicle_type or 0,
        )


def _attitudes(log: FlightLog, head: Head) -> Iterator[Sample]:
    if log.attitude is None:
        return
    rates = np.zeros((len(log.attitude), 3))
    if log.rates is not None:
        rates = np.nan_to_num(log.rates.at(log.attitude.t_s))
    for (t, q), (p, r, y) in zip(_rows(log.attitude), rates.tolist(), strict=True):
        if not math.isnan(q[0]):
            yield Attitude(t, *head, (q[0], q[1], q[2], q[3]), (p, r, y), log.attitude.source)


def _positions(log: FlightLog, head: Head) -> Iterator[Sample]:
    if log.position is None or log.velocity is None:
        return
    velocity = log.velocity.at(log.position.t_s, _SAME_MESSAGE_S).tolist()
    for (t, (x, y, z)), (vx, vy, vz) in zip(_rows(log.position), velocity, strict=True):
        if not math.isnan(x + y + z + vx + vy + vz):  # no NaN among them
            yield LocalPosition(t, *head, (x, y, z), (vx, vy, vz))


def _ranges(beam: Beam, head: Head) -> Iterator[Sample]:
    if not math.isnan(beam.sigma_m):
        sigma = beam.sigma_m
    else:
        sigma = None
    for (t, (distance,)), verdict in zip(_rows(beam.distance), beam.verdicts, strict=True):
        yield Range(
            t,
            head[0],
            beam.component,
            direction_frd=beam.direction_frd,
            orientation=beam.orientation,
            sensor_id=beam.sensor_id,
            distance_m=distance,
            min_m=beam.min_m,
            max_m=beam.max_m,
            sigma_m=sigma,
            quality=None,
            verdict=verdict,
            source=beam.source,
        )


def _speeds(number: int, series: Series | None, head: Head) -> Iterator[Sample]:
    for t, (rpm,) in _rows(series):
        yield RotorSpeeds(t, *head, number, (rpm,), series.source if series is not None else "")


def _servos(port: int, series: Series, head: Head) -> Iterator[Sample]:
    for t, pwm in _rows(series):
        yield ServoOutput(t, *head, tuple(pwm), port)


def _batteries(series: Series | None, head: Head) -> Iterator[Sample]:
    for t, (voltage, current) in _rows(series):
        yield Battery(t, *head, voltage, current, series.source if series is not None else "")


def _targets(log: FlightLog, head: Head) -> Iterator[Sample]:
    if log.thrust_command is None or log.attitude_target is None:
        return
    attitude = log.attitude_target.at(log.thrust_command.t_s, _SAME_MESSAGE_S, hold=True).tolist()
    for (t, (thrust,)), q in zip(_rows(log.thrust_command), attitude, strict=True):
        yield AttitudeTarget(t, *head, (q[0], q[1], q[2], q[3]), thrust)


def _commands(log: FlightLog) -> Iterator[Sample]:
    for t, (w, x, y, z, thrust) in _rows(log.commands):
        yield SetAttitudeTarget(
            t_s=t,
            system=_STATION,
            component=_STATION_COMPONENT,
            type_mask=RATES_IGNORED,
            q_ned_frd=(w, x, y, z),
            rates_frd=(np.nan, np.nan, np.nan),
            thrust=thrust,
            target_system=log.system,
            target_component=_COMPONENT,
        )
