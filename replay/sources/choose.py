"""Every quantity of a log that may come several times, chosen in one place after the readers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from models.common.errors import ConfigError
from replay.flightlog import FlightLog, ImuRecord, Series, SourceChoice, Stated
from replay.sources.battery import batteries
from replay.sources.candidates import pick
from replay.sources.imu import imus
from replay.sources.lanes import lanes, stated_lane
from replay.sources.outputs import choose_outputs
from replay.sources.pressure import pressures, stated_pressure
from replay.sources.ranges import choose_ranges

QUANTITIES = (
    "battery",
    "imu",
    "outputs",
    "position",
    "pressure",
    "range_down",
    "range_up",
    "range_forward",
    "range_right",
    "range_back",
    "range_left",
)
"""What ``--set`` may name."""


def chosen(log: FlightLog, settings: Mapping[str, str] | None = None) -> FlightLog:
    """The log with one instance of every quantity, and ``sources`` that say which and why.

    ``settings``: instances to take, by quantity. Raises ConfigError where one is not in the log.
    """
    wanted = dict(settings or {})
    unknown = [name for name in wanted if name not in QUANTITIES]
    if unknown:
        raise ConfigError(f"--set {unknown[0]}: no such quantity; known: {', '.join(QUANTITIES)}")
    choices: list[SourceChoice | None] = []
    battery = pick("battery", batteries(log), _stated_battery(log), wanted.get("battery"))
    imu = pick("imu", imus(log), log.stated.get("imu"), wanted.get("imu"))
    lane = pick("position", lanes(log), stated_lane(log), wanted.get("position"))
    air = pick("pressure", pressures(log), stated_pressure(log), wanted.get("pressure"))
    log = replace(
        log,
        battery=_of(log.batteries, battery),
        imus=_first(log.imus, imu),
        pressure=_of(log.pressures, air),
    )
    log = _with_lane(log, lane)
    log = _with_rates(log)
    log, outputs = choose_outputs(log, wanted.get("outputs"))
    log, ranges = choose_ranges(log, wanted)
    choices += [battery, imu, outputs, lane, air, *ranges]
    made = tuple(choice for choice in choices if choice is not None)
    of_reader = tuple(choice for choice in log.sources if choice.quantity not in QUANTITIES)
    return replace(log, sources=(*of_reader, *made))


def sources_json(choices: Sequence[SourceChoice]) -> dict[str, dict[str, Any]]:
    """``{quantity: {"chosen", "others", "why"}}``."""
    out = {}
    for choice in choices:
        out[choice.quantity] = {
            "chosen": choice.chosen,
            "others": list(choice.others),
            "why": choice.why,
        }
    return out


def source_notes(choices: Sequence[SourceChoice]) -> list[str]:
    """A line for every quantity that had more than one instance."""
    out = []
    for choice in choices:
        if choice.others:
            aside = ", ".join(choice.others)
            out.append(f"{choice.quantity}: {choice.chosen}, not {aside}: {choice.why}")
    return out


def _of(found: Mapping[str, Series], choice: SourceChoice | None) -> Series | None:
    if choice is None:
        return None
    return found[choice.chosen]


def _first(found: tuple[ImuRecord, ...], choice: SourceChoice | None) -> tuple[ImuRecord, ...]:
    """The chosen IMU before the others; as they were where none is alive, so that its fault can be said."""
    if choice is None:
        return found
    return tuple(sorted(found, key=lambda imu: imu.source != choice.chosen))


def _with_lane(log: FlightLog, choice: SourceChoice | None) -> FlightLog:
    """Position and velocity of the lane, and its attitude where that comes no slower than the autopilot's own."""
    if choice is None:
        return log
    lane = log.lanes[choice.chosen]
    attitude = log.attitude
    if lane.attitude is not None and (attitude is None or len(lane.attitude) >= len(attitude)):
        attitude = lane.attitude
    return replace(log, position=lane.position, velocity=lane.velocity, attitude=attitude)


def _with_rates(log: FlightLog) -> FlightLog:
    """The chosen gyro as body rates, where the log has no estimate of them."""
    if log.rates is not None or not log.imus:
        return log
    return replace(log, rates=log.imus[0].gyro)


def _stated_battery(log: FlightLog) -> Stated | None:
    """The battery whose voltage scales the motors' outputs (MOT_BAT_IDX of ArduPilot, from 0)."""
    number = int(log.parameters.get("MOT_BAT_IDX", -1))
    names = list(log.batteries)
    if not 0 <= number < len(names):
        return None
    return Stated(names[number], "MOT_BAT_IDX")
