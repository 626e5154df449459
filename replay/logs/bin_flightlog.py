"""A dataflash log as a FlightLog. Field names and units: ArduPilot's log message documentation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.common.errors import LogError
from models.vehicle.motor_outputs import PORT_OUTPUTS
from replay.flightlog import (
    Beam,
    EscRecord,
    FlightLog,
    ImuRecord,
    Interval,
    Lane,
    LogSummary,
    Series,
    SourceChoice,
    Stated,
)
from replay.logs.bin import EKF, ESCS, IMUS, Dataflash, read_boots
from replay.logs.columns import (
    Messages,
    imu_record,
    joined,
    quaternions,
    range_beam,
    runs,
    time_span,
    unflipped,
)
from replay.logs.parameters import change_notes, in_force, take_off

_ARDUPILOT = 3
_QUADROTOR = 2
"""MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_TYPE_QUADROTOR."""
_INFO = 6
"""MAV_SEVERITY_INFO: dataflash texts carry no severity."""
_ARMED = 10
_DISARMED = 11
_LANDED = 18
_AIRBORNE = 28
"""LogEvent of EV.Id."""
_RANGE_GOOD = 4
"""RFND.Stat as RangeFinder::Status, as are the keys below."""
_RANGE_STATES = {
    0: RangeVerdict.LOW_QUALITY,
    1: RangeVerdict.LOW_QUALITY,
    2: RangeVerdict.BELOW_MIN,
    3: RangeVerdict.ABOVE_MAX,
}
_CENTI = 0.01
_MILLI = 0.001
_FILTERS = (("XKF1", "XKF4", "EK3_IMU_MASK"), ("NKF1", "NKF4", "EK2_IMU_MASK"))
"""States of a filter, its status, and the parameter with the IMUs of its cores: EKF3 and EKF2."""
_OUTPUT_NAMES = ("C", "Ch", "Chan", "Mot")
"""Of the outputs: in RCOU of today, of ArduCopter 3.3, and before; in MOT."""
_PORTS = 2
"""Ports of 16 outputs: RCOU, RCO2 and RCO3 hold 32."""
_UNKNOWN = 255


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """The boots that hold flight data, more than one where logs were joined; LogError without one. ``target_system`` is
    for links."""
    logs: list[FlightLog] = []
    problem = LogError(
        f"{path}: holds no flight data (no ATT, IMU or XKF1): record with LOG_DISARMED or arm the "
        "vehicle"
    )
    for data in read_boots(path):
        try:
            logs.append(flightlog(data))
        except LogError as error:  # a boot without attitude, IMU and filter
            problem = error
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            problem = LogError(
                f"{path}: its messages make no sense ({type(error).__name__}: {error}); damaged?"
            )
    if not logs:
        raise problem
    return logs


def flightlog(data: Dataflash) -> FlightLog:
    """All columns. Raises LogError without attitude, IMU and filter output."""
    spanning = [data.of(kind).t_s for kind in ("ATT", *IMUS, *EKF)]
    start, end = time_span(data.path, spanning, "ATT, IMU or EKF message")
    imus = _imus(data)
    texts = list(data.texts())
    lanes = _lanes(data)
    armed = _armed(data, start, end)
    parameters, changes = in_force(data.parameters(), take_off(armed))
    vibration = _of(data.of("VIBE"), "IMU")
    gps = _of(data.of("GPS"), "I")
    modes = data.of("MODE")
    mode_field = "ModeNum" if "ModeNum" in modes else "Mode"
    messages = sum(map(len, data.places.values()))
    return FlightLog(
        path=data.path,
        system=1,
        boot=data.boot,
        start_s=start,
        end_s=end,
        autopilot=_ARDUPILOT,
        vehicle_type=_QUADROTOR if any("QUAD" in text.upper() for _, text in texts) else None,
        attitude=_angles(data.of("ATT"), "Roll", "Pitch", "Yaw"),
        # No rates: RATE is in deg/s or cdeg/s, by version; the gyro is in rad/s in all.
        imus=imus,
        lanes=lanes,
        beams=_beams(data.of("RFND")),
        escs=_escs(data),
        servo_ports=_servos(data),
        batteries=_batteries(data),
        pressures=_pressures(data),
        stated=_stated(data, lanes, parameters),
        thrust_command=_thrust(data.of("CTUN")),
        attitude_target=_angles(data.of("ATT"), "DesRoll", "DesPitch", "DesYaw"),
        gps_fix=gps.series(gps.column("Status")),
        vibration=vibration.series(vibration.columns("VibeX", "VibeY", "VibeZ")),
        armed=armed,
        modes=runs(modes.t_s, modes.whole(mode_field), end),
        landed=_events(data.of("EV"), {_LANDED: 1, _AIRBORNE: 2}, end),
        parameters=parameters,
        parameter_changes=changes,
        texts=tuple((t_s, _INFO, text) for t_s, text in texts),
        sources=(SourceChoice(quantity="clock", chosen=data.clock, why="the only one of the log"),),
        summary=LogSummary(data.size, messages, (*data.notes, *change_notes(changes))),
    )


def _of(messages: Messages, field: str, instance: int = 0) -> Messages:
    """Messages of one instance; old ones have no such field and are all of the first."""
    return messages.where(messages.whole(field) == instance)


def _lanes(data: Dataflash) -> dict[str, Lane]:
    """Every core of every filter, with its quaternion where that was logged."""
    out = {}
    for kind, attitude_kind in zip(EKF, ("XKQ", "NKQ", ""), strict=True):
        states = data.of(kind)
        attitudes = data.of(attitude_kind)
        for core, own in states.by(states.whole("C")):
            turned = _of(attitudes, "C", core)
            q = unflipped(turned.columns("Q1", "Q2", "Q3", "Q4"))
            lane = Lane(
                position=own.series(own.columns("PN", "PE", "PD")),
                velocity=own.series(own.columns("VN", "VE", "VD")),
                attitude=turned.series(q),
            )
            if lane.position is not None:
                out[f"{kind} core {core}"] = lane
    for kind, status, _ in _FILTERS:
        out = _with_switches(out, kind, _primary(data, status))
    return out


def _stated(
    data: Dataflash, lanes: Mapping[str, Lane], parameters: Mapping[str, float]
) -> dict[str, Stated]:
    """The lane that was primary (XKF4.PI), and the IMU that it used most of the time (EK3_IMU_MASK)."""
    for kind, status, mask_name in _FILTERS:
        primary = _primary(data, status)
        if primary is None or f"{kind} core 0" not in lanes:
            continue
        cores = primary.values[:, 0].astype(np.int64)
        core = int(np.bincount(cores).argmax())
        lane = _switched(kind)
        if lane not in lanes:
            lane = f"{kind} core {core}"
        out = {"position": Stated(lane, f"{status}.PI")}
        mask = int(parameters.get(mask_name, 0))
        imus = [bit for bit in range(len(IMUS)) if mask >> bit & 1]
        if core < len(imus):
            imu = _imu_name(data, imus[core])
            out["imu"] = Stated(imu, f"{status}.PI, {mask_name}")
        return out
    return {}


def _primary(data: Dataflash, status: str) -> Series | None:
    """Number of the primary core (n, 1)."""
    messages = _of(data.of(status), "C")
    return messages.series(messages.column("PI"))


def _switched(kind: str) -> str:
    """Name of the lane that is one core after the other."""
    return f"{kind} of the core in use"


def _with_switches(lanes: dict[str, Lane], kind: str, primary: Series | None) -> dict[str, Lane]:
    """The lanes, and where the primary core changed a lane that follows it."""
    if primary is None or float(np.ptp(primary.values)) == 0.0:
        return lanes
    used = {}
    for core in np.unique(primary.values).astype(int).tolist():
        lane = lanes.get(f"{kind} core {core}")
        if lane is None:
            return lanes
        used[core] = lane
    attitude = _followed(used, "attitude", primary)
    if attitude is not None:
        attitude = replace(attitude, values=unflipped(attitude.values))
    switched = Lane(
        position=_followed(used, "position", primary),
        velocity=_followed(used, "velocity", primary),
        attitude=attitude,
    )
    return {_switched(kind): switched} | lanes


def _followed(lanes: Mapping[int, Lane], quantity: str, primary: Series) -> Series | None:
    """Samples of each core while it was primary, in order of time."""
    parts = []
    for core, lane in lanes.items():
        series = getattr(lane, quantity)
        if series is None:
            return None
        since_first = np.maximum(series.t_s, primary.t_s[0])
        cores = primary.at(since_first, hold=True)[:, 0]
        parts.append(series.rows(cores == core))
    return joined(parts)


def _imu_name(data: Dataflash, instance: int) -> str:
    """Of the IMU with this number: a message of its own in old logs, else one of several instances."""
    if instance and len(data.of(IMUS[instance])):
        return IMUS[instance]
    if instance:
        return f"IMU:{instance}"
    return "IMU"


def _angles(messages: Messages, *names: str) -> Series | None:
    """ATT's angles [deg] as quaternions."""
    euler = np.radians(messages.columns(*names))
    return messages.series(unflipped(quaternions(euler)))


def _imus(data: Dataflash) -> tuple[ImuRecord, ...]:
    out = []
    for number, kind in enumerate(IMUS):
        messages = data.of(kind)
        for instance, own in messages.by(messages.whole("I")):
            source = f"{kind}:{instance}" if instance else kind
            record = imu_record(
                source=source,
                force=own.series(own.columns("AccX", "AccY", "AccZ"), source),
                gyro=own.series(own.columns("GyrX", "GyrY", "GyrZ"), source),
                counted=_clip_count(data.of("VIBE"), number or instance),
                instance=number or instance,
                healthy=_healthy(own),
            )
            if record is not None:
                out.append(record)
    return tuple(out)


def _healthy(imu: Messages) -> bool | None:
    """Whether accelerometer (AH) and gyro (GH) were healthy most of the time; None where the log does not say."""
    flags = imu.columns("AH", "GH")
    known = flags[np.isfinite(flags).all(axis=1)]
    if len(known):
        return bool(np.median(known.min(axis=1)) > 0.0)
    return None


def _clip_count(vibration: Messages, imu: int) -> int:
    """How far the clip counter of one IMU went: ``Clip`` by instance, or ``Clip0 Clip1 Clip2`` in one message."""
    if "Clip" in vibration:
        counts = _of(vibration, "IMU", imu).column("Clip")
    else:
        counts = vibration.column(f"Clip{imu}")
    known = counts[np.isfinite(counts)]
    if known.size:
        return int(known[-1] - known[0])
    return 0


def _servos(data: Dataflash) -> dict[int, Series]:
    """Outputs in ports of 16: RCOU, and RCO2 and RCO3 of later outputs, or MOT of ArduCopter to 3.0."""
    series = _channels(data.of("RCOU")) or _channels(data.of("MOT"))
    if series is None:
        return {}
    values = series.values
    for kind in ("RCO2", "RCO3"):
        outputs = _channels(data.of(kind))
        if outputs is not None:
            values = values + np.nan_to_num(outputs.at(series.t_s, hold=True))
    ports = {}
    for port, own in enumerate(np.split(values, _PORTS, axis=1)):
        if not port or own.any():
            ports[port] = Series(series.t_s, own, series.source)
    return ports


def _channels(outputs: Messages) -> Series | None:
    """Pulses (n, 32) by whatever its version calls a channel; 0 where the message has no such output.

    One that a later declaration leaves out is unknown from there on.
    """
    values = np.zeros((len(outputs), _PORTS * PORT_OUTPUTS))
    for channel, pulses in enumerate(values.T, 1):
        names = [f"{prefix}{channel}" for prefix in _OUTPUT_NAMES]
        known = [name for name in names if name in outputs]
        if known:
            pulses[:] = np.nan
        for name in known:
            unknown = np.isnan(pulses)
            pulses[unknown] = outputs.column(name)[unknown]
    return outputs.series(values)


def _batteries(data: Dataflash) -> dict[str, Series]:
    """BAT by instance (``Inst`` from 4.1 on, ``Instance`` before), or CURR of old logs."""
    messages = data.of("BAT")
    field = "Inst" if "Inst" in messages else "Instance"
    out = {}
    for instance, own in messages.by(messages.whole(field)):
        series = own.series(own.columns("Volt", "Curr"))
        if series is not None:
            out[f"BAT {instance}"] = series
    if out:
        return out
    # Old CURR has centivolts and centiamperes as whole numbers, later ones V and A.
    old = data.of("CURR")
    values = old.columns("Volt", "Curr")
    if "Volt" in old and old["Volt"].dtype.kind in "iu":
        values *= _CENTI
    series = old.series(values)
    if series is None:
        return {}
    return {"CURR": series}


def _pressures(data: Dataflash) -> dict[str, Series]:
    """BARO by instance (``I``), or BARO, BAR2 and BAR3 of old logs."""
    out = {}
    for kind in ("BARO", "BAR2", "BAR3"):
        messages = data.of(kind)
        for instance, own in messages.by(messages.whole("I")):
            series = own.series(own.columns("Press", "Temp"))
            name = f"{kind} {instance}" if "I" in messages else kind
            if series is not None:
                out[name] = series
    return out


def _thrust(tuning: Messages) -> Series | None:
    if "ThrOut" not in tuning:
        return tuning.series(tuning.column("ThO"))
    old = tuning.column("ThrOut")
    # Thousandths as whole numbers, in ArduCopter 3.3 as fractions.
    if np.nanmax(old, initial=0.0) > 1.0:
        old = old * _MILLI
    return tuning.series(old)


def _beams(ranges: Messages) -> tuple[Beam, ...]:
    """RFND: one message per sensor (Instance, Dist, Stat, Orient), or two sensors in one (Dist1, Orient1 ...)."""
    out: dict[tuple[int, int], Beam] = {}
    for suffix, first in (("", 0), ("1", 0), ("2", 1)):
        field = f"Dist{suffix}"
        known = ranges.where(np.isfinite(ranges.column(field)))
        for number, own in known.by(known.whole("Instance") + first):
            for orientation, one in own.by(own.whole(f"Orient{suffix}", _UNKNOWN)):
                beam = _beam(number, orientation, one, field)
                if beam is not None:
                    out[number, orientation] = beam
    return tuple(out[key] for key in sorted(out))


def _beam(sensor: int, orientation: int, own: Messages, field: str) -> Beam | None:
    """One sensor; None where it has no reading or its direction is unknown."""
    direction = orientation_direction(orientation)
    status = own.whole("Stat", _RANGE_GOOD)
    series = own.series(np.stack([own.column(field), status], axis=-1))
    if direction is None or series is None:
        return None
    readings = Series(series.t_s, series.values[:, :1], series.source)
    beam = range_beam(direction, (1, sensor, orientation), readings)
    states = series.values[:, 1].astype(int).tolist()
    verdicts = []
    for state, verdict in zip(states, beam.verdicts, strict=True):
        verdicts.append(_RANGE_STATES.get(state, verdict))
    return replace(beam, verdicts=tuple(verdicts))


def _escs(data: Dataflash) -> dict[int, EscRecord]:
    by_esc: dict[int, Messages] = {}
    together = data.of("ESC")
    for instance, messages in together.by(together.whole("Instance")):
        by_esc[instance + 1] = messages
    for number, kind in enumerate(ESCS[1:], 1):
        messages = data.of(kind)
        if len(messages):
            by_esc[number] = messages
    if not by_esc:
        sensors = data.of("RPM")
        for number in (1, 2):
            rpm = sensors.column(f"rpm{number}")
            known = rpm >= 0.0
            by_esc[number] = Messages("RPM", sensors.t_s[known], {"RPM": rpm[known]})
    out = {}
    for number, own in sorted(by_esc.items()):
        rpm = own.column("RPM")
        if np.nan_to_num(rpm).any():
            temperature = own.series(own.column("Temp"), "ESC")
            out[number] = EscRecord(own.series(rpm, "ESC"), temperature)
    return out


def _events(events: Messages, meaning: Mapping[int, int], end: float) -> tuple[Interval, ...]:
    number = events.whole("Id", -1)
    known = np.isin(number, list(meaning))
    meant = [meaning[n] for n in number[known].tolist()]
    return runs(events.t_s[known], np.array(meant, np.int64), end)


def _armed(data: Dataflash, start: float, end: float) -> tuple[Interval, ...]:
    """When it was armed. A log that is written only while armed may begin after the message of arming: before the
    first message the opposite of what it says was so. Without any message: while there was throttle."""
    arming = data.of("ARM")
    if len(arming):
        said = runs(arming.t_s, arming.whole("ArmState"), end)
    else:
        said = _events(data.of("EV"), {_ARMED: 1, _DISARMED: 0}, end)
    if said:
        first = said[0]
        if not first.value and first.start_s > start:
            said = (Interval(start, first.start_s, 1), *said)
        return tuple(interval for interval in said if interval.value)
    thrust = _thrust(data.of("CTUN"))
    if thrust is None or not (thrust.values > 0.0).any():
        return ()
    on = thrust.t_s[thrust.values[:, 0] > 0.0]
    return (Interval(float(on[0]), float(on[-1]), 1),)
