"""A vehicle drafted from logs: what their parameters and outputs say, what a hover measures, what is typical.

Thrust comes through the hover: the rotors carry the weight, so ct or the throttle curve follows from the mass. Every
force is then known as a share of the weight, whatever the mass is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from companion.vehicles import default_vehicle
from models.errors import ConfigError, LogError
from models.vehicle import Rangefinder, Vehicle
from models.vehicle_plausibility import Severity, findings
from models.vehicle_setup.estimate import Guess, typical_sizes
from models.vehicle_setup.setup import COMMON_PROPELLERS, USUAL_PULSES, Answers, build, parameter_ranges, target_of
from models.vehicle_setup.toml_text import vehicle_text
from models.vehicle_types import ASSUMABLE
from replay.flightlog import FlightLog
from replay.logs.formats import read_pieces
from replay.residual.record import Record, build_record
from replay.vehicle.airframe import Airframe, airframe, turns
from replay.vehicle.fit import ENOUGH_S, Fit, fit_records, free_flight, hovering, records_of

INCH_M = 0.0254
_OPTIONS = {"mass_kg": "--mass KG", "rotor_radius_m": "--propeller INCH", "position_m": "--span M"}
TANDEM = "the paper's tandem"
_VANES, _NEUTRAL_US, _DEFLECTED_US = (5, 6), 1500.0, 250.0
"""Outputs of the tandem's vanes, and how they move."""
_SAME_US = 2.0
"""The two rotors of a coaxial fan of the tandem get one output; they differ by rounding."""
_STRETCHES = 8
"""So many are enough for a hover; of a long log one is 32 MiB."""
_VOLTAGE_V = 15.0
"""Of a log without battery: nothing depends on it then."""


@dataclass(frozen=True)
class Given:
    """What the command line says."""

    mass_kg: float | None = None
    propeller_m: float | None = None
    """Diameter."""
    span_m: float | None = None
    """Motor axis to the opposite motor's axis."""


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
        value = f"{self.value:.4g}" if isinstance(self.value, float) else str(self.value)
        return f"{self.key} {value}: {self.source}"


@dataclass(frozen=True)
class Draft:
    """A vehicle, and where each of its numbers comes from."""

    vehicle: Vehicle
    known: tuple[Fact, ...]
    assumed: tuple[Fact, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        facts = {"known": self.known, "assumed": self.assumed}
        return {"drafted": True, **{name: [f.as_json() for f in some] for name, some in facts.items()}}

    def as_toml(self) -> str:
        """A vehicle file, with where each number comes from."""
        origin = {f.key: f.source for f in (*self.known, *self.assumed)}
        return vehicle_text(self.vehicle, origin, "Drafted from a log. Every key: docs/vehicle.md. SI units, body FRD.")


def draft(paths: Sequence[Path], given: Given, target_system: int | None = None) -> Draft:
    """The vehicle that flew in all these logs.

    Raises LogError where it cannot be said, ConfigError where the logs are of two vehicles or a number is impossible.
    """
    logs = _flown(paths, target_system)
    parameters = {key: value for log in reversed(logs) for key, value in log.parameters.items()}
    logs = [log for log in logs if turns(log)] or logs  # what stood on the bench lends its parameters alone
    tandem = [_is_tandem(log) for log in logs]
    if all(tandem):
        return _tandem(given)
    frames = [airframe(log) for log in logs]
    _refuse_two(logs, [TANDEM if t else f.name for t, f in zip(tandem, frames, strict=True)], frames)
    return _Drawer(paths, target_system, logs, parameters, given).draft()


def _refuse_two(logs: Sequence[FlightLog], names: Sequence[str], frames: Sequence[Airframe]) -> None:
    """A frame that a log does not say by parameters may be that of another log."""
    sure = next((k for k, f in enumerate(frames) if f.declared or names[k] == TANDEM), 0)
    for log, name, frame in zip(logs, names, frames, strict=True):
        differs = name != names[sure] and (frame.declared or TANDEM in (name, names[sure]))
        if differs or len(frame.motors) != len(frames[sure].motors):
            raise ConfigError(
                f"{logs[sure].path} and {log.path} are of two vehicles ({names[sure]}; {name}): diagnose them one by "
                "one, or give --vehicle"
            )
        if frame.telemetered != frames[0].telemetered:
            raise ConfigError(
                f"{logs[0].path} and {log.path}: one holds rotor speeds and the other only outputs; diagnose them one "
                "by one, or give --vehicle"
            )


def _flown(paths: Sequence[Path], target_system: int | None) -> list[FlightLog]:
    """Of every log that can be read the first stretch in which it was armed, or the first one."""
    out, problems = [], []
    for path in paths:
        first = None
        try:
            for piece in read_pieces(path, target_system):
                first = first or piece
                if piece.log.armed:
                    first = piece
                    break
        except LogError as error:
            problems.append(error)
        if first is not None:
            out.append(first.own())
    if not out:
        raise problems[0]
    return out


def _is_tandem(log: FlightLog) -> bool:
    """Whether its outputs are those of the paper's tandem: two pairs that get one output each, and two vanes.

    A log that says its frame by parameters is of another vehicle.
    """
    if log.servo is None or {"FRAME_CLASS", "FRAME", "CA_AIRFRAME", "CA_ROTOR_COUNT"} & set(log.parameters):
        return False
    outputs = log.servo.values[(log.servo.values[:, :6] > 0.0).all(axis=1)]
    if len(outputs) < 0.5 * len(log.servo):
        return False
    pairs = np.abs(outputs[:, [0, 2]] - outputs[:, [1, 3]]).max() <= _SAME_US
    vanes = outputs[:, [n - 1 for n in _VANES]]
    moved = np.ptp(vanes, axis=0).min() > 0.0 and np.abs(vanes - _NEUTRAL_US).max() < _DEFLECTED_US
    return bool(pairs and moved)


def _tandem(given: Given) -> Draft:
    if given.propeller_m is not None or given.span_m is not None:
        raise ConfigError(
            "--propeller, --span: the log is of the paper's tandem, whose sizes are known; leave them out"
        )
    vehicle = default_vehicle()
    if given.mass_kg is not None:
        vehicle = replace(vehicle, mass_kg=given.mass_kg)
    return Draft(vehicle, (Fact("name", vehicle.name, f"outputs 1 to 4 in pairs, vanes on 5 and 6: {TANDEM}"),))


class _Drawer:
    """Draws one vehicle."""

    def __init__(
        self, paths: Sequence[Path], target: int | None, logs: Sequence[FlightLog], parameters: dict[str, float],
        given: Given,
    ) -> None:  # fmt: skip
        self._paths, self._target, self._logs, self._given = paths, target, logs, given
        self._parameters = parameters
        self._frame = frame = airframe(replace(logs[0], parameters=parameters))
        radius = None if given.propeller_m is None else given.propeller_m / 2.0
        arm = frame.arm_m if given.span_m is None else given.span_m / 2.0
        self._mass, self._radius, self._arm = typical_sizes(given.mass_kg, radius, arm, frame.motors, self._rpm())

    def draft(self) -> Draft:
        """The vehicle and its facts."""
        start, said = build(self._answers())
        found, how = self._measured(start)
        hover, source = self._hover(found, said["hover_thrust"], how)
        said |= {e.key: f"measured in {how}" for e in found.estimates} | {"hover_thrust": source}
        sizes = {"mass_kg": self._mass, "rotor_radius_m": self._radius, "position_m": self._arm}
        assumed = [self._assumed(key, guess) for key, guess in sizes.items() if guess.assumed]
        curve = start.throttle
        if curve is not None and said["expo"] == COMMON_PROPELLERS:
            assumed.append(Fact("expo", curve.expo, f"0.4 to 0.9, {COMMON_PROPELLERS}"))
        if curve is not None and said["pwm_max_us"] == USUAL_PULSES:
            assumed.append(Fact("pwm_max_us", curve.pwm_max_us, f"from {curve.pwm_min_us:g}, {USUAL_PULSES}"))
        if not self._frame.ordered and not self._arm.assumed:
            assumed.append(Fact("position_m", self._frame.name, f"{self._frame.source}; moments are left out"))
        vehicle = replace(
            found.vehicle, hover_thrust=hover, assumed=tuple(f.key for f in assumed if f.key in ASSUMABLE)
        )
        wrong = next((f for f in findings(vehicle) if f.severity is Severity.ERROR), None)
        if wrong is not None:
            raise ConfigError(f"the drafted vehicle cannot be: {wrong.key} {wrong.text}")
        if "position_m" not in vehicle.assumed:
            assumed.append(Fact("inertia_kgm2", list(vehicle.inertia_kgm2), said["inertia_kgm2"]))
        return Draft(vehicle, tuple(self._known(vehicle, said)), tuple(assumed))

    def _rpm(self) -> float | None:
        """Median rotor speed of the logs, rotors that stand still left out."""
        escs = [log.escs[n].rpm for log in self._logs for n in self._frame.numbers.values() if n in log.escs]
        turning = [rpm.values[rpm.values > 0.0] for rpm in escs if rpm is not None] if self._frame.telemetered else []
        medians = [float(np.median(values)) for values in turning if values.size]
        return float(np.median(medians)) if medians else None

    def _answers(self) -> Answers:
        voltages = [log.battery.values[:, 0] for log in self._logs if log.battery is not None]
        voltage = np.concatenate([v[np.isfinite(v)] for v in voltages]) if voltages else np.zeros(0)
        return Answers(
            name=f"{self._frame.name}, drafted from {self._logs[0].path.name}",
            mass_kg=self._mass.value, propeller_m=2.0 * self._radius.value, motors=self._frame.motors,
            numbers=self._frame.numbers, arm_m=self._arm.value, rotor_down_m=0.0, telemetered=self._frame.telemetered,
            voltage_v=round(float(np.median(voltage)), 2) if voltage.size else _VOLTAGE_V,
            ranges=tuple(self._ranges()), parameters=self._parameters,
        )  # fmt: skip

    def _ranges(self) -> Iterator[Rangefinder]:
        """Those of the parameters, and those that are in a log besides."""
        declared = parameter_ranges(self._parameters)
        yield from declared
        seen = {r.orientation for r in declared}
        for beam in (b for log in self._logs for b in log.beams):
            if beam.orientation not in seen and beam.name != "other":
                seen.add(beam.orientation)
                yield Rangefinder(beam.orientation, target_of(beam.orientation), (0.0, 0.0, 0.0))

    def _measured(self, start: Vehicle) -> tuple[Fit, str]:
        """Thrust by free hover; where there is too little, by all free flight, then by all flight."""
        records = list(self._records(start))
        ways = (
            (hovering, "free hover"),
            (free_flight, "free flight"),
            (lambda record: record.valid, "the whole flight"),
        )
        for rows, how in ways:
            if sum(rows(r).sum() * r.step_s for r in records) >= ENOUGH_S or how == ways[-1][1]:
                break
        return fit_records(records, start, start, rows, bend=False), how

    def _records(self, start: Vehicle) -> Iterator[Record]:
        """Of the stretches that are read already; where none of them can be judged, of later ones."""
        problems: list[LogError] = []
        judged = 0
        for log in self._logs:
            try:
                yield build_record(log, start, None)
                judged += 1
            except LogError as error:
                problems.append(error)
        if not judged:
            later = (r for path in self._paths for r in records_of(path, start, self._target, problems))
            for record in islice(later, _STRETCHES):
                yield record
                judged += 1
        if not judged:
            raise problems[0]

    def _hover(self, found: Fit, said: str, how: str) -> tuple[float, str]:
        """ArduPilot learns MOT_THST_HOVER in flight; PX4's MPC_THR_HOVER is what somebody typed in."""
        measured = {e.key for e in found.estimates}
        if said == "MOT_THST_HOVER":
            return round(self._parameters[said], 3), said
        if "hover_thrust" in measured:
            return found.vehicle.hover_thrust, f"measured in {how}"
        if math.isfinite(found.output):
            return round(found.output, 3), f"mean output in {how}"
        return found.vehicle.hover_thrust, said

    def _assumed(self, key: str, guess: Guess) -> Fact:
        also = "; moments are left out" if key == "position_m" else ""
        name = {"position_m": "arm of "}.get(key, "")
        text = f"{name}{guess.low:.3g} to {guess.high:.3g}, {guess.source}; {_OPTIONS[key]} gives it{also}"
        return Fact(key, guess.value, text)

    def _known(self, vehicle: Vehicle, said: dict[str, str]) -> Iterator[Fact]:
        frame = self._frame
        yield Fact("frame", frame.name, frame.source)
        kind = "ESC numbers" if frame.telemetered else "outputs"
        yield Fact("rotors", [r.esc or r.servo for r in vehicle.rotors], f"{kind} in the log")
        options = {
            "mass_kg": self._given.mass_kg,
            "rotor_radius_m": self._given.propeller_m,
            "position_m": self._given.span_m,
        }
        for key, value in options.items():
            if value is not None:
                yield Fact(key, getattr(vehicle, key, value / 2.0), f"{_OPTIONS[key].split()[0]}")
        yield Fact("hover_thrust", vehicle.hover_thrust, said["hover_thrust"])
        if vehicle.throttle is None:
            yield Fact("ct", vehicle.fans[0].ct, said["ct"])
        else:
            for key in ("max_thrust_n", "expo", "pwm_max_us", "voltage_v"):
                if said[key] not in (COMMON_PROPELLERS, USUAL_PULSES):
                    yield Fact(key, getattr(vehicle.throttle, key), said[key])
        if vehicle.rangefinders:
            yield Fact("rangefinder", [r.orientation for r in vehicle.rangefinders], "parameters and readings")
