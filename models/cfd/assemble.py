"""From cases to a data set: one label a position, the speed axis by a fitted law, every row marked with its making."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.cfd.campaign import Row
from models.cfd.config import Setup
from models.cfd.fidelity import FREE, Correction, learn
from models.cfd.grid import spread
from models.cfd.position import Place, Position
from models.cfd.table import UNITS
from models.dataset import COLUMNS
from models.errors import ModelError
from models.frames import AXES, Array

# By the mirror plane through axis and wall normal, without swirl.
ODD = np.array([False, True, False, True, False, True])
# Without a wall the fan stands on an axis of symmetry: no side force, no tilt.
TILT = np.array([True, True, False, True, True, False])
# Variance [N^2, N^2 m^2] far below that of any row, so that two exact ones can be weighted.
TINY = 1e-12
# Worst first.
LABELLED = ("cycling", "drifting", "averaged", "marched", "steady")


@dataclass(frozen=True)
class Label:
    """What a position is labelled with, wrench and amplitude (6,) in N and N m.

    ``amplitude`` is what the label leaves out: half the difference of two states, or the swing of a flow that never
    stands still. ``error`` is that of the mean: by block averages, where they were taken; else the amplitude.
    ``status`` of the worst case that went in; ``starts`` their number.
    """

    wrench: Array
    amplitude: Array
    error: Array
    status: str
    starts: int


@dataclass(frozen=True)
class Law:
    """Increments over free air grow as (rpm / reference)^(2 + exponent), exponent (6,) by component.

    ``error`` (6,) is the standard deviation of an exponent over the positions; ``left`` (6,) the rms of what the law
    leaves at the solved positions, in N and N m at the reference speed; ``positions`` their number. ``free`` is the
    exponent of the free fan's lift.
    """

    reference_rpm: float
    exponent: Array
    error: Array
    left: Array
    positions: int
    free: float


@dataclass(frozen=True)
class Mark:
    """How a row was made; ``amplitude``, ``scatter`` and ``sigma`` (6,) in N and N m.

    ``scatter``: error of the flow's mean and of the mesh, which differs from row to row. ``sigma``: with it what full
    models differ by where none was solved, and what the law of rotor speed leaves.

    ``even`` (Fx, Fz, My): ``solved`` in a full model with swirl (``solved_NAME``: of a variant of the fan), where it
    swings weighted with what ``corrected`` gives without it;
    ``corrected``: a half model and what full models add, learnt at other positions; ``half``: a half model alone;
    ``law``: from the campaign's speed by the law of rotor speed. ``odd`` (Fy, Mx, Mz): ``solved`` in a full model at
    that speed, ``law``, ``filled`` by what is learnt at other positions, or zero by the ``symmetry`` of half models.
    Components for which nothing can be learnt are those of the half model in every row.
    """

    even: str
    odd: str
    status: str
    starts: int
    amplitude: Array
    scatter: Array
    sigma: Array


@dataclass(frozen=True)
class Assembled:
    """Rows of the data set, ``table`` (n, 9) in the columns of docs/formats.md, and a mark for each."""

    table: Array
    marks: tuple[Mark, ...]
    law: Law
    correction: Correction


Kind = tuple[str, float, str]
"""Model, level of the mesh and variant."""
HALF: Kind = ("half", 1.0, "")


def kind_of(position: Position) -> Kind:
    """Kind of a case."""
    return position.model, position.level, position.variant


def full_kind(rows: Sequence[Row], rpm: float) -> Kind:
    """The kind of full model that was computed at most positions; the fan itself where two are equal."""
    places: dict[Kind, set[Place]] = {}
    for row in rows:
        if row.position.model == "full" and row.position.rpm == rpm and row.result.status in LABELLED:
            places.setdefault(kind_of(row.position), set()).add(row.position.place)
    return max(places, key=lambda kind: (len(places[kind]), not kind[2], kind[1]), default=("full", 1.0, ""))


def labels(rows: Sequence[Row], rpm: float, kind: Kind = HALF) -> dict[Place, Label]:
    """The label of every position computed in one kind of case at one speed; diverged cases give none."""
    out: dict[Place, Label] = {}
    found: dict[Place, list[Row]] = {}
    for row in rows:
        p = row.position
        if kind_of(p) == kind and p.rpm == rpm and row.result.status in LABELLED:
            found.setdefault(p.place, []).append(row)
    for place, states in found.items():
        wrenches = np.array([r.result.wrench for r in states])
        # A drift dies out over about a hundred iterations, twice the span it is taken over.
        swing = np.max([np.maximum(r.result.swing, 2 * np.array(r.result.drift)) for r in states], axis=0)
        apart = np.ptp(wrenches, axis=0) / 2
        amplitude = np.maximum(apart, swing)
        means = np.array([r.result.error for r in states])
        error = np.maximum(apart, np.where(np.isnan(means).any(axis=0), swing, means.max(axis=0)))
        wrench = np.where(ODD & (kind[0] == "half"), 0.0, wrenches.mean(axis=0))
        if math.isinf(place[1]):
            # The mirrored state is a solution as well: the mean of the two is zero, half their difference the state.
            amplitude = np.where(TILT, np.maximum(np.abs(wrench), amplitude), amplitude)
            error = np.where(TILT, np.maximum(np.abs(wrench), error), error)
            wrench = np.where(TILT, 0.0, wrench)
        found_status = {r.result.status for r in states}
        status = next(s for s in LABELLED if s in found_status)
        out[place] = Label(wrench, amplitude, error, status, len(states))
    return out


def assemble(rows: Sequence[Row], setup: Setup) -> Assembled:
    """The data set from all cases. Raises ModelError without free air or without a case at another speed."""
    maker = _Maker(rows, setup)
    radius, rpm_of = setup.fan.radius_m, (setup.campaign.rpm, *setup.campaign.other_rpm)
    table, marks = [], []
    for rpm in sorted(rpm_of):
        for place in maker.places:
            wrench, mark = maker.row(place, rpm)
            table.append([place[0] * radius, place[1] * radius, rpm, *wrench])
            marks.append(mark)
    return Assembled(np.array(table), tuple(marks), maker.law, maker.correction)


_Part = tuple[Array, Array, Array, Label]


class _Maker:
    """Labels of both models, the law of rotor speed and the correction; makes one row after the other."""

    def __init__(self, rows: Sequence[Row], setup: Setup) -> None:
        c = setup.campaign
        speeds = (c.rpm, *c.other_rpm)
        self.rpm = c.rpm
        self.half = {rpm: labels(rows, rpm) for rpm in speeds}
        for rpm in speeds:
            if FREE not in self.half[rpm]:
                raise ModelError(f"the cases lack free air (h = inf, d = inf) at {rpm:g} rpm; run the campaign on")
        kind = full_kind(rows, c.rpm)
        self.variant = kind[2]
        self.full = {rpm: labels(rows, rpm, kind) for rpm in speeds}
        self.law = fit_law(self.half, c.rpm)
        self.correction = correction(self.full[c.rpm], self.half[c.rpm])
        self.mesh = spread(rows, setup).increment
        self.places = sorted(self.half[c.rpm] | self.full[c.rpm])
        # Full models among half ones would be steps: components enter the set where their difference can be learnt.
        self.mixed = self.correction.learnt
        # Free air of a variant is another fan's.
        half, full = (of[c.rpm][FREE].wrench if FREE in of[c.rpm] else np.zeros(6) for of in (self.half, self.full))
        self.base = half if self.variant else np.where(self.mixed, full, half)

    def free(self, rpm: float) -> Array:
        """Free air (6,): the base, its lift as a full model at that speed has it, else a half one; others rpm^2."""
        solved = self.mixed[2] and not self.variant and FREE in self.full[rpm]
        model = self.full if solved else self.half
        ratio = model[rpm][FREE].wrench[2] / model[self.rpm][FREE].wrench[2]
        out: Array = self.base * np.where(np.arange(6) == 2, ratio, (rpm / self.rpm) ** 2)
        return out

    def row(self, place: Place, rpm: float) -> tuple[Array, Mark]:
        """Wrench (6,) and mark of one row."""
        part = self._full(place, rpm) or self._half(place, rpm) or self._by_law(place, rpm)
        if part is None:
            raise ModelError(
                f"no case at h = {place[0]:g} R, d = {place[1]:g} R and {self.rpm:g} rpm; run the campaign on"
            )
        added, amplitude, error, label = part
        if math.isinf(place[1]):
            added = np.where(TILT, 0.0, added)
        square = (rpm / self.rpm) ** 2
        scatter, sigma = (np.hypot(self.mesh * square, e) for e in (label.error, error))
        even, odd = self._made_even(place, rpm), self._made_odd(place, rpm)
        return self.free(rpm) + added, Mark(even, odd, label.status, label.starts, amplitude, scatter, sigma)

    def _full(self, place: Place, rpm: float) -> _Part | None:
        """Increment, amplitude, error (6,) and label of a full model, where it counts.

        A full model that swings is not known better than a half model and what others add to it: both means are
        weighted by their errors.
        """
        if not self._solved(place, rpm):
            return None
        label = self.full[rpm][place]
        added = label.wrench - self.full[rpm][FREE].wrench
        other = self._half(place, rpm, alone=True) or self._by_law(place, rpm, alone=True)
        if place == FREE or other is None:
            return added, label.amplitude, label.error, label
        one, two = label.error**2 + TINY, other[2] ** 2 + TINY
        share = np.where(self.mixed, two / (one + two), 0.0)
        added, amplitude = (share * x + (1 - share) * y for x, y in ((added, other[0]), (label.amplitude, other[1])))
        error, scatter = (np.sqrt(share**2 * one + (1 - share) ** 2 * e) for e in (two, other[3].error ** 2))
        return added, amplitude, error, replace(label, error=scatter)

    def _half(self, place: Place, rpm: float, alone: bool = False) -> _Part | None:
        """The same of a half model at that speed, with what full models add; ``alone``: those at other places."""
        if place not in self.half[rpm]:
            return None
        label, square = self.half[rpm][place], (rpm / self.rpm) ** 2
        change = self.correction.left_out(place) if alone else self.correction.at(place)
        added = label.wrench - self.half[rpm][FREE].wrench + square * change
        return added, label.amplitude, np.hypot(label.error, square * self.correction.error_at(place)), label

    def _by_law(self, place: Place, rpm: float, alone: bool = False) -> _Part | None:
        """The same from the campaign's speed; None without a half model where that is asked ``alone``."""
        half = self._half(place, self.rpm, alone)
        base = half if alone else self._full(place, self.rpm) or half
        if base is None:
            return None
        added, amplitude, error, label = base
        square = (rpm / self.rpm) ** 2
        scale = square * (rpm / self.rpm) ** self.law.exponent
        moved = replace(label, error=label.error * scale)
        return added * scale, amplitude * scale, np.hypot(error * scale, self.law.left * square), moved

    def _solved(self, place: Place, rpm: float) -> bool:
        """Whether a full model gives the row; free air of a variant does not count."""
        here = self.full[rpm]
        return bool(self.mixed.any()) and place in here and FREE in here and not (place == FREE and bool(self.variant))

    def _solved_as(self) -> str:
        return f"solved_{self.variant}" if self.variant else "solved"

    def _made_even(self, place: Place, rpm: float) -> str:
        mixed = bool(self.mixed[~ODD].any())
        if mixed and self._solved(place, rpm):
            return self._solved_as()
        if place in self.half[rpm]:
            return "corrected" if mixed else "half"
        return "law"

    def _made_odd(self, place: Place, rpm: float) -> str:
        if not self.mixed[ODD].any():
            return "symmetry"
        if self._solved(place, rpm):
            return self._solved_as()
        return "law" if self._solved(place, self.rpm) else "filled"


def correction(full: Mapping[Place, Label], half: Mapping[Place, Label]) -> Correction:
    """What full models add to half ones, from the labels of both. Zeros by symmetry are exact."""

    def doubt(place: Place) -> Array:
        error = np.hypot(full[place].error, half[place].error)
        return np.where(TILT, 0.0, error) if math.isinf(place[1]) else error

    error = {p: doubt(p) for p in full if p in half}
    return learn({p: label.wrench for p, label in full.items()}, {p: label.wrench for p, label in half.items()}, error)


def fit_law(solved: dict[float, dict[Place, Label]], reference: float) -> Law:
    """Exponents of the increments by least squares over all positions solved at several speeds.

    One exponent a component: Fx, Fz, My measured, the others (zero in the half model) take 0.
    """
    free = (math.inf, math.inf)
    base = solved[reference]
    pairs: list[tuple[float, Array, Array]] = []
    places = set()
    free_log: list[tuple[float, float]] = []
    for rpm, here in solved.items():
        if rpm == reference:
            continue
        log = math.log(rpm / reference)
        free_log.append((log, math.log(here[free].wrench[2] / base[free].wrench[2]) - 2 * log))
        for place in here:
            if place != free and place in base:
                places.add(place)
                change = (here[place].wrench - here[free].wrench) * (reference / rpm) ** 2
                pairs.append((log, base[place].wrench - base[free].wrench, change))
    if not pairs:
        raise ModelError("the cases lack positions at other rotor speeds; run the campaign on")
    logs = np.array([p[0] for p in pairs])
    at_reference, elsewhere = np.array([p[1] for p in pairs]), np.array([p[2] for p in pairs])
    exponent, error, left = np.zeros(6), np.zeros(6), np.zeros(6)
    for k in np.flatnonzero(~ODD):
        x, y = at_reference[:, k], elsewhere[:, k]
        exponent[k] = _exponent(logs, x, y, np.ones(len(x)))
        drop = [_exponent(logs, x, y, (np.arange(len(x)) != i).astype(float)) for i in range(len(x))]
        error[k] = math.sqrt((len(x) - 1) * np.var(drop))
        left[k] = math.sqrt(np.mean((y - x * np.exp(exponent[k] * logs)) ** 2))
    slope = sum(a * b for a, b in free_log) / sum(a * a for a, _ in free_log)
    return Law(reference, exponent, error, left, len(places), slope)


def _exponent(logs: Array, x: Array, y: Array, weight: Array) -> float:
    """a that minimises the squares of y - x exp(a log), by Newton's rule from 0."""
    a = 0.0
    for _ in range(20):
        model = x * np.exp(a * logs)
        slope = model * logs
        bottom = float(weight @ slope**2)
        if bottom < 1e-12:
            return 0.0
        a = float(np.clip(a + (weight @ (slope * (y - model))) / bottom, -2.0, 2.0))
    return a


def write_data(path: Path, made: Assembled) -> None:
    """Write the data set in the format of docs/formats.md."""
    np.savetxt(path, made.table, fmt="%.6g", delimiter=",", header=",".join(COLUMNS), comments="")


def write_marks(path: Path, made: Assembled) -> None:
    """Write the marks, one line for each line of the data set, in the same order."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    names = [f"{a}_{u}" for a, u in zip(AXES, UNITS, strict=True)]
    out.writerow(
        [
            *("h_m", "d_m", "rpm", "even", "odd", "status", "starts"),
            *(f"amplitude_{n}" for n in names),
            *(f"scatter_{n}" for n in names),
            *(f"sigma_{n}" for n in names),
        ]
    )
    for row, mark in zip(made.table, made.marks, strict=True):
        numbers = [f"{v:.3g}" for v in (*mark.amplitude, *mark.scatter, *mark.sigma)]
        out.writerow([*(f"{v:.6g}" for v in row[:3]), mark.even, mark.odd, mark.status, mark.starts, *numbers])
    path.write_text(text.getvalue(), encoding="utf-8")


def solved_share(made: Assembled) -> NDArray[np.bool_]:
    """Which rows (n,) have Fx, Fz and My from the solver itself, at that speed."""
    return np.array([m.even != "law" for m in made.marks])


def ceilings(made: Assembled) -> tuple[Array, Array]:
    """R2 (6,) of increments that a perfect surrogate reaches: against these rows, and against full models.

    1 - mean of the squared error / variance of the increments over free air, both over the lift at that speed. The
    error is the rows' ``scatter``, and their ``sigma``. nan where increments or errors are not known.
    """
    rpm, wrench = made.table[:, 2], made.table[:, 3:]
    free = np.isinf(made.table[:, :2]).all(axis=1)
    at = {n: wrench[free & (rpm == n)][0] for n in np.unique(rpm)}
    base = np.array([at[n] for n in rpm])
    lift = base[~free, 2:3]
    variance = np.var((wrench - base)[~free] / lift, axis=0)
    errors = (np.array([getattr(m, name) for m in made.marks])[~free] / lift for name in ("scatter", "sigma"))
    known = variance > 1e-12
    one, two = (np.where(known, 1.0 - np.mean(e**2, axis=0) / np.where(known, variance, 1.0), np.nan) for e in errors)
    return one, two
