"""A .tlog as FlightLogs: one per boot of the chosen vehicle."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.dialect import mavlink
from companion.mavlink.message_table import LAYOUTS, columns
from companion.mavlink.range_beams import beam_direction
from companion.mavlink.sample_builders import obstacle_distance
from companion.mavlink.samples import Ring
from companion.mavlink.wire_layout import PER_SI, Layout
from models.common.frames import Array, Mask, Whole
from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, LogSummary, Series, SourceChoice
from replay.logs.columns import (
    Messages,
    imu_record,
    joined,
    mounting,
    quaternions,
    range_beam,
    runs,
    unflipped,
)
from replay.logs.parameters import Row, change_notes, in_force, take_off
from replay.logs.repeats import without_repeats
from replay.logs.timeline import BootAxis, boots
from replay.logs.tlog import Tlog, read_tlog
from replay.logs.tlog_vehicle import VehicleChoice, choose, parameter_count, parameters
from replay.spill import Spool, blocks, picked, spans

_IDS = {layout.name: layout.id for layout in LAYOUTS.values()}
_WIRE_STEP = 1.0 / PER_SI["mG"]
_WIRE_STEP_M = 1.0 / PER_SI["cm"]
"""Grids of accelerations [m/s^2] and distances [m] on the link."""
_STAMPED = (
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "LOCAL_POSITION_NED",
    "SCALED_IMU",
    "SCALED_PRESSURE",
    "SCALED_IMU2",
)
"""Messages on the boot clock that show how long the vehicle was there."""
_DOWN = (0.0, 0.0, 1.0)
_DOWNWARD = 25
_IMU_NUMBERS = {"SCALED_IMU2": 1, "SCALED_IMU3": 2}
"""Instances from 0 of sensors with a message of their own."""
_LONGEST_DELAY_US = 10_000_000
"""A link may be late by less, for good: then the clock was not set."""
_SHOWN = 4
"""Steps of a clock that are told one by one."""
_LEAST_MOVING = 0.02
"""Share of ESC samples whose packet count moves, below which a count is not kept at all."""


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """Every boot of the chosen vehicle, in order. Raises LogError as ``read_tlog``, without a vehicle, and without boot
    times."""
    log, repeated = without_repeats(read_tlog(path))
    choice = choose(log, target_system)
    known = {name: value for _, name, value in parameters(log, choice.system)}
    notes = [*log.report.notes(), *choice.notes()]
    if repeated:
        notes.append(f"{repeated} messages came twice, as from two links: each is taken once")
    out = []
    for number, (part, axis) in enumerate(boots(log, choice.system)):
        boot = _Boot(part, choice, axis, notes)
        out.append(boot.flightlog(number, known))
    return out


class _EscSeries:
    """Collects what several messages say of each ESC, by its number."""

    def __init__(self) -> None:
        self.speeds: defaultdict[int, list[Series]] = defaultdict(list)
        self._temperatures: defaultdict[int, list[Series]] = defaultdict(list)

    def add(self, esc: int, quantity: str, messages: Messages, slot: int) -> None:
        """Take in one column (n,) of messages: ``rpm`` or ``temperature``."""
        found = self.speeds if quantity == "rpm" else self._temperatures
        if len(messages):
            values = messages[quantity][:, slot]
            found[esc].append(Series(messages.t_s, values, messages.name))

    def records(self) -> dict[int, EscRecord]:
        """By number; one may report its temperature and no speed."""
        out = {}
        for esc in sorted({*self.speeds, *self._temperatures}):
            speed = joined(self.speeds.get(esc, []))
            temperature = joined(self._temperatures.get(esc, []))
            out[esc] = EscRecord(speed, temperature)
        return out


class _Boot:
    """Builds one FlightLog."""

    def __init__(self, log: Tlog, choice: VehicleChoice, axis: BootAxis, notes: list[str]) -> None:
        self._log = log
        self._choice = choice
        self._axis = axis
        self._notes = list(notes)

    def _table(self, name: str, *, foreign: bool = False) -> Messages:
        """Messages of the vehicle, or (``foreign``) of everyone."""
        layout = LAYOUTS[_IDS[name]]
        system = None if foreign else self._choice.system
        index = self._log.indices(layout.id, system)
        stamps = Spool(np.uint64)
        spools: dict[str, Spool] = {}
        for rows in spans(index):
            records = self._log.records(layout.id, index[rows])
            if layout.stamp is not None:
                stamps.append(records[layout.stamp_field])
            for quantity, values in columns(layout, records).items():
                if quantity not in spools:
                    spools[quantity] = Spool(values.dtype, values.shape[1:])
                spools[quantity].append(values)
        times = self._axis.times(layout, index, stamps.array() if layout.stamp else None)
        found = {quantity: spool.array() for quantity, spool in spools.items()}
        found["component"] = self._log.component[index]
        return Messages(name, times, found)

    def _autopilot(self, name: str) -> Messages:
        table = self._table(name)
        return table.where(table["component"] == AUTOPILOT_COMPONENT)

    def flightlog(self, boot: int, known: dict[str, float]) -> FlightLog:
        """All columns; ``known``: the parameters of the whole file, for what this boot does not hold."""
        beats = self._autopilot("HEARTBEAT")
        attitude, rates = self._attitude()
        position, velocity = self._position()
        thrust, target = self._target()
        vibration = self._autopilot("VIBRATION")
        gps = self._autopilot("GPS_RAW_INT")
        landed = self._autopilot("EXTENDED_SYS_STATE")
        landed = landed.where(landed["landed_state"] > 0)
        servos = self._servos()
        start, end = self._span()
        repaired = self._axis.stamps_repaired
        if repaired:
            self._notes.append(f"{repaired} impossible boot stamps replaced by arrival times")
        is_armed = beats["base_mode"] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED > 0
        armed = runs(beats.t_s, is_armed, end)
        own, changes = in_force(self._parameters(), take_off(armed))
        self._notes += change_notes(changes)
        size = len(self._log.data)
        vehicle_type = autopilot = None
        if len(beats):
            vehicle_type = int(beats["type"][-1])
            autopilot = int(beats["autopilot"][-1])
        return FlightLog(
            path=self._log.path,
            system=self._choice.system,
            boot=boot,
            start_s=start,
            end_s=end,
            vehicle_type=vehicle_type,
            autopilot=autopilot,
            attitude=attitude,
            rates=rates,
            position=position,
            velocity=velocity,
            imus=self._imus(vibration),
            beams=self._beams(),
            rings=tuple(self._rings()),
            escs=self._escs(),
            servo_ports=servos,
            batteries=self._batteries(),
            pressures=self._pressures(),
            thrust_command=thrust,
            attitude_target=target,
            commands=self._commands(),
            wind=self._wind(),
            vibration=vibration.series(vibration["level"]),
            gps_fix=gps.series(gps["fix_type"].astype(float)),
            armed=tuple(interval for interval in armed if interval.value),
            modes=runs(beats.t_s, beats["custom_mode"], end),
            landed=runs(landed.t_s, landed["landed_state"], end),
            parameters=known | own,
            parameter_changes=changes,
            parameters_expected=parameter_count(self._log, self._choice.system),
            texts=self._texts(),
            sources=(self._clock(),),
            summary=LogSummary(size, len(self._log), tuple(self._notes)),
        )

    def _clock(self) -> SourceChoice:
        """Which clock gives the times."""
        chosen = SourceChoice(
            quantity="clock",
            chosen="time_boot_ms of the autopilot",
            why="messages without a boot stamp are placed by their arrival",
        )
        steps_us = [step.by_us for step in self._axis.clock_steps]
        if not steps_us:
            return chosen
        ahead = sum(by_us > _LONGEST_DELAY_US for by_us in steps_us)
        if ahead:
            self._notes.append(f"the receiver's clock was set ahead {ahead} times")
        moved = ", ".join(f"{by_us / 1e6:+.3g} s" for by_us in steps_us[:_SHOWN])
        why = (
            f"the receiver's clock moved against it {len(steps_us)} times ({moved}); that is "
            "taken out"
        )
        return replace(chosen, others=("the receiver's clock",), why=why)

    def _parameters(self) -> list[Row]:
        """Boot time, name and value of every parameter in this boot."""
        found = parameters(self._log, self._choice.system)
        places = np.array([place for place, _, _ in found], np.int64)
        times = self._axis.times(LAYOUTS[_IDS["PARAM_VALUE"]], places, None)
        rows = zip(times.tolist(), found, strict=True)
        return [(t_s, name, value) for t_s, (_, name, value) in rows]

    def _span(self) -> tuple[float, float]:
        """First and last boot time of the vehicle's stamped messages."""
        times = np.concatenate([self._own_times(name) for name in _STAMPED])
        if not times.size:
            times = self._table("DISTANCE_SENSOR").t_s
        if not times.size:
            return (0.0, 0.0)
        return (float(times.min()), float(times.max()))

    def _own_times(self, name: str) -> Array:
        """Boot times (n,) of messages of the autopilot."""
        layout = LAYOUTS[_IDS[name]]
        index = self._log.indices(layout.id, self._choice.system)
        times = self._axis.times(layout, index, self._stamps(layout, index))
        return picked(times, self._log.component[index] == AUTOPILOT_COMPONENT)

    def _stamps(self, layout: Layout, index: Whole) -> NDArray[np.uint64] | None:
        """The time field of messages (n,), as on the wire; None where they have none."""
        if layout.stamp is None:
            return None
        stamps = Spool(np.uint64)
        for rows in spans(index):
            stamps.append(self._log.records(layout.id, index[rows])[layout.stamp_field])
        return stamps.array()

    def _attitude(self) -> tuple[Series | None, Series | None]:
        euler = self._autopilot("ATTITUDE")
        direct = self._autopilot("ATTITUDE_QUATERNION")
        if len(direct) >= len(euler):
            table = direct
            q = direct["q"]
        else:
            table = euler
            q = quaternions(euler["euler"])
        return table.series(unflipped(q)), table.series(table["rates"])

    def _position(self) -> tuple[Series | None, Series | None]:
        table = self._autopilot("LOCAL_POSITION_NED")
        return table.series(table["position"]), table.series(table["velocity"])

    def _target(self) -> tuple[Series | None, Series | None]:
        """Thrust and attitude that the autopilot is steered to."""
        table = self._autopilot("ATTITUDE_TARGET")
        return table.series(table["thrust"]), table.series(unflipped(table["q"]))

    def _commands(self) -> Series | None:
        table = self._table("SET_ATTITUDE_TARGET", foreign=True)
        own = table.where(np.isin(table["target_system"], (0, self._choice.system)))
        return own.series(np.hstack([unflipped(own["q"]), own["thrust"]]))

    def _imus(self, vibration: Messages) -> tuple[ImuRecord, ...]:
        out = []
        for name in ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3"):
            table = self._autopilot(name)
            sensors = {0: table}
            if "id" in table:
                sensors = dict(table.by(table["id"]))
            for sensor, own in sensors.items():
                number = _IMU_NUMBERS.get(name, sensor)
                source = f"{name}:{sensor}" if sensor else name
                record = self._imu(own, source, vibration, number)
                if record is not None:
                    out.append(record)
        # Float before quantised, then by rate.
        out.sort(key=lambda imu: (imu.force_step > 0.0, -len(imu.specific_force)))
        return tuple(out)

    def _imu(
        self, table: Messages, source: str, vibration: Messages, number: int
    ) -> ImuRecord | None:
        force = table["force"].copy()
        gyro = table["gyro"].copy()
        if "fields_updated" in table:
            bits = table["fields_updated"].astype(np.int64)[:, None]
            updated = bits >> np.arange(6) & 1
            force[updated[:, :3] == 0] = np.nan
            gyro[updated[:, 3:] == 0] = np.nan
        # The counter runs from boot; what counts is how far it went in this record.
        clipped = 0
        counter = vibration.data.get(f"clipping_{number}")
        if counter is not None:
            more = np.diff(counter.astype(np.int64))
            clipped = int(more[more > 0].sum())
        return imu_record(
            source=source,
            force=table.series(force, source),
            gyro=table.series(gyro, source),
            counted=clipped,
            step=None if table.name == "HIGHRES_IMU" else _WIRE_STEP,
            instance=number,
        )

    def _beams(self) -> tuple[Beam, ...]:
        out = list(self._distance_beams(self._table("DISTANCE_SENSOR")))
        table = self._table("RANGEFINDER")
        distance = table.series(table["distance"])
        if distance is None:
            return tuple(out)
        limits = [(beam.min_m, beam.max_m) for beam in out if beam.name == "down"]
        beam = range_beam(
            direction=_DOWN,
            sensor=(AUTOPILOT_COMPONENT, 0, _DOWNWARD),
            readings=distance,
            limits=limits[0] if limits else (math.nan, math.nan),
        )
        return (*out, beam)

    def _distance_beams(self, table: Messages) -> Iterable[Beam]:
        keys = np.stack([table["component"], table["id"], table["orientation"]], axis=-1)
        for key in np.unique(keys, axis=0):
            own = table.where((keys == key).all(axis=1))
            component, sensor, orientation = map(int, key)
            direction = beam_direction(orientation, mounting(own["q"]))
            if direction is None:
                self._notes.append(
                    f"DISTANCE_SENSOR {sensor} of component {component}: orientation "
                    f"{orientation} cannot be resolved; {len(own)} readings ignored"
                )
                continue
            _, order = np.unique(own.t_s, return_index=True)
            low, high = np.median(own["limits"], axis=0).tolist()
            yield range_beam(
                direction=direction,
                sensor=(component, sensor, orientation),
                readings=Series(own.t_s[order], own["distance"][order], own.name),
                limits=(low, high),
                quality=own["signal_quality"][order],
                sigma_m=_median(np.sqrt(own["variance"])),
                step_m=_WIRE_STEP_M,
            )

    def _rings(self) -> Iterator[Ring]:
        table = self._table("OBSTACLE_DISTANCE")
        for k in np.argsort(table.t_s).tolist():
            ring = obstacle_distance(
                head=(float(table.t_s[k]), self._choice.system, int(table["component"][k])),
                _=table.name,
                distances=tuple(table["distances"][k].tolist()),
                limits=tuple(table["limits"][k].tolist()),
                steps=tuple(table["steps"][k].tolist()),
                offset=float(table["offset"][k, 0]),
                frame=int(table["frame"][k]),
            )
            if ring is not None and math.isfinite(ring.t_s):
                yield ring

    def _escs(self) -> dict[int, EscRecord]:
        """Of every ESC by its number; rotor sensors only where no ESC reports a speed."""
        found = _EscSeries()
        self._add_telemetry(found)
        self._add_status(found)
        if not found.speeds:
            self._add_rotor_sensors(found)
        return found.records()

    def _add_telemetry(self, found: _EscSeries) -> None:
        """ESC_TELEMETRY_1_TO_4 and so on."""
        for first in range(1, 30, 4):
            table = self._table(f"ESC_TELEMETRY_{first}_TO_{first + 3}")
            for slot in range(4):
                fresh = table.where(_fresh(table["count"][:, slot], table["rpm"][:, slot]))
                found.add(first + slot, "rpm", fresh, slot)
                found.add(first + slot, "temperature", fresh, slot)

    def _add_status(self, found: _EscSeries) -> None:
        """ESC_STATUS and ESC_INFO, four of consecutive numbers in a message."""
        for kind, quantity in (("ESC_STATUS", "rpm"), ("ESC_INFO", "temperature")):
            table = self._table(kind)
            for first, own in table.by(table["index"]):
                known = np.isfinite(own[quantity])
                if kind == "ESC_STATUS":
                    # A speed of 0 is also what an ESC that is not there has.
                    known &= own[quantity] != 0.0
                for slot in np.flatnonzero(known.any(axis=0)).tolist():
                    found.add(first + slot + 1, quantity, own, slot)

    def _add_rotor_sensors(self, found: _EscSeries) -> None:
        """RAW_RPM and RPM: rotor sensors by number."""
        table = self._table("RAW_RPM")
        for number, own in table.by(table["index"]):
            found.add(number + 1, "rpm", own, 0)
        pair = self._table("RPM")
        for slot in range(2):
            own = pair.where(pair["rpm"][:, slot] >= 0.0)
            if own["rpm"][:, slot].any() and slot + 1 not in found.speeds:
                found.add(slot + 1, "rpm", own, slot)

    def _servos(self) -> dict[int, Series]:
        ports = {}
        table = self._autopilot("SERVO_OUTPUT_RAW")
        for port, own in table.by(table["port"]):
            series = own.series(own["pwm"])
            if series is not None:
                ports[port] = series
        return ports

    def _batteries(self) -> dict[str, Series]:
        """BATTERY_STATUS by id; SYS_STATUS where none of them reads a voltage."""
        out = {}
        table = self._autopilot("BATTERY_STATUS")
        for number, own in table.by(table["id"]):
            series = _battery(own, _sums(own))
            if series is not None and np.isfinite(series.values[:, 0]).any():
                out[f"BATTERY_STATUS id {number}"] = series
        if out:
            return out
        status = self._autopilot("SYS_STATUS")
        series = _battery(status, status["voltage"])
        if series is None:
            return {}
        return {"SYS_STATUS": series}

    def _pressures(self) -> dict[str, Series]:
        out = {}
        for name in ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"):
            table = self._autopilot(name)
            series = table.series(np.hstack([table["pressure"], table["temperature"]]))
            if series is not None:
                out[name] = series
        return out

    def _wind(self) -> Series | None:
        """WIND_COV as it is; WIND by where it comes from."""
        estimate = self._autopilot("WIND_COV")
        known = estimate.series(estimate["wind"])
        if known is not None:
            return known
        table = self._autopilot("WIND")
        direction = table["direction"][:, 0]
        level, down = table["speed"].T
        north = -level * np.cos(direction)
        east = -level * np.sin(direction)
        return table.series(np.stack([north, east, down], axis=-1))

    def _texts(self) -> tuple[tuple[float, int, str], ...]:
        table = self._autopilot("STATUSTEXT")
        out = []
        for t_s, severity, field in zip(table.t_s, table["severity"], table["text"], strict=True):
            text, _, _ = bytes(field).partition(b"\0")
            out.append((float(t_s), int(severity), text.decode("utf-8", "replace")))
        return tuple(out)


def _sums(battery: Messages) -> Array:
    """Sums (n, 1) of the voltages of all cells."""
    out = Spool(np.float64, (1,))
    for rows in blocks(len(battery)):
        cells = np.hstack([battery["cells"][rows], battery["more_cells"][rows]])
        out.append(np.nansum(cells, axis=1, keepdims=True))
    return out.array()


def _battery(table: Messages, voltage: Array) -> Series | None:
    """Voltage (n, 1) and current of a battery; a voltage of 0 is not measured."""
    known = np.where(voltage > 0.0, voltage, np.nan)
    return table.series(np.hstack([known, table["current"][:, :1]]))


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    if known.size:
        return float(np.median(known))
    return math.nan


def _fresh(count: NDArray[Any], rpm: Array) -> Mask:
    """Which ESC_TELEMETRY samples are new: their packet count moved. None are where an ESC never counts nor turns."""
    if not count.any() and not np.nan_to_num(rpm).any():
        return np.zeros(len(rpm), bool)
    moved = np.append(True, np.diff(count.astype(np.int64)) != 0)
    if moved.mean() > _LEAST_MOVING:
        return moved
    return np.ones(len(rpm), bool)
