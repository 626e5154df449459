"""A vehicle drafted from logs: what their parameters and outputs say, what a hover measures, what is typical.

Thrust comes through the hover: the rotors carry the weight, so ct or the throttle curve follows from the mass. Every
force is then known as a share of the weight, whatever the mass is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from companion.vehicles import default_vehicle
from models.common.errors import ConfigError, LogError
from models.common.frames import GRAVITY, Array
from models.vehicle import RHO_SEA_LEVEL, Rangefinder, Vehicle
from models.vehicle.estimate import Guess, typical_sizes
from models.vehicle.motor_outputs import PORT_OUTPUTS
from models.vehicle.plausibility import findings, target_of
from models.vehicle.rotor_speed import Hover, misread
from models.vehicle.setup import (
    COMMON_PROPELLERS,
    USUAL_PULSES,
    Answers,
    build,
    parameter_ranges,
)
from models.vehicle.toml_text import vehicle_text
from models.vehicle.vehicle import ASSUMABLE
from replay.flightlog import FlightLog, MotorOutputs
from replay.logs.formats import load
from replay.residual.motion import ENOUGH_S
from replay.residual.record import Record, build_record
from replay.sources.choose import chosen
from replay.vehicle.airframe import TANDEM, TANDEM_SEEN, Airframe, airframe, is_tandem, turns
from replay.vehicle.fit import ThrustFit, fit_records, free_flight, hovering
from replay.vehicle.given import Given

_OPTIONS = {"mass_kg": "--mass KG", "rotor_radius_m": "--propeller INCH", "position_m": "--span M"}
_GUESSED = "a guess"
LOGS = 12
"""So many logs are looked at; the others are taken to be of the same vehicle."""
_STRETCHES = 8
"""So many are enough for a hover; of a long log one is 32 MiB."""
_VOLTAGE_V = 15.0
"""Of a log without battery: nothing depends on it then."""


@dataclass(frozen=True)
class Fact:
    """A number of the draft, and where it comes from."""

    key: str
    value: Any
    source: str

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {"key": self.key, "value": self.value, "from": self.source}

    def as_text(self) -> str:
        """One line."""
        if isinstance(self.value, float):
            value = f"{self.value:.4g}"
        else:
            value = str(self.value)
        return f"{self.key} {value}: {self.source}"


@dataclass(frozen=True)
class Draft:
    """A vehicle, and where each of its numbers comes from."""

    vehicle: Vehicle
    known: tuple[Fact, ...]
    assumed: tuple[Fact, ...] = ()
    doubts: tuple[str, ...] = ()
    """What of the logs is not believed."""
    read: dict[Path, list[FlightLog]] = field(default_factory=dict, repr=False, compare=False)
    """Logs that were read for it, for whoever needs them next: reading takes seconds."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not believed, and what is assumed, one line each."""
        return (*self.doubts, *(f"assumed: {fact.as_text()}" for fact in self.assumed))

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        facts = {"known": self.known, "assumed": self.assumed}
        return {
            "drafted": True,
            **{name: [f.as_json() for f in some] for name, some in facts.items()},
        }

    def as_toml(self) -> str:
        """A vehicle file, with where each number comes from."""
        origin = {f.key: f.source for f in (*self.known, *self.assumed)}
        return vehicle_text(
            self.vehicle,
            origin,
            "Drafted from a log. Every key: docs/vehicle.md. SI units, body FRD.",
        )


def draft(
    paths: Sequence[Path], given: Given, target_system: int | None = None, *, measured: bool = True
) -> Draft:
    """The vehicle that flew in all these logs; not ``measured``: as parameters and outputs say, no flight is judged.

    Raises LogError where it cannot be said, ConfigError where the logs are of two vehicles or a number is impossible.
    """
    read: dict[Path, list[FlightLog]] = {}
    logs = _flown(paths[:LOGS], target_system, given.settings, read)
    parameters = {}
    for log in reversed(logs):
        for key, value in log.parameters.items():
            parameters[key] = value
    logs = [
        log for log in logs if turns(log)
    ] or logs  # what stood on the bench lends its parameters alone
    if all(map(is_tandem, logs)):
        return _tandem(given)
    _refuse_two(logs)
    first = chosen(replace(logs[0], parameters=parameters), given.settings)
    frame = airframe(first)
    if given.propeller_m is None:
        radius = None
    else:
        radius = given.propeller_m / 2.0
    if given.span_m is None:
        arm = frame.arm_m
    else:
        arm = given.span_m / 2.0
    doubt = _misread(logs, frame, parameters, given.mass_kg, radius, arm)
    if doubt is not None:
        frame, doubt = _without_speeds(logs, frame, parameters, doubt)
    sizes = typical_sizes(given.mass_kg, radius, arm, frame.motors, _rpm(logs, frame))
    start, said = build(_answers([first, *logs[1:]], frame, parameters, sizes))
    if not measured:
        return Draft(start, (), read=read)
    found, how = _measured(_records(logs, start, target_system, given.settings), start)
    hover, source = _hover(found, said["hover_thrust"], start.hover_thrust, how)
    said |= {key: f"measured in {how}" for key in found.measured} | {"hover_thrust": source}
    vehicle = replace(found.vehicle, hover_thrust=hover)
    known, assumed = _facts(vehicle, frame, sizes, said, first.motor_outputs)
    unknown = [f.key for f in assumed if f.key in ASSUMABLE]
    unknown += [] if frame.ordered else ["order"]
    vehicle = replace(vehicle, assumed=tuple(unknown))
    wrong = next((f for f in findings(vehicle) if f.refused), None)
    if wrong is not None:
        raise ConfigError(f"the drafted vehicle is impossible: {wrong.key} {wrong.text}")
    return Draft(
        vehicle=vehicle,
        known=tuple(known),
        assumed=tuple(assumed),
        doubts=() if doubt is None else (doubt,),
        read=read,
    )


def _misread(
    logs: Sequence[FlightLog],
    frame: Airframe,
    parameters: Mapping[str, float],
    mass_kg: float | None,
    radius_m: float | None,
    arm_m: float | None,
) -> str | None:
    """What is wrong with the rotor speeds, by the battery and by what is known of the vehicle."""
    rpm = _rpm(logs, frame)
    if rpm is None:
        return None
    size = typical_sizes(None, radius_m, arm_m, frame.motors, None)["rotor_radius_m"]
    placed = radius_m is not None or (mass_kg is None and arm_m is not None)
    voltage = _voltages(logs)
    hover = Hover(
        rotors=len(frame.motors),
        places=len({(m.forward, m.right) for m in frame.motors}),
        voltage_v=float(np.median(voltage)) if voltage.size else math.nan,
        mass_kg=math.nan if mass_kg is None else mass_kg,
        radius_m=size.value if placed else math.nan,
        radius_spread=size.spread,
    )
    return misread(rpm, hover, parameters)


def _without_speeds(
    logs: Sequence[FlightLog], frame: Airframe, parameters: Mapping[str, float], doubt: str
) -> tuple[Airframe, str]:
    """The frame by outputs alone, where all logs hold them, and what is said of that."""
    if any(log.servo is None for log in logs):
        return frame, doubt
    try:
        by_outputs = airframe(replace(logs[0], parameters=parameters, escs={}))
    except LogError:
        return frame, doubt
    return by_outputs, f"{doubt}; outputs are used instead of them"


def _flown(
    paths: Sequence[Path],
    target_system: int | None,
    settings: Mapping[str, str],
    read: dict[Path, list[FlightLog]],
) -> list[FlightLog]:
    """Of every log that can be read the first stretch in which it was armed, or the first one.

    What is read is kept in ``read``.
    """
    out = []
    problems = []
    for path in paths:
        try:
            read[path] = load(path, target_system, settings)
            parts = []
            for log in read[path]:
                for part in log.stretches():
                    parts.append(part)
        except LogError as error:
            problems.append(error)
            continue
        out.append(next((part for part in parts if part.armed), parts[0]))
    if not out:
        raise problems[0]
    return out


def _tandem(given: Given) -> Draft:
    if given.propeller_m is not None or given.span_m is not None:
        raise ConfigError(
            f"--propeller, --span: the log is of {TANDEM}, whose sizes are known; leave them out"
        )
    vehicle = default_vehicle()
    if given.mass_kg is not None:
        vehicle = replace(vehicle, mass_kg=given.mass_kg)
    return Draft(vehicle, (Fact("name", vehicle.name, TANDEM_SEEN),))


def _refuse_two(logs: Sequence[FlightLog]) -> None:
    """ConfigError where logs contradict each other; a frame that one does not say may be that of another."""
    frames = [airframe(log) for log in logs]
    names = [
        TANDEM if is_tandem(log) else frame.name for log, frame in zip(logs, frames, strict=True)
    ]
    sure = next((k for k, f in enumerate(frames) if f.declared or names[k] == TANDEM), 0)
    for log, name, frame in zip(logs, names, frames, strict=True):
        what = ""
        if len(frame.motors) != len(frames[sure].motors) or (
            name != names[sure] and (frame.declared or TANDEM in (name, names[sure]))
        ):
            what = f"are of two vehicles ({names[sure]}; {name})"
        elif frame.telemetered != frames[sure].telemetered:
            what = "hold rotor speeds in the one and outputs alone in the other"
        if what:
            raise ConfigError(
                f"{logs[sure].path} and {log.path} {what}: diagnose them one by one, or give "
                "--vehicle"
            )


def _rpm(logs: Sequence[FlightLog], frame: Airframe) -> float | None:
    """Median rotor speed, rotors that stand still left out."""
    if not frame.telemetered:
        return None
    speeds = []
    for log in logs:
        for n in frame.numbers.values():
            if n in log.escs:
                speeds.append(log.escs[n].rpm)
    turning = [rpm.values[rpm.values > 0.0] for rpm in speeds if rpm is not None]
    medians = [float(np.median(values)) for values in turning if values.size]
    if medians:
        return float(np.median(medians))
    return None


def _voltages(logs: Sequence[FlightLog]) -> Array:
    """All battery voltages (n,) that are known."""
    voltages = [log.battery.values[:, 0] for log in logs if log.battery is not None]
    if voltages:
        return np.concatenate([v[np.isfinite(v)] for v in voltages])
    return np.zeros(0)


def _answers(
    logs: Sequence[FlightLog],
    frame: Airframe,
    parameters: Mapping[str, float],
    sizes: Mapping[str, Guess],
) -> Answers:
    voltage = _voltages(logs)
    return Answers(
        name=f"{frame.name}, drafted from {logs[0].path.name}",
        mass_kg=sizes["mass_kg"].value,
        propeller_m=2.0 * sizes["rotor_radius_m"].value,
        motors=frame.motors,
        numbers=frame.numbers,
        arm_m=sizes["position_m"].value,
        telemetered=frame.telemetered,
        voltage_v=round(float(np.median(voltage)), 2) if voltage.size else _VOLTAGE_V,
        ranges=tuple(_ranges(logs, parameters)),
        parameters=parameters,
        port=logs[0].motor_outputs.port,
        group=logs[0].motor_outputs.group,
    )


def _ranges(logs: Sequence[FlightLog], parameters: Mapping[str, float]) -> Iterator[Rangefinder]:
    """Those of the parameters, and those that are in a log besides."""
    declared = parameter_ranges(parameters)
    yield from declared
    seen = {r.orientation for r in declared}
    for beam in (b for log in logs for b in log.beams):
        if beam.orientation not in seen and beam.name != "other":
            seen.add(beam.orientation)
            yield Rangefinder(beam.orientation, target_of(beam.orientation), (0.0, 0.0, 0.0))


def _records(
    logs: Sequence[FlightLog],
    start: Vehicle,
    target_system: int | None,
    settings: Mapping[str, str],
) -> list[Record]:
    """Of the stretches that are read already; where none of them can be judged, of all. Raises LogError without any."""
    problems: list[LogError] = []

    def judged(stretches: Iterable[FlightLog]) -> Iterator[Record]:
        for log in stretches:
            try:
                yield build_record(log, start, None)
            except LogError as error:
                problems.append(error)

    boots = (boot for log in logs for boot in load(log.path, target_system, settings))
    every = (part for boot in boots for part in boot.stretches())
    found = list(judged(logs)) or list(islice(judged(every), _STRETCHES))
    if not found:
        raise problems[0]
    return found


def _measured(records: Sequence[Record], start: Vehicle) -> tuple[ThrustFit, str]:
    """Thrust by free hover; where there is too little, by all free flight, then by all flight."""
    for rows, how in ((hovering, "free hover"), (free_flight, "free flight")):
        if sum(rows(r).sum() * r.step_s for r in records) >= ENOUGH_S:
            return fit_records(records, start, rows), how
    return fit_records(records, start, lambda r: r.valid), "the whole flight"


def _hover(found: ThrustFit, said: str, start: float, how: str) -> tuple[float, str]:
    """ArduPilot learns MOT_THST_HOVER in flight; PX4's MPC_THR_HOVER is what somebody typed in."""
    if said == "MOT_THST_HOVER":
        return start, said
    if "hover_thrust" in found.measured:
        return found.vehicle.hover_thrust, f"measured in {how}"
    if math.isfinite(found.output):
        return round(found.output, 3), f"mean output in {how}"
    return start, said


def _rotors(vehicle: Vehicle, outputs: MotorOutputs) -> Fact:
    """Numbers of the ESCs or outputs, in the order of the fans, as the autopilot's own parameters count them."""
    if vehicle.telemetered:
        return Fact("rotors", [rotor.esc for rotor in vehicle.rotors], "ESC numbers")
    numbers = [rotor.servo or 0 for rotor in vehicle.rotors]
    if outputs.group:
        return Fact("rotors", numbers, f"outputs of {outputs.group}")
    # ArduPilot counts on: its output 17 is the first of port 1.
    first = PORT_OUTPUTS * outputs.port
    return Fact("rotors", [first + number for number in numbers], "outputs")


def _facts(
    vehicle: Vehicle,
    frame: Airframe,
    sizes: Mapping[str, Guess],
    said: Mapping[str, str],
    outputs: MotorOutputs,
) -> tuple[list[Fact], list[Fact]]:
    """What is known, and what is assumed."""
    known = [Fact("frame", frame.name, frame.source), _rotors(vehicle, outputs)]
    assumed = []
    for key, guess in sizes.items():
        if guess.assumed:
            said_of = (
                f"{guess.low:.3g} to {guess.high:.3g}, {guess.source}; {_OPTIONS[key]} gives it"
            )
            if key == "position_m":
                lost = f"; an arm's length{_unsure(frame)}; moments are left out"
            else:
                lost = ""
            assumed.append(Fact(key, guess.value, said_of + lost))
        elif key != "position_m" or frame.ordered:
            known.append(
                Fact(
                    key, guess.value, _OPTIONS[key] if guess.value != frame.arm_m else frame.source
                )
            )
        else:
            assumed.append(
                Fact(key, frame.name, f"{frame.source}{_unsure(frame)}; moments are left out")
            )
    measured: dict[str, Any] = {"hover_thrust": vehicle.hover_thrust, "ct": vehicle.fans[0].ct}
    if vehicle.throttle is not None:
        del measured["ct"]
        measured |= {
            key: getattr(vehicle.throttle, key)
            for key in ("max_thrust_n", "expo", "pwm_max_us", "voltage_v")
        }
    for key, value in measured.items():
        guessed = said[key].startswith((_GUESSED, USUAL_PULSES, COMMON_PROPELLERS))
        (assumed if guessed else known).append(Fact(key, value, said[key]))
    if vehicle.telemetered:
        known.append(Fact("hover_rpm", round(_hover_rpm(vehicle)), "by ct and the mass"))
    if vehicle.rangefinders:
        known.append(
            Fact(
                "rangefinder",
                [r.orientation for r in vehicle.rangefinders],
                "parameters and readings",
            )
        )
    if not any(f.key == "position_m" for f in assumed):
        assumed.append(Fact("inertia_kgm2", list(vehicle.inertia_kgm2), said["inertia_kgm2"]))
    return known, assumed


def _unsure(frame: Airframe) -> str:
    if frame.unsure:
        return f"; {frame.unsure}"
    return ""


def _hover_rpm(vehicle: Vehicle) -> float:
    """Mean rotor speed [rpm] that carries the vehicle: sum(ct) rho A Omega^2 R^2 = m g, A = pi R^2."""
    per_speed2 = (
        sum(fan.ct or 0.0 for fan in vehicle.fans)
        * RHO_SEA_LEVEL
        * math.pi
        * vehicle.rotor_radius_m**4
    )
    return 60.0 / (2.0 * math.pi) * math.sqrt(vehicle.mass_kg * GRAVITY / per_speed2)
