"""A dataflash log as a FlightLog. Field names and units: ArduPilot's log message documentation."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.errors import LogError
from models.frames import Array
from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, Interval, LogSummary, Series, SourceChoice
from replay.logs.bin import EKF, ESCS, IMUS, Dataflash, read_boots
from replay.logs.columns import Messages, imu_record, quaternions, range_beam, runs, time_span, unflipped

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
_OUTPUT_NAMES = ("C", "Ch", "Chan", "Mot")
_CHANNELS, _FIRST_PORT, _UNKNOWN = 16, 0, 255


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """The boots that hold flight data, more than one where logs were joined; LogError without one. ``target_system`` is
    for links."""
    logs: list[FlightLog] = []
    problem = LogError(
        f"{path}: holds no flight data (no ATT, IMU or XKF1): record with LOG_DISARMED or arm the vehicle"
    )
    for data in read_boots(path):
        try:
            logs.append(flightlog(data))
        except LogError as error:  # a boot without attitude, IMU and filter
            problem = error
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            problem = LogError(f"{path}: its messages make no sense ({type(error).__name__}: {error}); damaged?")
    if not logs:
        raise problem
    return logs


def flightlog(data: Dataflash) -> FlightLog:
    """All columns. Raises LogError without attitude, IMU and filter output."""
    spanning = [data.of(kind).t_s for kind in ("ATT", *IMUS, *EKF)]
    start, end = time_span(data.path, spanning, "ATT, IMU or EKF message")
    imus, texts = _imus(data), list(data.texts())
    ekf_kind = next((kind for kind in EKF if len(data.of(kind))), EKF[-1])
    ekf = _of(data.of(ekf_kind), "C")
    baro, vibration, modes = _of(data.of("BARO"), "I"), _of(data.of("VIBE"), "IMU"), data.of("MODE")
    servo = _servo(data.of("RCOU")) or _servo(data.of("MOT"))
    return FlightLog(
        path=data.path, system=1, boot=data.boot, start_s=start, end_s=end, autopilot=_ARDUPILOT,
        vehicle_type=_QUADROTOR if any("QUAD" in text.upper() for _, text in texts) else None,
        attitude=_attitude(data),
        # RATE is in deg/s or cdeg/s, by version; the gyro is in rad/s in all.
        rates=imus[0].gyro if imus else None,
        position=ekf.series(ekf.columns("PN", "PE", "PD")),
        velocity=ekf.series(ekf.columns("VN", "VE", "VD")),
        imus=imus,
        beams=_beams(data.of("RFND")),
        escs=_escs(data),
        servo=servo,
        servo_ports={} if servo is None else {_FIRST_PORT: servo},
        battery=_battery(data),
        pressure=baro.series(baro.columns("Press", "Temp")),
        thrust_command=_thrust(data.of("CTUN")),
        attitude_target=_angles(data.of("ATT"), "DesRoll", "DesPitch", "DesYaw"),
        vibration=vibration.series(vibration.columns("VibeX", "VibeY", "VibeZ")),
        armed=_armed(data, start, end),
        modes=runs(modes.t_s, _whole(modes, "ModeNum" if "ModeNum" in modes else "Mode", 0), end),
        landed=_events(data.of("EV"), {_LANDED: 1, _AIRBORNE: 2}, end),
        parameters=data.parameters(),
        texts=tuple((t_s, _INFO, text) for t_s, text in texts),
        sources=(SourceChoice(quantity="clock", chosen=data.clock, why="the only one of the log"),),
        summary=LogSummary(data.size, sum(map(len, data.places.values())), data.notes),
    )  # fmt: skip


def _whole(messages: Messages, field: str, missing: int) -> NDArray[np.int64]:
    """A whole-number field (n,); ``missing`` where this version of the message has none."""
    return np.nan_to_num(messages.column(field), nan=missing).astype(np.int64)


def _of(messages: Messages, field: str, instance: int = 0) -> Messages:
    """Messages of one instance; old ones have no such field and are all of the first."""
    return messages.where(_whole(messages, field, 0) == instance)


def _attitude(data: Dataflash) -> Series | None:
    """The first EKF core's quaternion, or ATT's angles, whichever is faster."""
    core = _of(data.of("XKQ") if len(data.of("XKQ")) else data.of("NKQ"), "C")
    if len(core) >= len(data.of("ATT")) and len(core):
        return core.series(unflipped(core.columns("Q1", "Q2", "Q3", "Q4")))
    return _angles(data.of("ATT"), "Roll", "Pitch", "Yaw")


def _angles(messages: Messages, *names: str) -> Series | None:
    """ATT's angles [deg] as quaternions."""
    return messages.series(unflipped(quaternions(np.radians(messages.columns(*names)))))


def _imus(data: Dataflash) -> tuple[ImuRecord, ...]:
    out = []
    for number, kind in enumerate(IMUS):
        messages = data.of(kind)
        for instance in np.unique(_whole(messages, "I", 0)).tolist():
            own = _of(messages, "I", instance)
            source = f"{kind}:{instance}" if instance else kind
            force = own.series(own.columns("AccX", "AccY", "AccZ"), source)
            gyro = own.series(own.columns("GyrX", "GyrY", "GyrZ"), source)
            record = imu_record(source, force, gyro, _clip_count(data.of("VIBE"), number or instance))
            out += [] if record is None else [record]
    return tuple(out)


def _clip_count(vibration: Messages, imu: int) -> int:
    """How far the clip counter of one IMU went: ``Clip`` by instance, or ``Clip0 Clip1 Clip2`` in one message."""
    counts = _of(vibration, "IMU", imu).column("Clip") if "Clip" in vibration else vibration.column(f"Clip{imu}")
    known = counts[np.isfinite(counts)]
    return int(known[-1] - known[0]) if known.size else 0


def _servo(outputs: Messages) -> Series | None:
    """RCOU by whatever its version calls a channel (Chan1 to ArduCopter 3.2), or MOT (Mot1, to 3.0)."""
    # A channel that is in no message gives no pulse. One that a later declaration leaves out is unknown from there on.
    values = np.zeros((len(outputs), _CHANNELS))
    for channel in range(_CHANNELS):
        names = [f"{prefix}{channel + 1}" for prefix in _OUTPUT_NAMES]
        known = [outputs.column(name) for name in names if name in outputs]
        if known:
            values[:, channel] = functools.reduce(_else, known)
    return outputs.series(values)


def _else(first: Array, second: Array) -> Array:
    """Values (n,), from ``second`` where there is none."""
    return np.where(np.isnan(first), second, first)


def _battery(data: Dataflash) -> Series | None:
    first = _of(data.of("BAT"), "Instance")
    if len(first):
        return first.series(first.columns("Volt", "Curr"))
    # Old CURR has centivolts and centiamperes as whole numbers, later ones V and A.
    old = data.of("CURR")
    return old.series(
        old.columns("Volt", "Curr") * (_CENTI if "Volt" in old and old["Volt"].dtype.kind in "iu" else 1.0)
    )


def _thrust(tuning: Messages) -> Series | None:
    if "ThrOut" in tuning:
        old = tuning.column("ThrOut")
        # Thousandths as whole numbers, in ArduCopter 3.3 as fractions.
        thousandths = bool(np.nanmax(old, initial=0.0) > 1.0)
        return tuning.series(old * _MILLI if thousandths else old)
    return tuning.series(tuning.column("ThO"))


def _beams(ranges: Messages) -> tuple[Beam, ...]:
    """RFND: one message per sensor (Instance, Dist, Stat, Orient), or two sensors in one (Dist1, Orient1 ...)."""
    columns = [("Dist", _whole(ranges, "Instance", 0), "Orient", _whole(ranges, "Stat", _RANGE_GOOD))] + [
        (f"Dist{i}", np.full(len(ranges), i - 1), f"Orient{i}", np.full(len(ranges), _RANGE_GOOD)) for i in (1, 2)
    ]
    out: dict[tuple[int, int], Beam] = {}
    for field, sensor, facing, status in columns:
        orientation = _whole(ranges, facing, _UNKNOWN)
        for key in sorted(set(zip(sensor.tolist(), orientation.tolist(), strict=True))):
            own = (sensor == key[0]) & (orientation == key[1]) & np.isfinite(ranges.column(field))
            beam = _beam(*key, ranges.where(own), field, status[own])
            out |= {} if beam is None else {key: beam}
    return tuple(beam for _, beam in sorted(out.items(), key=lambda item: item[0]))


def _beam(sensor: int, orientation: int, own: Messages, field: str, status: NDArray[Any]) -> Beam | None:
    """One sensor; None where it has no reading or its direction is unknown."""
    direction = orientation_direction(orientation)
    series = own.series(np.stack([own.column(field), status], axis=-1))
    if direction is None or series is None:
        return None
    beam = range_beam(direction, (1, sensor, orientation), Series(series.t_s, series.values[:, :1], series.source))
    states = series.values[:, 1].astype(int).tolist()
    verdicts = tuple(_RANGE_STATES.get(s, v) for s, v in zip(states, beam.verdicts, strict=True))
    return replace(beam, verdicts=verdicts)


def _escs(data: Dataflash) -> dict[int, EscRecord]:
    by_esc: dict[int, Messages] = {}
    together = data.of("ESC")
    for instance in np.unique(_whole(together, "Instance", 0)).tolist():
        by_esc[instance + 1] = _of(together, "Instance", instance)
    by_esc |= {int(kind[3:]): data.of(kind) for kind in ESCS[1:] if len(data.of(kind))}
    if not by_esc:
        sensors = data.of("RPM")
        for i in (1, 2):
            rpm = sensors.column(f"rpm{i}")
            known = rpm >= 0.0
            by_esc[i] = Messages("RPM", sensors.t_s[known], {"RPM": rpm[known]})
    return {
        esc: EscRecord(*(own.series(own.column(name), "ESC") for name in ("RPM", "Temp")))
        for esc, own in sorted(by_esc.items())
        if np.nan_to_num(own.column("RPM")).any()
    }


def _events(events: Messages, meaning: Mapping[int, int], end: float) -> tuple[Interval, ...]:
    number = _whole(events, "Id", -1)
    known = np.isin(number, list(meaning))
    return runs(events.t_s[known], np.array([meaning[n] for n in number[known].tolist()], dtype=np.int64), end)


def _armed(data: Dataflash, start: float, end: float) -> tuple[Interval, ...]:
    """When it was armed. A log that is written only while armed may begin after the message of arming: before the
    first message the opposite of what it says was so. Without any message: while there was throttle."""
    arming = data.of("ARM")
    if len(arming):
        said = runs(arming.t_s, _whole(arming, "ArmState", 0), end)
    else:
        said = _events(data.of("EV"), {_ARMED: 1, _DISARMED: 0}, end)
    if not said:
        thrust = _thrust(data.of("CTUN"))
        up = np.empty(0) if thrust is None else thrust.t_s[thrust.values[:, 0] > 0.0]
        return (Interval(float(up[0]), float(up[-1]), 1),) if len(up) else ()
    before = [Interval(start, said[0].start_s, 1)] if not said[0].value and said[0].start_s > start else []
    return (*before, *(i for i in said if i.value))
