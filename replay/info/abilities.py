"""What a log can answer: each question with yes, partly or no, why, and the setting that would change it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from models.vehicle import Vehicle
from replay.flightlog import FlightLog, Series
from replay.logs.settings import ARDUPILOT, change_for, older_than, parameter_missing
from replay.residual.motion import FORCE_RATE_HZ, MOMENT_RATE_HZ

_GOOD_IMU_HZ = 25.0
"""Up to 2 Hz is judged with it; slower accelerometers are judged up to a quarter of their rate."""
_RANGE_HZ = 5.0
_RPM_HZ = 5.0
"""Slower than 5 Hz, a vehicle at 0.5 m/s moves 0.1 m between readings: half of a small ground effect's length."""


_OF_GUID_OPTIONS = (4, 1)
"""The first ArduCopter with that parameter."""


class Extent(StrEnum):
    """How well a log answers a question."""

    YES = "yes"
    PARTLY = "partly"
    NO = "no"


@dataclass(frozen=True)
class Ability:
    """One question to a log. ``change`` is empty where the answer is yes."""

    question: str
    answer: Extent
    why: str
    change: str = ""


Judged = tuple[Extent, str, str]
"""How well, why, and what would change it: all of an ``Ability`` but its question."""


def abilities(log: FlightLog, vehicle: Vehicle | None) -> tuple[Ability, ...]:
    """Every question that a diagnosis or a flight asks of one boot; ``vehicle``: None where the log shows none."""
    return (
        Ability("forces (Fx Fy Fz)", *_forces(log)),
        Ability("moments (Mx My Mz)", *_moments(log)),
        Ability("thrust of the rotors", *_rotors(log, vehicle)),
        Ability("height over ground", *_range(log, "down")),
        Ability("distance to a wall", *_range(log, "forward", "right", "back", "left")),
        Ability("ceiling", *_range(log, "up")),
        *_channels(log),
        Ability("meaning of thrust", *_meaning_of_thrust(log)),
    )


def _forces(log: FlightLog) -> Judged:
    if log.attitude is None:
        return Extent.NO, "no attitude", change_for(log, "attitude")
    imu = max(log.imus, key=lambda i: _rate(i.specific_force), default=None)
    if imu is None:
        rate = 0.0
    else:
        rate = _rate(imu.specific_force)
    if imu is None or rate < FORCE_RATE_HZ:
        if rate:
            why = f"accelerometer at {rate:.1f} Hz; {FORCE_RATE_HZ:.0f} Hz are needed"
        else:
            why = "no accelerometer"
        return Extent.NO, why, change_for(log, "imu")
    if imu.clipped:
        why = f"the accelerometer clipped {imu.clipped} times: its mean cannot be trusted"
        return Extent.PARTLY, why, "damp the autopilot's mount; balance the propellers"
    if rate < _GOOD_IMU_HZ:
        why = f"accelerometer at {rate:.1f} Hz: slow changes only"
        return Extent.PARTLY, why, change_for(log, "imu")
    return Extent.YES, f"accelerometer at {rate:.0f} Hz", ""


def _moments(log: FlightLog) -> Judged:
    rates = [_rate(i.gyro) for i in log.imus] + [_rate(log.rates)]
    rate = max(rates)
    if rate < MOMENT_RATE_HZ:
        if rate:
            why = f"angular rates at {rate:.1f} Hz; {MOMENT_RATE_HZ:.0f} Hz are needed"
        else:
            why = "no angular rates"
        return Extent.NO, why, change_for(log, "imu")
    return Extent.YES, f"angular rates at {rate:.0f} Hz", ""


def _rate(series: Series | None) -> float:
    if series is not None and len(series) > 1:
        return series.rate_hz
    return 0.0


def _rotors(log: FlightLog, vehicle: Vehicle | None) -> Judged:
    speeds = {number: _rate(esc.rpm) for number, esc in log.escs.items() if esc.rpm is not None}
    if vehicle is None:
        wanted = sorted(speeds)
    else:
        wanted = [rotor.esc for rotor in vehicle.rotors if rotor.esc is not None]
    if wanted and all(n in speeds for n in wanted):
        slowest = min(speeds[n] for n in wanted)
        why = f"speeds of ESC {', '.join(map(str, wanted))} at {slowest:.0f} Hz"
        if slowest < _RPM_HZ:
            return Extent.PARTLY, why + ": slow", change_for(log, "rpm")
        return Extent.YES, why, ""
    if vehicle is not None and not wanted:
        return _by_outputs(log)
    lacking = ", ".join(str(n) for n in wanted if n not in speeds)
    if lacking:
        why = f"no speed of ESC {lacking}"
    else:
        why = "no rotor speeds"
    if log.servo is not None:
        why += "; servo outputs are there"
        change = (
            f"{change_for(log, 'rpm')}; or name the rotors by servo and add [throttle] "
            "(--save-vehicle drafts it)"
        )
        return Extent.PARTLY, why, change
    change = (
        f"{change_for(log, 'rpm')}; or, for outputs with [throttle], {change_for(log, 'servo')}"
    )
    return Extent.NO, why, change


def _by_outputs(log: FlightLog) -> Judged:
    """Of a vehicle whose rotors are named by servo."""
    if log.servo is None:
        return Extent.NO, "no servo outputs", change_for(log, "servo")
    return Extent.YES, f"servo outputs at {_rate(log.servo):.0f} Hz and [throttle]", ""


def _range(log: FlightLog, *directions: str) -> Judged:
    """Of the directions that look at a surface the one with most good readings."""
    seen = {
        direction: beam for direction in directions if (beam := log.beam(direction)) is not None
    }
    if not seen:
        why = f"no rangefinder looks {' or '.join(directions)}"
        return Extent.NO, why, change_for(log, "range", directions)
    direction, beam = max(seen.items(), key=lambda item: len(item[1].good))
    rate = _rate(beam.distance)
    share = beam.share_good
    why = f"{beam.source} {direction} at {rate:.0f} Hz, {share:.0%} of the readings good"
    if not len(beam.good):
        return Extent.NO, why, "nothing, if nothing was in reach; else check the sensor's limits"
    if rate < _RANGE_HZ:
        return Extent.PARTLY, why, change_for(log, "range", directions)
    return Extent.YES, why, ""


def _channels(log: FlightLog) -> Iterator[Ability]:
    temperature = any(esc.temperature_c is not None for esc in log.escs.values())
    battery = log.battery is not None and math.isfinite(
        float(log.battery.values[:, 0].max(initial=-math.inf))
    )
    moving = log.velocity is not None and bool(np.isfinite(log.velocity.values[:, :2]).any())
    for question, there, quantity, there_text in (
        ("wind and drag", moving, "position", "velocity in the log"),
        ("battery sag", battery, "battery", "battery voltage in the log"),
        ("thermal derating", temperature, "temperature", "ESC temperatures in the log"),
        ("air density", log.pressure is not None, "pressure", "static pressure in the log"),
        ("hover thrust", log.thrust_command is not None, "thrust", "thrust command in the log"),
    ):
        if there:
            yield Ability(question, Extent.YES, there_text)
        else:
            yield Ability(question, Extent.NO, "not in the log", change_for(log, quantity))


def _meaning_of_thrust(log: FlightLog) -> Judged:
    name = "GUID_OPTIONS"
    old = older_than(log, _OF_GUID_OPTIONS)
    if old and name not in log.parameters:
        why = f"{old} has no {name} (it came with 4.1): thrust is a climb rate"
        return Extent.NO, why, f"ArduCopter 4.1 or later, and {name} with bit 3 (value 8)"
    if log.autopilot == ARDUPILOT and name not in log.parameters:
        why = f"{name} is not among the {len(log.parameters)} parameters in the log"
        lacking = parameter_missing(log, name, _OF_GUID_OPTIONS)
        change = f"{lacking}; replay run --param {name}=8 takes it as given"
        return Extent.NO, why, change
    if log.autopilot == ARDUPILOT and not int(log.parameters[name]) & 8:
        why = f"{name} is {log.parameters[name]:g}: thrust is a climb rate"
        return Extent.NO, why, f"{name} with bit 3 (value 8)"
    if not log.parameters:
        return Extent.NO, "no parameters in the log", change_for(log, "parameters")
    return Extent.YES, f"{len(log.parameters)} parameters in the log", ""
