"""What a comparison of flights found, as the table that a user reads and as JSON."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.sim.air import LawError
from companion.sim.flown import AXES, PHASES, UNITS, Flown, Leg
from companion.sim.model_error import WITHOUT_OFFSETS

OFFSETS = {Leg.ON: "the offsets remove", Leg.ADAPTED: "the adapted offsets remove"}
"""Legs with offsets, as a table says it of them."""
SCATTER = {"height": 0.14, "lateral": 0.2, "tilt": 0.03}
"""Standard deviation between seeds of the error in free air, as a share of it (seeds 61 to 66, docs/results.md)."""
PHASE_SCATTER_MM = 3.0
"""Standard deviation between seeds of the height's RMS in one phase in free air (seeds 61 to 68)."""
_READING = (
    "touched: time in contact with ground or wall. In free air: what the path itself costs, with",
    "neither ground nor wall: about the best that offsets can do. --seed N flies another one.",
)
_ONE_SEED = (
    "From seed to seed the height of one phase differs by "
    f"{PHASE_SCATTER_MM:.0f} mm (1 sd) in free air:",
    "one flight does not tell rows apart that are closer than twice that.",
)
WAYS = {"energy": "by energy", "paired": "instant by instant"}
"""How the share of the error that the offsets remove is taken (see ``air_part``)."""


@dataclass(frozen=True)
class LegComparison:
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
        out = {}
        for leg in Leg:
            flights = [f for f in self.flights if f.leg is leg]
            if flights:
                out[leg] = flights
        return out

    @property
    def approaches(self) -> range:
        """In each flight, from 1."""
        return range(1, self.flights[0].approaches + 1)

    @property
    def phases(self) -> tuple[str | None, ...]:
        """All of an approach (None), and the phases that this scenario has."""
        out: list[str | None] = [None]
        for phase in PHASES:
            if any(f.during(phase=phase).any() for f in self.flights):
                out.append(phase)
        return tuple(out)

    def error(self) -> dict[str, float]:
        """How wrong the model is, mean over the seeds."""
        out = {}
        for axis in ("lift", "pull", "tilt"):
            out[axis] = float(np.mean([getattr(e, axis) for e in self.errors]))
        return out


def spread(flights: Sequence[Flown], number: Callable[[Flown], float]) -> tuple[float, float]:
    """Mean and standard deviation over the seeds, of one number of each flight."""
    finite = [v for v in map(number, flights) if math.isfinite(v)]
    if not finite:
        return math.nan, math.nan
    mean = float(np.mean(finite))
    if len(finite) == 1:
        return mean, 0.0
    return mean, float(np.std(finite, ddof=1))


def resolved(flights: Sequence[Flown], axis: str) -> bool:
    """Whether the error that the air causes stands out of what flights in free air differ by between seeds."""
    seeds = len({f.seed for f in flights})
    off, free = _off_and_free(flights, axis)
    return off - free > 2.0 * SCATTER[axis] * free / math.sqrt(seeds)


def _off_and_free(flights: Sequence[Flown], axis: str) -> tuple[float, float]:
    """RMS of an axis without offsets and in free air, mean over the seeds."""
    off = [flight for flight in flights if flight.leg is Leg.OFF]
    free = [flight for flight in flights if flight.leg is Leg.FREE]
    return _rms(off, axis), _rms(free, axis)


def air_part(flights: Sequence[Flown], leg: Leg = Leg.ON) -> dict[str, dict[str, float]] | None:
    """How much of the air-caused error the offsets of ``leg`` remove, per axis, over all seeds that flew it, OFF and
    FREE; None where none did.

    ``energy`` = 1 - (E2_on - E2_free) / (E2_off - E2_free), with E2 summed over the seeds: the trajectory's own error
    cancels on average only, so that it scatters where the air adds little. ``paired`` = 1 - sum |e_on - e_free|^2 /
    sum |e_off - e_free|^2, instant by instant on flights that share their noise: the same question, less scatter.
    """
    compared = (Leg.OFF, leg, Leg.FREE)
    trios = []
    for seed in sorted({f.seed for f in flights}):
        by_leg = {f.leg: f for f in flights if f.seed == seed}
        if set(compared) <= set(by_leg):
            trios.append([by_leg[one] for one in compared])
    if not trios:
        return None
    energy = {}
    paired = {}
    for axis in AXES:
        energy[axis] = _share_of_energy(trios, axis)
        paired[axis] = _share_of_pairs(trios, axis)
    return {"energy": energy, "paired": paired}


def _share_of_energy(trios: Sequence[Sequence[Flown]], axis: str) -> float:
    """Of flights (off, on, free) of each seed; NaN where the air adds nothing."""
    squares = []
    for trio in trios:
        squares.append([flight.rms(axis) ** 2 for flight in trio])
    off, on, free = np.sum(squares, axis=0)
    if off > free:
        return float(1.0 - (on - free) / (off - free))
    return math.nan


def _share_of_pairs(trios: Sequence[Sequence[Flown]], axis: str) -> float:
    """The same, instant by instant."""
    by_air = 0.0
    left = 0.0
    for trio in trios:
        shortest = min(len(flight.time_s) for flight in trio)
        off, on, free = [getattr(flight, axis)[:shortest] for flight in trio]
        by_air += float(np.sum((off - free) ** 2))
        left += float(np.sum((on - free) ** 2))
    if by_air > 0.0:
        return 1.0 - left / by_air
    return math.nan


def _rms(
    flights: Sequence[Flown], axis: str, approach: int | None = None, phase: str | None = None
) -> float:
    """Mean over the flights: whole, or of one approach, or of a phase of it."""
    mean, _ = spread(flights, lambda flight: flight.rms(axis, flight.during(approach, phase)))
    return mean


# -- JSON ------------------------------------------------------------------------------------------------------------


def as_json(found: LegComparison) -> dict[str, Any]:
    """Everything the tables show: RMS and peak per leg and axis, mean and sd over the seeds; RMS by phase."""
    removed = {}
    for leg in OFFSETS:
        part = air_part(found.flights, leg)
        if part is not None:
            removed[leg.name.lower()] = {way: _all_rounded(part[way]) for way in part}
    legs = {}
    for leg, flights in found.legs.items():
        legs[leg.name.lower()] = _leg_json(leg, flights, found)
    return {
        "scenario": found.scenario,
        "simulated": True,
        "lockstep": True,
        "seeds": found.seeds,
        "units": UNITS,
        "model": found.model,
        "model_error": {**found.error(), "without_offsets": WITHOUT_OFFSETS},
        "legs": legs,
        "air_caused_part_removed": removed,
        "flights": [_flight_json(flight, found) for flight in found.flights],
    }


def _leg_json(leg: Leg, flights: Sequence[Flown], found: LegComparison) -> dict[str, Any]:
    touched_s, _ = spread(flights, lambda flight: flight.touched_s)
    out: dict[str, Any] = {"who": leg.value, "touched_s": touched_s}
    for axis in AXES:
        out[axis] = {}
        for name in ("rms", "peak"):
            mean, sd = spread(flights, operator.methodcaller(name, axis))
            out[axis][name] = {"mean": mean, "sd": sd}
    out["approaches"] = _approaches_json(flights, found)
    return out


def _flight_json(flight: Flown, found: LegComparison) -> dict[str, Any]:
    out: dict[str, Any] = {
        "seed": flight.seed,
        "leg": flight.leg.name.lower(),
        "touched_s": round(flight.touched_s, 2),
    }
    for axis in AXES:
        out[axis] = {"rms": round(flight.rms(axis), 3), "peak": round(flight.peak(axis), 3)}
    out["approaches"] = _approaches_json([flight], found)
    if flight.adapted:
        out["adapted"] = dict(flight.adapted)
    return out


def _approaches_json(flights: Sequence[Flown], found: LegComparison) -> list[dict[str, Any]]:
    """Of each approach {phase: {axis: RMS}}, mean over the flights."""
    out = []
    for k in found.approaches:
        approach: dict[str, dict[str, float | None]] = {}
        for phase in found.phases:
            height = _rms(flights, "height", k, phase)
            lateral = _rms(flights, "lateral", k, phase)
            approach[phase or "all"] = {"height": _rounded(height), "lateral": _rounded(lateral)}
        out.append(approach)
    return out


def _all_rounded(shares: Mapping[str, float]) -> dict[str, float | None]:
    return {axis: _rounded(share, 4) for axis, share in shares.items()}


def _rounded(value: float, digits: int = 3) -> float | None:
    """None for what is not known."""
    if math.isnan(value):
        return None
    return round(value, digits)


# -- text ------------------------------------------------------------------------------------------------------------

_NAME = 28
_CELL = 14
"""Characters of a row's name and of a phase's column."""


def as_text(found: LegComparison) -> str:
    """The tables that a user reads."""
    wide = len(found.seeds) > 1
    wrong = ", ".join(f"{100.0 * share:.0f} % in {axis}" for axis, share in found.error().items())
    lines = [
        _what_flew(found),
        f"model: {found.model}, wrong about this air by {wrong}; no offsets: "
        f"{100.0 * WITHOUT_OFFSETS:.0f} % in each",
        "",
        *_leg_table(found, wide),
        "",
        *_phase_table(found),
        *_shares(found),
        "",
        *_READING,
    ]
    if not wide:
        lines += _ONE_SEED
    return "\n".join(lines)


def _what_flew(found: LegComparison) -> str:
    """The first line: scenario, length and seeds."""
    approaches = "one approach"
    if len(found.approaches) > 1:
        approaches = f"{len(found.approaches)} approaches"
    seeds = f"seed {found.seeds[0]}"
    if len(found.seeds) > 1:
        seeds = f"{len(found.seeds)} seeds, mean ± sd"
    length_s = found.flights[0].time_s[-1]
    return (
        f"sim:{found.scenario}, simulated, {approaches} in {length_s:.0f} s, {seeds}; errors "
        "against the truth"
    )


def _leg_table(found: LegComparison, wide: bool) -> list[str]:
    """RMS and peak of each leg."""
    column = 13 if wide else 9
    axes = " " * _NAME
    numbers = " " * _NAME
    for axis in AXES:
        axes += f"{f'{axis} [{UNITS[axis]}]':>{2 * column}}"
        numbers += f"{'RMS':>{column}}{'peak':>{column}}"
    lines = [axes, f"{numbers}  touched"]
    for leg, flights in found.legs.items():
        lines.append(_leg_line(leg, flights, column, wide))
    return lines


def _phase_table(found: LegComparison) -> list[str]:
    """RMS of each leg by phase, approach by approach where there are several."""
    head = f"{'RMS height / lateral [mm]':{_NAME}}"
    for phase in found.phases:
        head += f"{phase or 'all':>{_CELL}}"
    lines = [head]
    several = len(found.approaches) > 1
    for leg, flights in found.legs.items():
        if several:
            lines.append(leg.value)
        for k in found.approaches:
            line = f"{f'  approach {k}' if several else leg.value:{_NAME}}"
            for phase in found.phases:
                height = _rms(flights, "height", k, phase)
                lateral = _rms(flights, "lateral", k, phase)
                line += f"{f'{height:.1f} / {lateral:.1f}':>{_CELL}}"
            lines.append(line)
    return lines


def _shares(found: LegComparison) -> list[str]:
    """How much of the error that the air causes each leg with offsets removes."""
    lines = []
    clear = [axis for axis in AXES if resolved(found.flights, axis)]
    for leg, words in OFFSETS.items():
        part = air_part(found.flights, leg)
        if part is not None:
            lines += ["", f"of the error that the air causes, {words}"]
            for way, shares in part.items():
                lines.append(_part_line(WAYS[way], shares, clear))
            for axis in AXES:
                if axis not in clear:
                    lines.append(_unclear_line(found, axis))
    return lines


def _leg_line(leg: Leg, flights: Sequence[Flown], column: int, wide: bool) -> str:
    cells = ""
    for axis in AXES:
        digits = 0 if wide else 1
        if axis == "tilt":
            digits = 2
        for number in ("rms", "peak"):
            mean, sd = spread(flights, operator.methodcaller(number, axis))
            cell = f"{mean:.{digits}f}"
            if wide:
                cell += f" ± {sd:.{digits}f}"
            cells += f"{cell:>{column}}"
    touched_s, _ = spread(flights, lambda f: f.touched_s)
    touched = f"{touched_s:.1f} s" if touched_s > 0.05 else "-"
    return f"{leg.value:{_NAME}}{cells}{touched:>9}"


def _part_line(name: str, shares: Mapping[str, float], clear: Sequence[str]) -> str:
    cells = ""
    for axis in clear:
        share = shares[axis]
        if math.isfinite(share):
            cells += f"{axis} {100 * share:.0f} %   "
    return f"  {name:20}{cells}".rstrip()


def _unclear_line(found: LegComparison, axis: str) -> str:
    """What is said of an axis in which the air hardly adds to what the path costs."""
    off, free = _off_and_free(found.flights, axis)
    return (
        f"  {axis}: no share: with and without the air it is {off:.2f} and {free:.2f} "
        f"{UNITS[axis]}, which these flights do not tell apart"
    )
