"""A dataflash log as a FlightLog. Field names and units: ArduPilot's log message documentation."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.frames import Array
from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, Interval, LogSummary, Series
from replay.logs.bin import EKF, ESCS, IMUS, Dataflash, Row
from replay.logs.columns import (
    believable,
    imu_record,
    message_counts,
    quaternions,
    range_beam,
    runs,
    tidy,
    time_span,
    unflipped,
)

_ARDUPILOT, _QUADROTOR = 3, 2
"""MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_TYPE_QUADROTOR."""
_INFO = 6
"""MAV_SEVERITY_INFO: dataflash texts carry no severity."""
_ARMED, _DISARMED, _LANDED, _AIRBORNE = 10, 11, 18, 28
"""LogEvent of EV.Id."""
_RANGE_GOOD = 4
"""RFND.Stat as RangeFinder::Status, as are the keys below."""
_RANGE_STATES = {
    0: RangeVerdict.LOW_QUALITY, 1: RangeVerdict.LOW_QUALITY, 2: RangeVerdict.BELOW_MIN, 3: RangeVerdict.ABOVE_MAX
}  # fmt: skip
_CENTI, _MILLI = 0.01, 0.001
_CHANNELS, _FIRST_PORT = 16, 0


def flightlog(data: Dataflash) -> FlightLog:
    """All columns. Raises LogError without attitude, IMU and filter output."""
    rows = data.rows
    start, end = time_span(data.path, [_times(rows[k]) for k in ("ATT", *IMUS, *EKF)], "ATT, IMU or EKF message")
    imus = _imus(rows)
    ekf_kind = next((kind for kind in EKF if rows[kind]), EKF[-1])
    ekf = _of(rows[ekf_kind], "C")
    servo = _servo(rows["RCOU"])
    return FlightLog(
        path=data.path, system=1, boot=0, start_s=start, end_s=end, autopilot=_ARDUPILOT,
        vehicle_type=_vehicle_type(rows["MSG"]),
        attitude=_attitude(rows),
        # RATE is in deg/s or cdeg/s, by version; the gyro is in rad/s in all.
        rates=imus[0].gyro if imus else None,
        position=_series(ekf, ekf_kind, ("PN", "PE", "PD")),
        velocity=_series(ekf, ekf_kind, ("VN", "VE", "VD")),
        imus=imus,
        beams=_beams(rows["RFND"]),
        escs=_escs(rows),
        servo=servo,
        servo_ports={} if servo is None else {_FIRST_PORT: servo},
        battery=_battery(rows),
        pressure=_series(_of(rows["BARO"], "I"), "BARO", ("Press", "Temp")),
        thrust_command=_thrust(rows["CTUN"]),
        attitude_target=_target(rows["ATT"]),
        vibration=_series(_of(rows["VIBE"], "IMU"), "VIBE", ("VibeX", "VibeY", "VibeZ")),
        armed=tuple(i for i in _armed(rows, end) if i.value),
        modes=_states(rows["MODE"], [int(r.get("ModeNum", 0)) for r in rows["MODE"]], end),
        landed=_events(rows["EV"], {_LANDED: 1, _AIRBORNE: 2}, end),
        parameters=_parameters(rows["PARM"]),
        texts=tuple((_time(r), _INFO, str(r.get("Message", ""))) for r in rows["MSG"]),
        summary=_summary(data, end - start),
    )  # fmt: skip


def _vehicle_type(texts: Sequence[Row]) -> int | None:
    """Only the boot text names the frame."""
    return _QUADROTOR if any("QUAD" in str(r.get("Message", "")).upper() for r in texts) else None


def _parameters(rows: Sequence[Row]) -> dict[str, float]:
    numbers = {str(r["Name"]): float(r.get("Value", math.nan)) for r in rows}
    return {name: value for name, value in numbers.items() if math.isfinite(value)}


def _summary(data: Dataflash, span_s: float) -> LogSummary:
    notes = ("the file is damaged; read up to the damage",) if data.damaged else ()
    counts = message_counts(((1, 1, kind, n) for kind, n in sorted(data.counts.items())), span_s)
    return LogSummary(data.bytes, sum(data.counts.values()), counts, notes)


def _of(rows: Sequence[Row], field: str, instance: int = 0) -> list[Row]:
    """Rows of one instance; old messages have no such field and are all of the first."""
    return [r for r in rows if r.get(field, 0) == instance]


def _time(row: Row) -> float:
    return float(row["t_s"])


def _times(rows: Sequence[Row]) -> Array:
    return believable(np.array([_time(r) for r in rows], dtype=float))


def _values(rows: Sequence[Row], names: Sequence[str]) -> Array:
    return np.array([[float(r.get(n, math.nan)) for n in names] for r in rows], dtype=float).reshape(-1, len(names))


def _series(rows: Sequence[Row], source: str, names: Sequence[str], scale: float = 1.0) -> Series | None:
    return tidy(_times(rows), _values(rows, names) * scale, source)


def _attitude(rows: Mapping[str, list[Row]]) -> Series | None:
    """The first EKF core's quaternion, or ATT's angles, whichever is faster."""
    kind = "XKQ" if rows["XKQ"] else "NKQ"
    core = _of(rows[kind], "C")
    if len(core) >= len(rows["ATT"]) and core:
        return tidy(_times(core), unflipped(_values(core, ("Q1", "Q2", "Q3", "Q4"))), kind)
    return _angles(rows["ATT"], ("Roll", "Pitch", "Yaw"))


def _target(rows: Sequence[Row]) -> Series | None:
    return _angles(rows, ("DesRoll", "DesPitch", "DesYaw"))


def _angles(rows: Sequence[Row], names: Sequence[str]) -> Series | None:
    """ATT's angles [deg] as quaternions."""
    return tidy(_times(rows), unflipped(quaternions(np.radians(_values(rows, names)))), "ATT")


def _imus(rows: Mapping[str, list[Row]]) -> tuple[ImuRecord, ...]:
    out = []
    for number, kind in enumerate(IMUS):
        for instance in sorted({int(r.get("I", 0)) for r in rows[kind]}):
            own = _of(rows[kind], "I", instance)
            source = f"{kind}:{instance}" if instance else kind
            force = _series(own, source, ("AccX", "AccY", "AccZ"))
            gyro = _series(own, source, ("GyrX", "GyrY", "GyrZ"))
            record = imu_record(source, force, gyro, _clip_count(rows["VIBE"], number or instance))
            out += [] if record is None else [record]
    return tuple(out)


def _clip_count(rows: Sequence[Row], imu: int) -> int:
    """How far the clip counter of one IMU went: ``Clip`` by instance, or ``Clip0 Clip1 Clip2`` in one message."""
    counts = [r["Clip"] for r in _of(rows, "IMU", imu) if "Clip" in r]
    counts = counts or [r[f"Clip{imu}"] for r in rows if f"Clip{imu}" in r]
    return int(counts[-1] - counts[0]) if counts else 0


def _servo(rows: Sequence[Row]) -> Series | None:
    prefix = "C" if rows and "C1" in rows[0] else "Ch"
    values = _values(rows, [f"{prefix}{i}" for i in range(1, _CHANNELS + 1)])
    # A channel that is not in the message gives no pulse.
    return tidy(_times(rows), np.nan_to_num(values), "RCOU")


def _battery(rows: Mapping[str, list[Row]]) -> Series | None:
    first = _of(rows["BAT"], "Instance")
    if first:
        return _series(first, "BAT", ("Volt", "Curr"))
    # Old CURR has centivolts and centiamperes as whole numbers, later ones V and A.
    whole = bool(rows["CURR"]) and isinstance(rows["CURR"][0].get("Volt"), int)
    return _series(rows["CURR"], "CURR", ("Volt", "Curr"), _CENTI if whole else 1.0)


def _thrust(rows: Sequence[Row]) -> Series | None:
    if rows and "ThrOut" in rows[0]:
        return _series(rows, "CTUN", ("ThrOut",), _MILLI)
    return _series(rows, "CTUN", ("ThO",))


def _beams(rows: Sequence[Row]) -> tuple[Beam, ...]:
    """RFND: one message per sensor (Instance, Dist, Stat, Orient), or two sensors in one (Dist1, Orient1 ...)."""
    readings: dict[tuple[int, int], list[tuple[float, float, int]]] = defaultdict(list)
    for r in rows:
        if "Dist" in r:
            key = (int(r.get("Instance", 0)), int(r.get("Orient", 255)))
            readings[key].append((_time(r), float(r["Dist"]), int(r.get("Stat", _RANGE_GOOD))))
        for i in (1, 2):
            if f"Dist{i}" in r:
                key = (i - 1, int(r.get(f"Orient{i}", 255)))
                readings[key].append((_time(r), float(r[f"Dist{i}"]), _RANGE_GOOD))
    beams = (_beam(sensor, orientation, own) for (sensor, orientation), own in sorted(readings.items()))
    return tuple(b for b in beams if b is not None)


def _beam(sensor: int, orientation: int, readings: Sequence[tuple[float, float, int]]) -> Beam | None:
    """One sensor from (time [s], distance [m], status); None where its direction is unknown."""
    direction = orientation_direction(orientation)
    series = tidy(np.array([t for t, _, _ in readings]), np.array([[d, s] for _, d, s in readings], float), "RFND")
    if direction is None or series is None:
        return None
    beam = range_beam(direction, (1, sensor, orientation), Series(series.t_s, series.values[:, :1], "RFND"))
    states = series.values[:, 1].astype(int).tolist()
    verdicts = tuple(_RANGE_STATES.get(s, v) for s, v in zip(states, beam.verdicts, strict=True))
    return replace(beam, verdicts=verdicts)


def _escs(rows: Mapping[str, list[Row]]) -> dict[int, EscRecord]:
    by_esc: dict[int, list[Row]] = defaultdict(list)
    for kind in ESCS:
        for r in rows[kind]:
            by_esc[int(r.get("Instance", 0)) + 1 if kind == "ESC" else int(kind[3:])].append(r)
    if not by_esc:
        for i in (1, 2):
            own: list[Row] = [{**r, "RPM": r[f"rpm{i}"]} for r in rows["RPM"] if float(r.get(f"rpm{i}", -1.0)) >= 0.0]
            if any(r["RPM"] for r in own):
                by_esc[i] = own
    return {
        esc: EscRecord(*(_series(own, "ESC", (name,)) for name in ("RPM", "Temp", "Volt", "Curr")))
        for esc, own in sorted(by_esc.items())
        if any(r.get("RPM", 0) for r in own)
    }


def _states(rows: Sequence[Row], values: Sequence[int], end: float) -> tuple[Interval, ...]:
    return runs(_times(rows), np.array(values, dtype=int), end)


def _events(rows: Sequence[Row], meaning: Mapping[int, int], end: float) -> tuple[Interval, ...]:
    own = [r for r in rows if int(r.get("Id", -1)) in meaning]
    return _states(own, [meaning[int(r["Id"])] for r in own], end)


def _armed(rows: Mapping[str, list[Row]], end: float) -> tuple[Interval, ...]:
    if rows["ARM"]:
        return _states(rows["ARM"], [int(r.get("ArmState", 0)) for r in rows["ARM"]], end)
    return _events(rows["EV"], {_ARMED: 1, _DISARMED: 0}, end)
