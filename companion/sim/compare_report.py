"""What a comparison of flights found, as the table that a user reads and as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.sim.air import LawError
from companion.sim.flown import AXES, PHASES, UNITS, Flown, Leg
from companion.sim.model_error import WITHOUT_OFFSETS


@dataclass(frozen=True)
class Comparison:
    """Flights of one scenario with one model, and how wrong that model is about the air of each seed."""

    scenario: str
    model: str
    errors: tuple[LawError, ...]
    flights: tuple[Flown, ...]

    @property
    def seeds(self) -> list[int]:
        """In order."""
        return sorted({f.seed for f in self.flights})

    @property
    def legs(self) -> dict[Leg, list[Flown]]:
        """The flights of every leg that was flown."""
        of_leg = {leg: [f for f in self.flights if f.leg is leg] for leg in Leg}
        return {leg: flights for leg, flights in of_leg.items() if flights}

    @property
    def approaches(self) -> int:
        """In each flight."""
        return self.flights[0].approaches

    @property
    def phases(self) -> tuple[str | None, ...]:
        """All of an approach (None), and the phases that this scenario has."""
        return None, *(p for p in PHASES if any(f.during(phase=p).any() for f in self.flights))

    def error(self) -> dict[str, float]:
        """How wrong the model is, mean over the seeds."""
        return {axis: float(np.mean([getattr(e, axis) for e in self.errors])) for axis in ("lift", "pull", "tilt")}


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation over the seeds."""

    mean: float
    sd: float

    @staticmethod
    def of(flights: Sequence[Flown], number: Callable[[Flown], float]) -> Spread:
        """From one number of each flight."""
        finite = [v for v in map(number, flights) if math.isfinite(v)]
        if not finite:
            return Spread(math.nan, math.nan)
        return Spread(float(np.mean(finite)), float(np.std(finite, ddof=1)) if len(finite) > 1 else 0.0)


@dataclass(frozen=True)
class AirPart:
    """How much of the air-caused error the offsets remove, per axis.

    ``energy`` = 1 - (E2_on - E2_free) / (E2_off - E2_free), with E2 summed over the seeds: the trajectory's own error
    cancels on average only, so that it scatters where the air adds little. ``paired`` = 1 - sum |e_on - e_free|^2 /
    sum |e_off - e_free|^2, instant by instant on flights that share their noise: the same question, less scatter.
    """

    energy: dict[str, float]
    paired: dict[str, float]


def air_part(flights: Sequence[Flown], leg: Leg = Leg.ON) -> AirPart | None:
    """Over all seeds that flew OFF, ``leg`` and FREE; None where none did."""
    seeds = sorted({f.seed for f in flights})
    energy = {axis: np.zeros(3) for axis in AXES}
    paired = {axis: np.zeros(2) for axis in AXES}
    used = 0
    for seed in seeds:
        by = {f.leg: f for f in flights if f.seed == seed}
        if not {Leg.OFF, leg, Leg.FREE} <= set(by):
            continue
        used += 1
        off, on, free = by[Leg.OFF], by[leg], by[Leg.FREE]
        n = min(len(off.time_s), len(on.time_s), len(free.time_s))
        for axis in AXES:
            energy[axis] += [f.rms(axis) ** 2 for f in (off, on, free)]
            a, b, c = (getattr(f, axis)[:n] for f in (off, on, free))
            paired[axis] += [float(np.sum((a - c) ** 2)), float(np.sum((b - c) ** 2))]
    if not used:
        return None
    return AirPart(
        energy={a: float(1.0 - (e[1] - e[2]) / (e[0] - e[2])) if e[0] > e[2] else math.nan for a, e in energy.items()},
        paired={a: float(1.0 - p[1] / p[0]) if p[0] > 0.0 else math.nan for a, p in paired.items()},
    )


# -- JSON ------------------------------------------------------------------------------------------------------------


def as_json(found: Comparison) -> dict[str, Any]:
    """Everything the tables show: RMS and peak per leg and axis, mean and sd over the seeds; RMS by phase."""
    parts = {leg.name.lower(): air_part(found.flights, leg) for leg in (Leg.ON, Leg.ADAPTED)}
    return {
        "scenario": found.scenario,
        "simulated": True,
        "lockstep": True,
        "seeds": found.seeds,
        "units": UNITS,
        "model": found.model,
        "model_error": {**found.error(), "without_offsets": WITHOUT_OFFSETS},
        "legs": {leg.name.lower(): _leg_json(leg, flights, found) for leg, flights in found.legs.items()},
        "air_caused_part_removed": {name: _part_json(part) for name, part in parts.items() if part is not None},
        "flights": [_flight_json(f, found) for f in found.flights],
    }


def _leg_json(leg: Leg, flights: Sequence[Flown], found: Comparison) -> dict[str, Any]:
    of_axis = {
        axis: {
            "rms": vars(Spread.of(flights, lambda f, axis=axis: f.rms(axis))),  # type: ignore[misc]
            "peak": vars(Spread.of(flights, lambda f, axis=axis: f.peak(axis))),  # type: ignore[misc]
        }
        for axis in AXES
    }
    touched = Spread.of(flights, lambda f: f.touched_s).mean
    return {"who": leg.value, "touched_s": touched, **of_axis, "approaches": _approaches_json(flights, found)}


def _flight_json(flight: Flown, found: Comparison) -> dict[str, Any]:
    of_axis = {axis: {"rms": round(flight.rms(axis), 3), "peak": round(flight.peak(axis), 3)} for axis in AXES}
    return {
        "seed": flight.seed,
        "leg": flight.leg.name.lower(),
        "touched_s": round(flight.touched_s, 2),
        **of_axis,
        "approaches": _approaches_json([flight], found),
        **({"adapted": dict(flight.adapted)} if flight.adapted else {}),
    }


def _approaches_json(flights: Sequence[Flown], found: Comparison) -> list[dict[str, Any]]:
    """Of each approach {phase: {axis: RMS}}, mean over the flights."""
    return [
        {
            phase or "all": {a: _rounded(_rms(flights, a, k, phase)) for a in ("height", "lateral")}
            for phase in found.phases
        }
        for k in range(1, found.approaches + 1)
    ]


def _rounded(value: float, digits: int = 3) -> float | None:
    """None for what is not known."""
    return None if math.isnan(value) else round(value, digits)


def _part_json(part: AirPart) -> dict[str, Any]:
    return {
        name: {a: _rounded(v, 4) for a, v in values.items()}
        for name, values in (("energy", part.energy), ("paired", part.paired))
    }


def _rms(flights: Sequence[Flown], axis: str, approach: int, phase: str | None) -> float:
    return Spread.of(flights, lambda f: f.rms(axis, f.during(approach, phase))).mean


# -- text ------------------------------------------------------------------------------------------------------------

_NAME, _CELL = 28, 14
"""Characters of a row's name and of a phase's column."""


def as_text(found: Comparison) -> str:
    """The tables that a user reads."""
    seeds, wide = found.seeds, len(found.seeds) > 1
    wrong = ", ".join(f"{100.0 * share:.0f} % in {axis}" for axis, share in found.error().items())
    of = f"{found.approaches} approaches" if found.approaches > 1 else "one approach"
    column = 13 if wide else 9
    lines = [
        f"sim:{found.scenario}, simulated, {of} in {found.flights[0].time_s[-1]:.0f} s, "
        + (f"{len(seeds)} seeds, mean ± sd" if wide else f"seed {seeds[0]}")
        + "; errors against the truth",
        f"model: {found.model}, wrong about this air by {wrong}; no offsets: {100.0 * WITHOUT_OFFSETS:.0f} % in each",
        "",
        " " * _NAME + "".join(f"{axis + ' [' + UNITS[axis] + ']':>{2 * column}}" for axis in AXES),
        " " * _NAME + "".join(f"{'RMS':>{column}}{'peak':>{column}}" for _ in AXES) + "  touched",
    ]
    lines += [_leg_line(leg, flights, column, wide) for leg, flights in found.legs.items()]
    lines += ["", f"{'RMS height / lateral [mm]':{_NAME}}" + "".join(f"{p or 'all':>{_CELL}}" for p in found.phases)]
    for leg, flights in found.legs.items():
        lines += _phase_lines(leg, flights, found)
    for leg, words in ((Leg.ON, "the offsets remove"), (Leg.ADAPTED, "the adapted offsets remove")):
        part = air_part(found.flights, leg)
        if part is not None:
            lines += ["", f"of the error that the air causes, {words}"]
            lines += [_part_line("by energy", part.energy), _part_line("instant by instant", part.paired)]
    return "\n".join(lines)


def _leg_line(leg: Leg, flights: Sequence[Flown], column: int, wide: bool) -> str:
    cells = ""
    for axis in AXES:
        digits = 2 if axis == "tilt" else 0 if wide else 1
        for number in (Flown.rms, Flown.peak):
            s = Spread.of(flights, lambda f, number=number, axis=axis: number(f, axis))  # type: ignore[misc]
            cell = f"{s.mean:.{digits}f} ± {s.sd:.{digits}f}" if wide else f"{s.mean:.{digits}f}"
            cells += f"{cell:>{column}}"
    touched = Spread.of(flights, lambda f: f.touched_s).mean
    return f"{leg.value:{_NAME}}{cells}{f'{touched:.1f} s' if touched > 0.05 else '-':>9}"


def _phase_lines(leg: Leg, flights: Sequence[Flown], found: Comparison) -> list[str]:
    """One line of an approach; several approaches stand under the leg's name."""
    single = found.approaches == 1
    out = [] if single else [leg.value]
    for k in range(1, found.approaches + 1):
        cells = [[_rms(flights, axis, k, phase) for axis in ("height", "lateral")] for phase in found.phases]
        row = "".join(f"{f'{height:.1f} / {lateral:.1f}':>{_CELL}}" for height, lateral in cells)
        out.append(f"{leg.value if single else f'  approach {k}':{_NAME}}{row}")
    return out


def _part_line(name: str, shares: Mapping[str, float]) -> str:
    cells = "".join(f"{axis} {100 * v:.0f} %   " if math.isfinite(v) else f"{axis} -   " for axis, v in shares.items())
    return f"  {name:20}{cells}".rstrip()
