"""A flight log as one table: every stamp is a row, every quantity a column with its unit in the name and beside it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.air_state import DIRECTIONS
from models.common.frames import Array
from replay.flightlog import FlightLog, Interval, Series
from replay.spill import BLOCK, Spool, picked, release


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: values (n,) at boot times ``t_s`` (n,). Columns of one ``topic`` are of one message."""

    name: str
    unit: str
    description: str
    t_s: Array
    values: Array
    topic: str
    words: tuple[str, ...] | None = None
    """A column of text: its values are places in ``words``."""

    def blank(self) -> Column:
        """The same without samples."""
        return replace(self, t_s=np.empty(0), values=np.empty(0))


@dataclass(frozen=True)
class LogTable:
    """``columns`` on the union of their stamps ``t_s`` (n,), strictly increasing; NaN where a column has no sample."""

    boot: int
    t_s: Array
    columns: tuple[Column, ...]

    def values(self, column: Column, start: int, end: int) -> NDArray[Any]:
        """Rows ``start`` to ``end`` of one column, NaN where it has no sample; of text as objects, None where none."""
        out = np.full(end - start, np.nan)
        if end > start:
            i, j = np.searchsorted(column.t_s, (self.t_s[start], self.t_s[end - 1]), side="left")
            j = min(j + 1, len(column.t_s))
            at = np.searchsorted(self.t_s[start:end], column.t_s[i:j])
            inside = at < end - start
            out[at[inside]] = column.values[i:j][inside]
        if column.words is None:
            return out
        return np.array(
            [None if math.isnan(code) else column.words[int(code)] for code in out.tolist()], object
        )


def table(log: FlightLog, decisions: Iterable[Column] = ()) -> LogTable:
    """Everything a boot holds, and what was decided on it."""
    columns = (*recorded(log), *decisions)
    stamps = {id(c.t_s): c.t_s for c in columns}.values()
    return LogTable(log.boot, _union(list(stamps)), columns)


def _union(stamps: Sequence[Array]) -> Array:
    """All of several sorted times, each once; on disk where they are many."""
    most = max(stamps, key=len, default=np.empty(0))
    edges = [-math.inf, *most[BLOCK::BLOCK].tolist(), math.inf]
    found = Spool(np.float64)
    for start_s, end_s in itertools.pairwise(edges):
        parts = [np.empty(0)]
        for t_s in stamps:
            i, j = t_s.searchsorted((start_s, end_s)).tolist()
            parts.append(t_s[i:j])
        found.append(np.unique(np.concatenate(parts)))
        release()
    return found.array()


def recorded(log: FlightLog) -> Iterator[Column]:
    """Every quantity of a log that has samples."""
    frd = "body FRD"
    quaternion = "unit quaternion, body FRD to world NED"
    yield from _spread(
        "attitude", log.attitude, [f"attitude_q{c}" for c in "wxyz"], "1", quaternion
    )
    rates = ["p_rad_s", "q_rad_s", "r_rad_s"]
    yield from _spread("rates", log.rates, rates, "rad/s", f"angular rate, {frd}, as estimated")
    yield from _spread(
        "position", log.position, ["north_m", "east_m", "down_m"], "m", "local position NED"
    )
    yield from _spread(
        "velocity", log.velocity, ["vn_m_s", "ve_m_s", "vd_m_s"], "m/s", "local velocity NED"
    )
    yield from _imus(log)
    yield from _ranges(log)
    for n, esc in sorted(log.escs.items()):
        yield from _spread(f"esc_{n}", esc.rpm, [f"rpm_{n}"], "1/min", f"speed of ESC {n}")
        yield from _spread(
            f"esc_{n}",
            esc.temperature_c,
            [f"esc_temperature_{n}_c"],
            "degC",
            f"temperature of ESC {n}",
        )
    for port, servo in sorted(log.servo_ports.items()):
        names = [f"servo_{16 * port + k + 1}" for k in range(servo.values.shape[1])]
        yield from _spread(f"servo_{port}", servo, names, "us", "pulse width of an output")
    yield from _spread("battery", log.battery, ["battery_voltage_v"], "V", "battery 0")
    yield from _spread("battery", log.battery, ["battery_current_a"], "A", "battery 0", first=1)
    yield from _spread("pressure", log.pressure, ["pressure_pa"], "Pa", "static pressure")
    yield from _spread(
        "pressure",
        log.pressure,
        ["air_temperature_c"],
        "degC",
        "temperature of the barometer",
        first=1,
    )
    thrust = "thrust that the autopilot commands, 0 to 1"
    yield from _spread("thrust_command", log.thrust_command, ["thrust_command"], "1", thrust)
    target = [f"attitude_target_q{c}" for c in "wxyz"]
    sent = [*(f"set_attitude_q{c}" for c in "wxyz"), "set_thrust"]
    yield from _spread("attitude_target", log.attitude_target, target, "1", "attitude target")
    yield from _spread("setpoint", log.commands, sent, "1", "SET_ATTITUDE_TARGET as sent")
    wind = [f"wind_{c}_m_s" for c in ("north", "east", "down")]
    yield from _spread("wind", log.wind, wind, "m/s", "where the air moves to, NED, as estimated")
    vibration = [f"vibration_{c}_m_s2" for c in "xyz"]
    yield from _spread("vibration", log.vibration, vibration, "m/s^2", "vibration level")
    yield from _spread(
        "gps_fix", log.gps_fix, ["gps_fix"], "1", "GPS_FIX_TYPE, 3 and above: a place"
    )
    yield from _state("armed", log.armed, "1 while armed", ends=True)
    yield from _state("mode", log.modes, "custom_mode of HEARTBEAT")
    yield from _state("landed_state", log.landed, "MAV_LANDED_STATE")


def _imus(log: FlightLog) -> Iterator[Column]:
    """Every accelerometer and gyro, the chosen one first; the others are numbered."""
    for k, imu in enumerate(log.imus, 1):
        tail = "" if k == 1 else f"_imu{k}"
        topic = f"imu_{k}"
        of = f"body FRD, {imu.source}"
        force = [f"a{c}{tail}_m_s2" for c in "xyz"]
        gyro = [f"gyro_{c}{tail}_rad_s" for c in "xyz"]
        yield from _spread(topic, imu.specific_force, force, "m/s^2", f"specific force, {of}")
        yield from _spread(topic, imu.gyro, gyro, "rad/s", f"angular rate, {of}")


def _ranges(log: FlightLog) -> Iterator[Column]:
    """The best beam of each direction by its fixed name, good readings only; every other beam after it, numbered."""
    for direction in (*DIRECTIONS, "other"):
        beams = [b for b in log.beams if b.name == direction]
        best = log.beam(direction)
        beams.sort(key=lambda b: b is not best)
        for k, beam in enumerate(beams, 1):
            name = f"range_{direction}{'' if k == 1 else f'_{k}'}_m"
            text = (
                f"slant distance along {tuple(round(c, 3) for c in beam.direction_frd)} body FRD, "
                f"{beam.source}"
            )
            yield from _spread(name.removesuffix("_m"), beam.good, [name], "m", text)


def _spread(
    topic: str, series: Series | None, names: list[str], unit: str, description: str, first: int = 0
) -> Iterator[Column]:
    if series is None or not len(series):
        return
    for k, name in enumerate(names, first):
        known: NDArray[np.bool_] = np.isfinite(series.values[:, k])
        release()
        if known.all():  # no copy: columns of one message share their times
            yield Column(
                name=name,
                unit=unit,
                description=description,
                t_s=series.t_s,
                values=series.values[:, k],
                topic=topic,
            )
        elif known.any():
            yield Column(
                name=name,
                unit=unit,
                description=description,
                t_s=picked(series.t_s, known),
                values=picked(series.values[:, k], known),
                topic=topic,
            )


def _state(
    name: str, intervals: tuple[Interval, ...], description: str, *, ends: bool = False
) -> Iterator[Column]:
    if not intervals:
        return
    at = {i.start_s: float(i.value) for i in intervals}
    if ends:
        at |= {i.end_s: 0.0 for i in intervals if i.end_s not in at}
    times = sorted(at)
    values = np.array([at[t] for t in times])
    yield Column(
        name=name,
        unit="1",
        description=description,
        t_s=np.array(times),
        values=values,
        topic="state",
    )
