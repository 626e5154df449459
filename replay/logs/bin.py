"""An ArduPilot dataflash log (.BIN) as a FlightLog, by pymavlink's DFReader. Times: TimeUS, in old ones TimeMS."""

from __future__ import annotations

import contextlib
import io
import math
import os
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.errors import LogError
from models.frames import Array
from replay.flightlog import (
    Beam,
    EscRecord,
    FlightLog,
    ImuRecord,
    Interval,
    LogSummary,
    MessageCount,
    Series,
    believable,
    clipped_at_extreme,
    quaternions,
    runs,
    smallest_step,
    tidy,
    unflipped,
    verdicts_of,
)
from replay.logs.tlog import read_bytes

_MAGIC = b"\xa3\x95"
_ARDUPILOT = 3
_IMUS = ("IMU", "IMU2", "IMU3")
_EKF = ("XKF1", "NKF1", "EKF1")
_ESCS = ("ESC", *(f"ESC{i}" for i in range(1, 33)))
_KINDS = {
    "ATT", "XKQ", "NKQ", *_IMUS, *_EKF, "RCOU", "BAT", "CURR", "BARO", "RFND", *_ESCS, "RPM", "MODE", "EV", "ARM",
    "PARM", "MSG", "CTUN", "VIBE",
}  # fmt: skip
_ARMED, _DISARMED, _LANDED, _AIRBORNE = 10, 11, 18, 28
_RANGE_GOOD = 4
Row = Mapping[str, Any]


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """The one boot in the file. ``target_system`` is for links; a dataflash log holds one vehicle."""
    data = read_bytes(path)
    if data[:2] != _MAGIC:
        raise LogError(f"{path}: is no ArduPilot dataflash log (it does not start with A3 95)")
    rows, counts = _rows(path)
    if not rows:
        raise LogError(
            f"{path}: holds no flight data (no ATT, IMU or XKF1): record with LOG_DISARMED or arm the vehicle"
        )
    try:
        return [_flightlog(path, len(data), rows, counts)]
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise LogError(f"{path}: its messages make no sense ({type(error).__name__}: {error}); damaged?") from None


def _rows(path: Path) -> tuple[dict[str, list[Row]], dict[str, int]]:
    from pymavlink import DFReader

    rows: dict[str, list[Row]] = defaultdict(list)
    counts: dict[str, int] = defaultdict(int)
    last = math.nan
    with _silence():
        try:
            reader: Any = DFReader.DFReader_binary(str(path), zero_time_base=True)
            # recv_match(type=...) would be faster, but its index gives up at the first damage; this goes on behind it.
            while (message := reader.recv_msg()) is not None:
                kind = message.get_type()
                counts[kind] += 1
                if kind not in _KINDS:
                    continue
                row = message.to_dict()
                # Old events and texts carry no time: they are as old as the message before them.
                last = row["t_s"] = _stamp(row, last)
                rows[kind].append(row)
        except Exception as error:  # DFReader raises whatever a damaged file makes of it
            if not rows:
                raise LogError(f"{path}: cannot be read as a dataflash log ({error})") from None
            counts["damaged"] = 1
    return rows, counts


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """DFReader complains of every damaged byte, its C part past sys.stdout and sys.stderr: close both for a while."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            yield
    finally:
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for fd in (*kept, nowhere):
            os.close(fd)


def _flightlog(path: Path, size: int, rows: dict[str, list[Row]], counts: dict[str, int]) -> FlightLog:
    stamped = believable(np.concatenate([_times(rows[kind]) for kind in ("ATT", *_IMUS, *_EKF)]))
    if not np.isfinite(stamped).any():
        raise LogError(f"{path}: holds neither ATT, IMU nor EKF messages: nothing to replay or diagnose")
    start, end = float(np.nanmin(stamped)), float(np.nanmax(stamped))
    imus = _imus(rows)
    ekf_kind = next((kind for kind in _EKF if rows[kind]), "EKF1")
    ekf = [r for r in rows[ekf_kind] if r.get("C", 0) == 0]
    notes = ["the file is damaged; read up to the damage"] if counts.pop("damaged", 0) else []
    messages = tuple(
        MessageCount(1, 1, kind, count, count / max(end - start, 1e-3)) for kind, count in sorted(counts.items())
    )
    return FlightLog(
        path=path, system=1, boot=0, start_s=start, end_s=end, autopilot=_ARDUPILOT,
        vehicle_type=2 if any("QUAD" in str(r.get("Message", "")).upper() for r in rows["MSG"]) else None,
        attitude=_attitude(rows),
        # RATE is in deg/s or cdeg/s, by version; the gyro is in rad/s in all.
        rates=imus[0].gyro if imus else None,
        position=_series(ekf, ekf_kind, ("PN", "PE", "PD")),
        velocity=_series(ekf, ekf_kind, ("VN", "VE", "VD")),
        imus=imus,
        beams=_beams(rows["RFND"]),
        escs=_escs(rows),
        servo=(servo := _servo(rows["RCOU"])),
        servo_ports={} if servo is None else {0: servo},
        battery=_battery(rows),
        pressure=_series([r for r in rows["BARO"] if r.get("I", 0) == 0], "BARO", ("Press", "Temp")),
        thrust_command=_thrust(rows["CTUN"]),
        attitude_target=_target(rows["ATT"]),
        vibration=_series([r for r in rows["VIBE"] if r.get("IMU", 0) == 0], "VIBE", ("VibeX", "VibeY", "VibeZ")),
        armed=tuple(i for i in _armed(rows, end) if i.value),
        modes=_runs(rows["MODE"], [int(r.get("ModeNum", 0)) for r in rows["MODE"]], end),
        landed=_events(rows["EV"], {_LANDED: 1, _AIRBORNE: 2}, end),
        parameters={
            str(r["Name"]): float(r["Value"]) for r in rows["PARM"] if math.isfinite(float(r.get("Value", math.nan)))
        },
        texts=tuple((_time(r), 6, str(r.get("Message", ""))) for r in rows["MSG"]),
        summary=LogSummary(size, sum(counts.values()), messages, tuple(notes)),
    )  # fmt: skip


def _stamp(row: Row, last: float) -> float:
    """Boot time [s]. GPS messages reuse TimeMS for the time of week; none of them is read here."""
    if "TimeUS" in row:
        return float(row["TimeUS"]) / 1e6
    return float(row["TimeMS"]) / 1e3 if "TimeMS" in row else last


def _time(row: Row) -> float:
    return float(row["t_s"])


def _times(rows: Sequence[Row]) -> Array:
    return believable(np.array([_time(r) for r in rows], dtype=float))


def _values(rows: Sequence[Row], names: Sequence[str]) -> Array:
    return np.array([[float(r.get(n, math.nan)) for n in names] for r in rows], dtype=float).reshape(-1, len(names))


def _series(rows: Sequence[Row], source: str, names: Sequence[str], scale: float = 1.0) -> Series | None:
    return tidy(_times(rows), _values(rows, names) * scale, source)


def _attitude(rows: dict[str, list[Row]]) -> Series | None:
    """The first EKF core's quaternion, or ATT's angles, whichever is faster."""
    kind = "XKQ" if rows["XKQ"] else "NKQ"
    core = [r for r in rows[kind] if r.get("C", 0) == 0]
    if len(core) >= len(rows["ATT"]) and core:
        return tidy(_times(core), unflipped(_values(core, ("Q1", "Q2", "Q3", "Q4"))), kind)
    angles = np.radians(_values(rows["ATT"], ("Roll", "Pitch", "Yaw")))
    return tidy(_times(rows["ATT"]), unflipped(quaternions(angles)), "ATT")


def _target(rows: Sequence[Row]) -> Series | None:
    angles = np.radians(_values(rows, ("DesRoll", "DesPitch", "DesYaw")))
    return tidy(_times(rows), unflipped(quaternions(angles)), "ATT")


def _imus(rows: dict[str, list[Row]]) -> tuple[ImuRecord, ...]:
    out = []
    for number, kind in enumerate(_IMUS):
        for instance in sorted({int(r.get("I", 0)) for r in rows[kind]}):
            own = [r for r in rows[kind] if r.get("I", 0) == instance]
            source = f"{kind}:{instance}" if instance else kind
            force = _series(own, source, ("AccX", "AccY", "AccZ"))
            gyro = _series(own, source, ("GyrX", "GyrY", "GyrZ"))
            if force is None or gyro is None:
                continue
            clipped = max(_clip_count(rows["VIBE"], number or instance), clipped_at_extreme(force.values))
            out.append(ImuRecord(source, force, gyro, smallest_step(force.values.ravel()), clipped))
    return tuple(out)


def _clip_count(rows: Sequence[Row], imu: int) -> int:
    """How far the clip counter of one IMU went: ``Clip`` by instance, or ``Clip0 Clip1 Clip2`` in one message."""
    counts = [r["Clip"] for r in rows if "Clip" in r and r.get("IMU", 0) == imu]
    counts = counts or [r[f"Clip{imu}"] for r in rows if f"Clip{imu}" in r]
    return int(counts[-1] - counts[0]) if counts else 0


def _servo(rows: Sequence[Row]) -> Series | None:
    prefix = "C" if rows and "C1" in rows[0] else "Ch"
    values = _values(rows, [f"{prefix}{i}" for i in range(1, 17)])
    # A channel that is not in the message gives no pulse.
    return tidy(_times(rows), np.nan_to_num(values), "RCOU")


def _battery(rows: dict[str, list[Row]]) -> Series | None:
    first = [r for r in rows["BAT"] if r.get("Instance", 0) == 0]
    if first:
        return _series(first, "BAT", ("Volt", "Curr"))
    # Old CURR has centivolts and centiamperes as whole numbers, later ones V and A.
    whole = bool(rows["CURR"]) and isinstance(rows["CURR"][0].get("Volt"), int)
    return _series(rows["CURR"], "CURR", ("Volt", "Curr"), 0.01 if whole else 1.0)


def _thrust(rows: Sequence[Row]) -> Series | None:
    if rows and "ThrOut" in rows[0]:
        return _series(rows, "CTUN", ("ThrOut",), 0.001)
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
    out = []
    for (sensor, orientation), own in sorted(readings.items()):
        direction = orientation_direction(orientation)
        series = None if direction is None else tidy(
            np.array([t for t, _, _ in own]), np.array([[d, s] for _, d, s in own], dtype=float), "RFND"
        )  # fmt: skip
        if direction is None or series is None:
            continue
        distance = series.values[:, 0]
        verdicts = verdicts_of(distance, math.nan, math.nan, np.zeros(len(distance), int))
        by_state = {2.0: RangeVerdict.BELOW_MIN, 3.0: RangeVerdict.ABOVE_MAX, 0.0: RangeVerdict.LOW_QUALITY}
        by_state[1.0] = RangeVerdict.LOW_QUALITY
        verdicts = tuple(by_state.get(s, v) for s, v in zip(series.values[:, 1], verdicts, strict=True))
        out.append(
            Beam(
                direction, 1, sensor, orientation, "RFND", Series(series.t_s, series.values[:, :1], "RFND"), verdicts,
                math.nan, math.nan, math.nan, smallest_step(distance),
            )
        )  # fmt: skip
    return tuple(out)


def _escs(rows: dict[str, list[Row]]) -> dict[int, EscRecord]:
    by_esc: dict[int, list[Row]] = defaultdict(list)
    for kind in _ESCS:
        for r in rows[kind]:
            by_esc[int(r.get("Instance", 0)) + 1 if kind == "ESC" else int(kind[3:])].append(r)
    if not by_esc:
        for i in (1, 2):
            own: list[Row] = [{**r, "RPM": r[f"rpm{i}"]} for r in rows["RPM"] if float(r.get(f"rpm{i}", -1.0)) >= 0.0]
            if any(r["RPM"] for r in own):
                by_esc[i] = own
    return {
        esc: EscRecord(
            _series(own, "ESC", ("RPM",)), _series(own, "ESC", ("Temp",)),
            _series(own, "ESC", ("Volt",)), _series(own, "ESC", ("Curr",)),
        )
        for esc, own in sorted(by_esc.items())
        if any(r.get("RPM", 0) for r in own)
    }  # fmt: skip


def _runs(rows: Sequence[Row], values: Sequence[int], end: float) -> tuple[Interval, ...]:
    times = _times(rows)
    known = np.isfinite(times)
    return runs(times[known], np.array(values, dtype=int)[known], end)


def _events(rows: Sequence[Row], meaning: Mapping[int, int], end: float) -> tuple[Interval, ...]:
    own = [r for r in rows if int(r.get("Id", -1)) in meaning]
    return _runs(own, [meaning[int(r["Id"])] for r in own], end)


def _armed(rows: dict[str, list[Row]], end: float) -> tuple[Interval, ...]:
    if rows["ARM"]:
        return _runs(rows["ARM"], [int(r.get("ArmState", 0)) for r in rows["ARM"]], end)
    return _events(rows["EV"], {_ARMED: 1, _DISARMED: 0}, end)
