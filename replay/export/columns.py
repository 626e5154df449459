"""A flight log as one table: every stamp is a row, every quantity a column with its unit in the name and beside it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.air_state import DIRECTIONS
from models.frames import Array
from replay.flightlog import FlightLog, Interval, Series
from replay.logs.pieces import Piece


@dataclass(frozen=True)
class Column:
    """One column: values (n,) at boot times ``t_s`` (n,)."""

    name: str
    unit: str
    description: str
    t_s: Array
    values: Array


@dataclass(frozen=True)
class Table:
    """``columns`` on the union of their stamps ``t_s`` (n,), strictly increasing; NaN where a column has no sample."""

    boot: int
    t_s: Array
    columns: tuple[Column, ...]

    def values(self, column: Column, start: int, end: int) -> Array:
        """Rows ``start`` to ``end`` of one column, NaN where it has no sample."""
        out = np.full(end - start, np.nan)
        if end > start:
            i, j = np.searchsorted(column.t_s, (self.t_s[start], self.t_s[end - 1]), side="left")
            j = min(j + 1, len(column.t_s))
            at = np.searchsorted(self.t_s[start:end], column.t_s[i:j])
            inside = at < end - start
            out[at[inside]] = column.values[i:j][inside]
        return out


def table(piece: Piece, rate_hz: float | None = None) -> Table:
    """Everything a boot, or a piece of it, holds. With ``rate_hz`` on an even clock that begins with the boot: linear
    in between (states: the previous one).
    """
    log = piece.log
    columns = tuple(_columns(log))
    if rate_hz is not None:
        origin = log.start_s if math.isnan(piece.origin_s) else piece.origin_s
        first = math.ceil(max((piece.start_s - origin) * rate_hz, 0.0))
        beyond = int((log.end_s - origin) * rate_hz) + 1
        if piece.end_s < math.inf:
            beyond = min(beyond, math.ceil((piece.end_s - origin) * rate_hz))
        t = origin + np.arange(first, beyond) / rate_hz
        even = []
        for c in columns:
            held = c.name in _STATES
            values = Series(c.t_s, c.values[:, None]).at(t, np.inf if held else _GAP_S, hold=held)[:, 0]
            even.append(Column(c.name, c.unit, c.description, t, values))
        return Table(log.boot, t, tuple(even))
    columns = tuple(own for c in columns if len((own := _within(c, piece.start_s, piece.end_s)).t_s))
    stamps = [c.t_s for c in columns]
    return Table(log.boot, np.unique(np.concatenate(stamps)) if stamps else np.empty(0), columns)


def _within(column: Column, start_s: float, end_s: float) -> Column:
    i, j = np.searchsorted(column.t_s, (start_s, end_s))
    return replace(column, t_s=column.t_s[i:j], values=column.values[i:j])


_GAP_S = 0.5
"""No value is interpolated over a longer gap: a vehicle moves 0.5 m in it at 1 m/s."""
_STATES = ("armed", "mode", "landed_state")
_NED = ("north", "east", "down")


def _columns(log: FlightLog) -> Iterator[Column]:
    frd = "body FRD"
    yield from _spread(log.attitude, [f"attitude_q{c}" for c in "wxyz"], "1", "unit quaternion, body FRD to world NED")
    yield from _spread(log.rates, ["p_rad_s", "q_rad_s", "r_rad_s"], "rad/s", f"angular rate, {frd}, as estimated")
    yield from _spread(log.position, ["north_m", "east_m", "down_m"], "m", "local position NED")
    yield from _spread(log.velocity, ["vn_m_s", "ve_m_s", "vd_m_s"], "m/s", "local velocity NED")
    for k, imu in enumerate(log.imus, 1):
        tail = "" if k == 1 else f"_imu{k}"
        text = f"{frd}, {imu.source}"
        yield from _spread(imu.specific_force, [f"a{c}{tail}_m_s2" for c in "xyz"], "m/s^2", f"specific force, {text}")
        yield from _spread(imu.gyro, [f"gyro_{c}{tail}_rad_s" for c in "xyz"], "rad/s", f"angular rate, {text}")
    yield from _ranges(log)
    for n, esc in sorted(log.escs.items()):
        yield from _spread(esc.rpm, [f"rpm_{n}"], "1/min", f"speed of ESC {n}")
        yield from _spread(esc.temperature_c, [f"esc_temperature_{n}_c"], "degC", f"temperature of ESC {n}")
        yield from _spread(esc.voltage_v, [f"esc_voltage_{n}_v"], "V", f"voltage of ESC {n}")
        yield from _spread(esc.current_a, [f"esc_current_{n}_a"], "A", f"current of ESC {n}")
    for port, servo in sorted((log.servo_ports or ({0: log.servo} if log.servo is not None else {})).items()):
        names = [f"servo_{16 * port + k + 1}" for k in range(servo.values.shape[1])]
        yield from _spread(servo, names, "us", "pulse width of an output")
    yield from _spread(log.battery, ["battery_voltage_v"], "V", "battery 0")
    yield from _spread(log.battery, ["battery_current_a"], "A", "battery 0", first=1)
    yield from _spread(log.pressure, ["pressure_pa"], "Pa", "static pressure")
    yield from _spread(log.pressure, ["air_temperature_c"], "degC", "temperature of the barometer", first=1)
    yield from _spread(log.thrust_command, ["thrust_command"], "1", "thrust that the autopilot commands, 0 to 1")
    yield from _spread(log.attitude_target, [f"attitude_target_q{c}" for c in "wxyz"], "1", "attitude target")
    yield from _spread(
        log.commands, [*(f"set_attitude_q{c}" for c in "wxyz"), "set_thrust"], "1", "SET_ATTITUDE_TARGET as sent"
    )
    yield from _spread(log.wind, [f"wind_{c}_m_s" for c in _NED], "m/s", "where the air moves to, NED, as estimated")
    yield from _spread(log.vibration, [f"vibration_{c}_m_s2" for c in "xyz"], "m/s^2", "vibration level")
    yield from _state("armed", log.armed, "1 while armed", ends=True)
    yield from _state("mode", log.modes, "custom_mode of HEARTBEAT")
    yield from _state("landed_state", log.landed, "MAV_LANDED_STATE")


def _ranges(log: FlightLog) -> Iterator[Column]:
    """The best beam of each direction by its fixed name, good readings only; every other beam after it, numbered."""
    for direction in (*DIRECTIONS, "other"):
        beams = [b for b in log.beams if b.name == direction]
        best = log.beam(direction)
        beams.sort(key=lambda b: b is not best)
        for k, beam in enumerate(beams, 1):
            name = f"range_{direction}{'' if k == 1 else f'_{k}'}_m"
            text = f"slant distance along {tuple(round(c, 3) for c in beam.direction_frd)} body FRD, {beam.source}"
            yield from _spread(beam.good, [name], "m", text)


def _spread(series: Series | None, names: list[str], unit: str, description: str, first: int = 0) -> Iterator[Column]:
    if series is None or not len(series):
        return
    for k, name in enumerate(names, first):
        known: NDArray[np.bool_] = np.isfinite(series.values[:, k])
        if known.any():
            yield Column(name, unit, description, series.t_s[known], series.values[known, k])


def _state(name: str, intervals: tuple[Interval, ...], description: str, *, ends: bool = False) -> Iterator[Column]:
    if not intervals:
        return
    at = {i.start_s: float(i.value) for i in intervals}
    if ends:
        at |= {i.end_s: 0.0 for i in intervals if i.end_s not in at}
    times = sorted(at)
    yield Column(name, "1", description, np.array(times), np.array([at[t] for t in times]))
