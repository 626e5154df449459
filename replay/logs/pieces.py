"""A stretch of one boot, so that a log of any length can be worked through within a fixed memory."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, Interval, Series


@dataclass(frozen=True)
class Piece:
    """``start_s`` <= t < ``end_s`` of a boot. ``log`` holds more on both sides, for filters and interpolation."""

    log: FlightLog
    start_s: float = -math.inf
    end_s: float = math.inf
    origin_s: float = math.nan
    """First time of the boot; NaN where the log is all of it."""
    share_read: float = 1.0
    """Of the file, up to the end of this piece."""

    def own(self) -> FlightLog:
        """The log without what is of the neighbours."""
        if self.start_s == -math.inf and self.end_s == math.inf:
            return self.log
        return cut_out(self.log, self.start_s, self.end_s)


def cut_out(log: FlightLog, start_s: float, end_s: float) -> FlightLog:
    """The time start <= t < end of a log, as views. What has no sample in it is None or left out."""

    def part(series: Series | None) -> Series | None:
        own = None if series is None else series.between(start_s, end_s)
        return own if own is not None and len(own) else None

    def parts(intervals: tuple[Interval, ...]) -> tuple[Interval, ...]:
        return tuple(
            Interval(max(i.start_s, start_s), min(i.end_s, end_s), i.value)
            for i in intervals
            if i.start_s < end_s and i.end_s > start_s
        )

    ports = {port: own for port, series in log.servo_ports.items() if (own := part(series)) is not None}
    return replace(
        log,
        start_s=max(log.start_s, start_s), end_s=min(log.end_s, end_s),
        attitude=part(log.attitude), rates=part(log.rates), position=part(log.position), velocity=part(log.velocity),
        imus=tuple(imu for imu in (_imu(i, start_s, end_s) for i in log.imus) if imu is not None),
        beams=tuple(beam for beam in (_beam(b, start_s, end_s) for b in log.beams) if beam is not None),
        rings=tuple(ring for ring in log.rings if start_s <= ring.t_s < end_s),
        escs={
            number: EscRecord(part(esc.rpm), part(esc.temperature_c), part(esc.voltage_v), part(esc.current_a))
            for number, esc in log.escs.items()
        },
        servo=part(log.servo), servo_ports=ports, battery=part(log.battery), pressure=part(log.pressure),
        thrust_command=part(log.thrust_command), attitude_target=part(log.attitude_target),
        commands=part(log.commands), wind=part(log.wind), vibration=part(log.vibration),
        armed=parts(log.armed), modes=parts(log.modes), landed=parts(log.landed),
        texts=tuple(text for text in log.texts if start_s <= text[0] < end_s),
    )  # fmt: skip


def _imu(imu: ImuRecord, start_s: float, end_s: float) -> ImuRecord | None:
    force, gyro = imu.specific_force.between(start_s, end_s), imu.gyro.between(start_s, end_s)
    return replace(imu, specific_force=force, gyro=gyro) if len(force) and len(gyro) else None


def _beam(beam: Beam, start_s: float, end_s: float) -> Beam | None:
    i, j = beam.distance.t_s.searchsorted((start_s, end_s)).tolist()
    if i == j:
        return None
    return replace(beam, distance=beam.distance.between(start_s, end_s), verdicts=beam.verdicts[i:j])
