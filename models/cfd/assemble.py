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

from models.cfd.case_run import Row
from models.cfd.config import Setup
from models.cfd.fidelity import FREE, Correction, learn
from models.cfd.grid import mesh_error
from models.cfd.labels import Label, full_kind, labels
from models.cfd.mean_error import ODD, TILT
from models.cfd.position import Place
from models.cfd.table import six
from models.dataset import COLUMNS
from models.errors import ModelError
from models.frames import Array

# Variance [N^2, N^2 m^2] far below that of any row.
TINY = 1e-12


@dataclass(frozen=True)
class Law:
    """Increments over free air grow as (rpm / reference rpm)^(2 + exponent), exponent (6,) by component.

    ``error`` (6,) is the standard deviation of an exponent over the positions; ``left`` (6,) the rms of what the law
    leaves at the solved positions, in N and N m at the reference speed; ``positions`` their number. ``free`` is the
    exponent of the free fan's lift.
    """

    exponent: Array
    error: Array
    left: Array
    positions: int
    free: float


@dataclass(frozen=True)
class Mark:
    """How a row was made; ``amplitude``, ``scatter`` and ``sigma`` (6,) in N and N m.

    ``scatter``: error of the flow's mean and of the mesh, which differs from row to row. ``sigma``: with it what half
    models with their correction miss, as far as the row rests on them, and what the law of rotor speed leaves.

    ``made``: Fx, Fz and My ``solved`` in a full model with swirl at that speed; ``corrected``: a half model and what
    full models add, at that place at the campaign's speed or else learnt at other places; ``half``: a half model alone;
    ``law``: from the campaign's speed by the law of rotor speed. Fy, Mx and Mz are those of full models, learnt where
    there is none, zero where that cannot be.
    """

    made: str
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


@dataclass(frozen=True)
class _Part:
    """What a place adds to free air at one speed, by one way; all but status and starts (6,), as in ``Mark``.

    ``error`` is sigma without the mesh.
    """

    added: Array
    amplitude: Array
    scatter: Array
    error: Array
    status: str
    starts: int

    @classmethod
    def of(cls, label: Label, added: Array, error: Array) -> _Part:
        """From one case's label."""
        return cls(added, label.amplitude, label.error, error, label.status, label.starts)

    def weighted(self, other: _Part, used: NDArray[np.bool_]) -> _Part:
        """This and another, by their errors; components not ``used`` (6,) are the other's."""
        one, two = self.error**2, other.error**2
        weight = np.where(used, np.where(one > 0.0, two / np.maximum(one + two, TINY), 1.0), 0.0)
        rest = 1.0 - weight
        return _Part(
            weight * self.added + rest * other.added,
            weight * self.amplitude + rest * other.amplitude,
            np.hypot(weight * self.scatter, rest * other.scatter),
            np.hypot(weight * self.error, rest * other.error),
            self.status,
            self.starts,
        )


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
        self.full = {rpm: labels(rows, rpm, kind) for rpm in speeds}
        self.law = fit_law(self.half, c.rpm)
        self.correction = correction(self.full[c.rpm], self.half[c.rpm])
        self.mesh = mesh_error(rows, setup)
        self.places = sorted(self.half[c.rpm] | self.full[c.rpm])
        # Full models among half ones would be steps, unless their difference is learnt or all places have one.
        self.mixed = self.correction.learnt | np.full(6, all(p in self.full[c.rpm] for p in self.places))
        half, full = (of[c.rpm][FREE].wrench if FREE in of[c.rpm] else np.zeros(6) for of in (self.half, self.full))
        self.base = np.where(self.mixed, full, half)

    def free(self, rpm: float) -> Array:
        """Free air (6,): the base, its lift as a full model at that speed has it, else a half one; others rpm^2."""
        solved = self.mixed[2] and FREE in self.full[rpm]
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
        # Without a wall zero is exact.
        free_of = TILT & math.isinf(place[1])
        added = np.where(free_of, 0.0, part.added)
        mesh = self.mesh * (rpm / self.rpm) ** 2
        scatter, sigma = (np.where(free_of, 0.0, np.hypot(mesh, e)) for e in (part.scatter, part.error))
        mark = Mark(self._made(place, rpm), part.status, part.starts, part.amplitude, scatter, sigma)
        return self.free(rpm) + added, mark

    def _full(self, place: Place, rpm: float) -> _Part | None:
        """By the full model at that place and speed, where it counts.

        Its mean is not known better than a half model and what others add to it where the flow swings: both are
        weighted by their errors.
        """
        if not self._solved(place, rpm):
            return None
        label = self.full[rpm][place]
        solved = _Part.of(label, label.wrench - self.full[rpm][FREE].wrench, label.error)
        other = self._half(place, rpm, alone=True) or self._by_law(place, rpm, alone=True)
        return solved if place == FREE or other is None else solved.weighted(other, self.mixed)

    def _half(self, place: Place, rpm: float, alone: bool = False) -> _Part | None:
        """By a half model at that speed, with what full models add; ``alone``: those at other places."""
        if place not in self.half[rpm]:
            return None
        label, square = self.half[rpm][place], (rpm / self.rpm) ** 2
        added = label.wrench - self.half[rpm][FREE].wrench
        whole = None if alone or rpm == self.rpm or place not in self.half[self.rpm] else self._full(place, self.rpm)
        if whole is not None:
            usual = self.half[self.rpm][place]
            change = whole.added - (usual.wrench - self.half[self.rpm][FREE].wrench)
            scatter, error = (np.hypot(label.error, square * e) for e in (whole.scatter, whole.error))
            return replace(whole, added=added + square * change, scatter=scatter, error=error, status=label.status)
        change = self.correction.left_out(place) if alone else self.correction.at(place)
        error = np.hypot(label.error, square * self.correction.error_at(place))
        return _Part.of(label, added + square * change, error)

    def _by_law(self, place: Place, rpm: float, alone: bool = False) -> _Part | None:
        """From the campaign's speed; None without a half model where that is asked ``alone``."""
        half = self._half(place, self.rpm, alone)
        base = half if alone else self._full(place, self.rpm) or half
        if base is None:
            return None
        square = (rpm / self.rpm) ** 2
        scale = square * (rpm / self.rpm) ** self.law.exponent
        return replace(
            base,
            added=base.added * scale,
            amplitude=base.amplitude * scale,
            scatter=base.scatter * scale,
            error=np.hypot(base.error * scale, self.law.left * square),
        )

    def _solved(self, place: Place, rpm: float) -> bool:
        """Whether a full model gives the row."""
        here = self.full[rpm]
        return bool(self.mixed.any()) and place in here and FREE in here

    def _made(self, place: Place, rpm: float) -> str:
        mixed = bool(self.mixed[~ODD].any())
        if mixed and self._solved(place, rpm):
            return "solved"
        if place in self.half[rpm]:
            return "corrected" if mixed else "half"
        return "law"


def correction(full: Mapping[Place, Label], half: Mapping[Place, Label]) -> Correction:
    """What full models add to half ones, from the labels of both."""
    error = {p: np.hypot(full[p].error, half[p].error) for p in full if p in half}
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
    return Law(exponent, error, left, len(places), slope)


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
    kinds = ("amplitude_", "scatter_", "sigma_")
    out.writerow(["h_m", "d_m", "rpm", "made", "status", "starts", *(n for kind in kinds for n in six(kind))])
    for row, mark in zip(made.table, made.marks, strict=True):
        numbers = [f"{v:.3g}" for v in (*mark.amplitude, *mark.scatter, *mark.sigma)]
        out.writerow([*(f"{v:.6g}" for v in row[:3]), mark.made, mark.status, mark.starts, *numbers])
    path.write_text(text.getvalue(), encoding="utf-8")
