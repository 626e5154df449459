"""A .tlog as FlightLogs: one per boot of the chosen vehicle."""

from __future__ import annotations

import itertools
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.message_table import LAYOUTS, columns
from companion.mavlink.range_beams import beam_direction
from companion.mavlink.sample_builders import obstacle_distance
from companion.mavlink.samples import Ring
from companion.mavlink.wire_layout import PER_SI
from models.errors import LogError
from models.frames import Array
from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, Interval, LogSummary, Series
from replay.logs.columns import (
    Messages,
    imu_record,
    message_counts,
    quaternions,
    range_beam,
    runs,
    tidy,
    unflipped,
)
from replay.logs.pieces import Piece
from replay.logs.timeline import BootAxis, Stamps, main_stamps
from replay.logs.tlog import AUTOPILOT, Tlog, message_name
from replay.logs.tlog_blocks import Block, TlogFile
from replay.logs.tlog_vehicle import Choice

_IDS = {layout.name: layout.id for layout in LAYOUTS.values()}
_WIRE_STEP = 1.0 / PER_SI["mG"]
_WIRE_STEP_M = 1.0 / PER_SI["cm"]
"""Grids of accelerations [m/s^2] and distances [m] on the link."""
_STAMPED = ("ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "SCALED_IMU", "SCALED_PRESSURE", "SCALED_IMU2")
"""Messages on the boot clock that show how long the vehicle was there."""
_DOWN, _DOWNWARD = (0.0, 0.0, 1.0), 25
_OF_ESC = ("rpm", "temperature", "voltage", "current")
"""Quantities of an ``EscRecord``, in its order."""
_LEAST_MOVING = 0.02
"""Share of ESC samples whose packet count moves, below which a count is not kept at all."""


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """Every boot of the chosen vehicle, in order, each as a whole: memory grows with the file."""
    return [piece.log for piece in pieces(path, target_system, sys.maxsize)]


def pieces(path: Path, target_system: int | None = None, block_bytes: int | None = None) -> Iterator[Piece]:
    """Every boot of the chosen vehicle in order, a long one in several pieces: memory is that of a block.

    Raises LogError as ``TlogFile``, without a vehicle, and without boot times.
    """
    file = TlogFile(path, block_bytes)
    choice = file.census.choose(path, target_system)
    parameters = file.census.parameters(choice.system)
    carried = _Carried()
    unusable: LogError | None = None
    for block in file.blocks():
        try:
            stamps = main_stamps(block.log, choice.system, carried.stamp)
        except LogError as error:  # a stretch without the vehicle
            unusable = error
            continue
        bounds = [0, *stamps.starts().tolist(), len(block.log)]
        for first, end in itertools.pairwise(bounds):
            if end > block.first and first < block.end:
                new = carried.boot < 0 or (first > 0 and first >= block.first)
                yield _piece(block, (first, end), choice, stamps, parameters, carried, new=new)
        carried.stamp = _last_stamp(block, stamps)
    if carried.boot < 0:
        assert unusable is not None
        raise unusable


@dataclass
class _Carried:
    """What one block tells the next."""

    boot: int = -1
    origin_s: float = -math.inf
    """First boot time of this boot."""
    until_s: float = -math.inf
    """Boot time up to which it was read."""
    windows_us: int | None = None
    """Where the windows begin in which the delays of the link are looked for."""
    stamp: tuple[int, int] | None = None
    """Arrival [us] and boot stamp [ms] before the next block's first frames."""


def _last_stamp(block: Block, stamps: Stamps) -> tuple[int, int] | None:
    """The last stamp of a block that the next block does not see, if there is one."""
    # The next block begins a margin before this one's end; half of this one is before that.
    k = int(np.searchsorted(stamps.place, (block.first + block.end) // 2)) - 1
    return None if k < 0 else (int(block.log.arrival_us[stamps.place[k]]), int(stamps.ms[k]))


def _piece(
    block: Block,
    bounds: tuple[int, int],
    choice: Choice,
    stamps: Stamps,
    parameters: dict[str, float],
    carried: _Carried,
    *,
    new: bool,
) -> Piece:
    """The part of a block that is of one boot, frames ``bounds``; ``new``: the boot begins in it."""
    first, end = bounds
    log = block.log.part(first, end)
    i, j = np.searchsorted(stamps.place, bounds).tolist()
    if new:
        carried.boot, carried.until_s, carried.windows_us = carried.boot + 1, -math.inf, None
    axis = BootAxis(log, choice.system, Stamps(stamps.place[i:j] - first, stamps.ms[i:j]), carried.windows_us)
    carried.windows_us = axis.origin_us
    start_s, end_s = carried.until_s, math.inf
    if not block.is_last and end > block.end:
        carried.until_s = end_s = float(axis.by_arrival(np.array([block.end - first]))[0]) / 1e6
    own = log.part(max(block.first - first, 0), min(block.end, end) - first)
    boot = _Boot(log, choice, axis, carried.boot, parameters).flightlog(own.counts())
    if new:
        carried.origin_s = boot.start_s
    return Piece(boot, start_s, end_s, carried.origin_s, block.share_read)


class _Boot:
    """Builds one FlightLog."""

    def __init__(self, log: Tlog, choice: Choice, axis: BootAxis, boot: int, parameters: dict[str, float]) -> None:
        self._log, self._choice, self._axis, self._number = log, choice, axis, boot
        self._parameters = parameters
        self._notes = [*log.report.notes(), *choice.notes()]

    def _table(self, name: str, *, foreign: bool = False) -> Messages:
        """Messages of the vehicle, or (``foreign``) of everyone."""
        layout = LAYOUTS[_IDS[name]]
        index = self._log.indices(layout.id, None if foreign else self._choice.system)
        records = self._log.records(layout.id, index)
        stamps = None if layout.stamp is None else records[layout.stamp_field]
        times = self._axis.times(layout, index, stamps)
        return Messages(name, times, {**columns(layout, records), "component": self._log.component[index]})

    def _autopilot(self, name: str) -> Messages:
        table = self._table(name)
        return table.where(table["component"] == AUTOPILOT)

    def flightlog(self, counts: Counter[tuple[int, int, int]]) -> FlightLog:
        """All columns; ``counts`` of the messages, for the summary."""
        beats = self._autopilot("HEARTBEAT")
        attitude, rates = self._attitude()
        position = self._autopilot("LOCAL_POSITION_NED")
        target = self._autopilot("ATTITUDE_TARGET")
        command = self._table("SET_ATTITUDE_TARGET", foreign=True)
        command = command.where(np.isin(command["target_system"], (0, self._choice.system)))
        vibration = self._autopilot("VIBRATION")
        servos = self._servos()
        start, end = self._span()
        self._repairs()
        return FlightLog(
            path=self._log.path,
            system=self._choice.system,
            boot=self._number,
            start_s=start,
            end_s=end,
            vehicle_type=int(beats["type"][-1]) if len(beats) else None,
            autopilot=int(beats["autopilot"][-1]) if len(beats) else None,
            attitude=attitude,
            rates=rates,
            position=position.series(position["position"]),
            velocity=position.series(position["velocity"]),
            imus=self._imus(vibration),
            beams=self._beams(),
            rings=tuple(self._rings()),
            escs=self._escs(),
            servo=servos.get(0),
            servo_ports=servos,
            battery=self._battery(),
            pressure=self._pressure(),
            thrust_command=target.series(target["thrust"]),
            attitude_target=target.series(unflipped(target["q"])),
            commands=command.series(np.hstack([unflipped(command["q"]), command["thrust"]])),
            wind=self._wind(),
            vibration=vibration.series(vibration["level"]),
            armed=self._armed(beats, end),
            modes=runs(beats.t_s, beats["custom_mode"], end),
            landed=self._landed(end),
            parameters=self._parameters,
            texts=self._texts(),
            summary=self._summary(counts, end - start),
        )

    def _span(self) -> tuple[float, float]:
        """First and last boot time of the vehicle's stamped messages."""
        low, high = math.inf, -math.inf
        for name in _STAMPED:
            t = self._autopilot(name).t_s
            if t.size:
                low, high = min(low, float(t.min())), max(high, float(t.max()))
        if high < low:
            t = self._table("DISTANCE_SENSOR").t_s
            low, high = (float(t.min()), float(t.max())) if t.size else (0.0, 0.0)
        return low, high

    def _attitude(self) -> tuple[Series | None, Series | None]:
        euler, direct = self._autopilot("ATTITUDE"), self._autopilot("ATTITUDE_QUATERNION")
        table, q = (direct, direct["q"]) if len(direct) >= len(euler) else (euler, quaternions(euler["euler"]))
        return table.series(unflipped(q)), table.series(table["rates"])

    def _imus(self, vibration: Messages) -> tuple[ImuRecord, ...]:
        out = []
        for name in ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3"):
            table = self._autopilot(name)
            sensors = np.unique(table["id"]) if "id" in table else np.zeros(1, int)
            for sensor in sensors:
                one = table.where(table["id"] == sensor) if "id" in table else table
                number = {"SCALED_IMU2": 1, "SCALED_IMU3": 2}.get(name, int(sensor))
                record = self._imu(one, f"{name}:{sensor}" if sensor else name, vibration, number)
                if record is not None:
                    out.append(record)
        # Float before quantised, then by rate.
        return tuple(sorted(out, key=lambda r: (r.force_step > 0.0, -len(r.specific_force))))

    def _imu(self, table: Messages, source: str, vibration: Messages, number: int) -> ImuRecord | None:
        force, gyro = table["force"].copy(), table["gyro"].copy()
        if "fields_updated" in table:
            updated = table["fields_updated"].astype(np.int64)[:, None] >> np.arange(6) & 1
            force[updated[:, :3] == 0] = np.nan
            gyro[updated[:, 3:] == 0] = np.nan
        forces, gyros = table.series(force, source), table.series(gyro, source)
        counter = vibration.data.get(f"clipping_{number}")
        # The counter runs from boot; what counts is how far it went in this record.
        counted = 0 if counter is None else int(np.maximum(np.diff(counter.astype(np.int64)), 0).sum())
        return imu_record(source, forces, gyros, counted, None if table.name == "HIGHRES_IMU" else _WIRE_STEP)

    def _beams(self) -> tuple[Beam, ...]:
        out = list(self._distance_beams(self._table("DISTANCE_SENSOR")))
        table = self._table("RANGEFINDER")
        limits = next((b for b in out if b.name == "down"), None)
        low, high = (limits.min_m, limits.max_m) if limits else (math.nan, math.nan)
        distance = table.series(table["distance"])
        if distance is not None:
            out.append(range_beam(_DOWN, (AUTOPILOT, 0, _DOWNWARD), distance, (low, high)))
        return tuple(out)

    def _distance_beams(self, table: Messages) -> Iterable[Beam]:
        keys = np.stack([table["component"], table["id"], table["orientation"]], axis=-1)
        for component, sensor, orientation in np.unique(keys, axis=0):
            one = table.where((keys == (component, sensor, orientation)).all(axis=1))
            q = one["q"][np.argmax(np.isfinite(one["q"]).all(axis=1) & (np.abs(one["q"]).sum(axis=1) > 0.5))]
            direction = beam_direction(int(orientation), tuple(q.tolist()))
            if direction is None:
                self._notes.append(
                    f"DISTANCE_SENSOR {sensor} of component {component}: orientation {orientation} cannot be resolved; "
                    f"{len(one)} readings ignored"
                )
                continue
            order = np.unique(one.t_s, return_index=True)[1]
            low, high = (float(v) for v in np.median(one["limits"], axis=0))
            yield range_beam(
                direction,
                (int(component), int(sensor), int(orientation)),
                Series(one.t_s[order], one["distance"][order], one.name),
                (low, high),
                one["signal_quality"][order],
                _median(np.sqrt(one["variance"])),
                _WIRE_STEP_M,
            )

    def _rings(self) -> Iterator[Ring]:
        table = self._table("OBSTACLE_DISTANCE")
        for k in np.argsort(table.t_s).tolist():
            head = (float(table.t_s[k]), self._choice.system, int(table["component"][k]))
            distances, limits, steps = (tuple(table[name][k].tolist()) for name in ("distances", "limits", "steps"))
            offset = float(table["offset"][k, 0])
            ring = obstacle_distance(head, table.name, distances, limits, steps, offset, int(table["frame"][k]))
            if ring is not None and math.isfinite(ring.t_s):
                yield ring

    def _escs(self) -> dict[int, EscRecord]:
        found: dict[tuple[int, str], list[Series]] = {}

        def add(esc: int, table: Messages, slot: int, names: Iterable[str], rows: NDArray[np.bool_]) -> None:
            for name in names if rows.any() else ():
                own = Series(table.t_s[rows], table[name][rows, slot], table.name)
                found.setdefault((esc, name), []).append(own)

        for first in range(1, 30, 4):
            table = self._table(f"ESC_TELEMETRY_{first}_TO_{first + 3}")
            for slot in range(4):
                add(first + slot, table, slot, _OF_ESC, _fresh(table["count"][:, slot], table["rpm"][:, slot]))
        for kind, names in (("ESC_STATUS", ("rpm", "voltage", "current")), ("ESC_INFO", ("temperature",))):
            table = self._table(kind)
            for first, slot in itertools.product(np.unique(table["index"]).tolist(), range(4)):
                own = table["index"] == first
                known = table[names[0]][own, slot]
                if (np.isfinite(known) if kind == "ESC_INFO" else np.nan_to_num(known)).any():
                    add(int(first) + slot + 1, table, slot, names, own)
        if not any(name == "rpm" for _, name in found):
            # RAW_RPM and RPM: rotor sensors by number, where no ESC reports a speed.
            table = self._table("RAW_RPM")
            for number in np.unique(table["index"]).tolist():
                add(int(number) + 1, table, 0, ("rpm",), table["index"] == number)
            pair = self._table("RPM")
            for slot in range(2):
                rows = pair["rpm"][:, slot] >= 0.0
                if pair["rpm"][rows, slot].any() and (slot + 1, "rpm") not in found:
                    add(slot + 1, pair, slot, ("rpm",), rows)
        # A speed controller may report its temperature and no speed.
        numbers = sorted({esc for esc, name in found if name in ("rpm", "temperature")})
        return {esc: EscRecord(*(_joined(found.get((esc, name), [])) for name in _OF_ESC)) for esc in numbers}

    def _servos(self) -> dict[int, Series]:
        table = self._autopilot("SERVO_OUTPUT_RAW")
        own = {int(p): table.where(table["port"] == p) for p in np.unique(table["port"])}
        ports = {port: messages.series(messages["pwm"]) for port, messages in own.items()}
        return {port: series for port, series in ports.items() if series is not None}

    def _battery(self) -> Series | None:
        table = self._autopilot("BATTERY_STATUS")
        table = table.where(table["id"] == 0)
        cells = np.hstack([table["cells"], table["more_cells"]])
        voltage = np.nansum(cells, axis=1)
        voltage[~(voltage > 0.0)] = np.nan
        series = table.series(np.stack([voltage, table["current"][:, 0]], axis=-1))
        if series is not None:
            return series
        status = self._autopilot("SYS_STATUS")
        voltage = np.where(status["voltage"] > 0.0, status["voltage"], np.nan)
        return status.series(np.hstack([voltage, status["current"]]))

    def _pressure(self) -> Series | None:
        for name in ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"):
            table = self._autopilot(name)
            series = table.series(np.hstack([table["pressure"], table["temperature"]]))
            if series is not None:
                return series
        return None

    def _wind(self) -> Series | None:
        estimate = self._autopilot("WIND_COV")
        series = estimate.series(estimate["wind"])
        if series is not None:
            return series
        table = self._autopilot("WIND")
        speed, direction = table["speed"], table["direction"][:, 0]
        to = np.stack([-speed[:, 0] * np.cos(direction), -speed[:, 0] * np.sin(direction), speed[:, 1]], axis=-1)
        return table.series(to)

    def _armed(self, beats: Messages, end: float) -> tuple[Interval, ...]:
        armed = beats["base_mode"].astype(np.int64) >> 7 & 1
        return tuple(i for i in runs(beats.t_s, armed, end) if i.value)

    def _landed(self, end: float) -> tuple[Interval, ...]:
        table = self._autopilot("EXTENDED_SYS_STATE")
        table = table.where(table["landed_state"] > 0)
        return runs(table.t_s, table["landed_state"], end)

    def _texts(self) -> tuple[tuple[float, int, str], ...]:
        table = self._autopilot("STATUSTEXT")
        return tuple(
            (float(t), int(severity), bytes(text).split(b"\0")[0].decode("utf-8", "replace"))
            for t, severity, text in zip(table.t_s, table["severity"], table["text"], strict=True)
        )

    def _repairs(self) -> None:
        if self._axis.stamps_repaired:
            self._notes.append(f"{self._axis.stamps_repaired} impossible boot stamps replaced by arrival times")

    def _summary(self, counts: Counter[tuple[int, int, int]], span_s: float) -> LogSummary:
        named = ((system, component, message_name(number), n) for (system, component, number), n in counts.items())
        messages = message_counts(named, span_s)
        return LogSummary(self._log.report.bytes, counts.total(), messages, tuple(self._notes))


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def _fresh(count: NDArray[Any], rpm: Array) -> NDArray[np.bool_]:
    """Which ESC_TELEMETRY samples are new: their packet count moved. None are where an ESC never counts nor turns."""
    if not count.any() and not np.nan_to_num(rpm).any():
        return np.zeros(len(rpm), bool)
    moved = np.concatenate([[True], np.diff(count.astype(np.int64)) != 0])
    return moved if moved.mean() > _LEAST_MOVING else np.ones(len(rpm), bool)


def _joined(parts: list[Series]) -> Series | None:
    if not parts:
        return None
    t_s, values = np.concatenate([p.t_s for p in parts]), np.concatenate([p.values for p in parts])
    return tidy(t_s, values, parts[0].source)
