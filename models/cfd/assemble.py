"""From cases to a data set: one label a position, the speed axis by a fitted law, every row marked with its making."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from models.cfd.case_run import Row
from models.cfd.config import Setup
from models.cfd.fidelity import TINY, Correction, learn
from models.cfd.labels import ODD, TILT, Label, added, full_kind, labels
from models.cfd.position import FREE, Place
from models.cfd.table import six
from models.common.errors import ModelError
from models.common.frames import Array, Mask
from models.dataset import COLUMNS


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
class Assembled:
    """Rows of the data set, ``table`` (n, 9) in the columns of docs/formats.md, and the label of each."""

    table: Array
    marks: tuple[Label, ...]
    law: Law
    correction: Correction


def assemble(rows: Sequence[Row], setup: Setup) -> Assembled:
    """The data set from all cases. Raises ModelError without free air or without a case at another speed."""
    maker = _Maker(rows, setup)
    radius = setup.fan.radius_m
    table = []
    marks = []
    for rpm in sorted(maker.speeds):
        for place in maker.places:
            label = maker.row(place, rpm)
            h, d = place
            table.append([h * radius, d * radius, rpm, *label.wrench])
            marks.append(label)
    return Assembled(np.array(table), tuple(marks), maker.law, maker.correction)


def _weighted(one: Label, other: Label, used: Mask) -> Label:
    """Two labels of one place, by their sigma; components not ``used`` (6,) are the other's."""
    mine = one.sigma**2
    others = other.sigma**2
    share = np.where(mine > 0.0, others / np.maximum(mine + others, TINY), 1.0)
    weight = np.where(used, share, 0.0)
    rest = 1.0 - weight
    return replace(
        one,
        wrench=weight * one.wrench + rest * other.wrench,
        amplitude=weight * one.amplitude + rest * other.amplitude,
        scatter=np.hypot(weight * one.scatter, rest * other.scatter),
        sigma=np.hypot(weight * one.sigma, rest * other.sigma),
    )


class _Maker:
    """Labels of both models, the law of rotor speed and the correction; makes one row after the other.

    ``_full``, ``_half`` and ``_by_law`` are the ways to what a place adds to free air: that is the wrench of their
    labels, and the mesh is not yet in their errors.
    """

    def __init__(self, rows: Sequence[Row], setup: Setup) -> None:
        self.rpm = setup.campaign.rpm
        self.speeds = (self.rpm, *setup.campaign.other_rpm)
        self.half = {rpm: labels(rows, rpm) for rpm in self.speeds}
        for rpm in self.speeds:
            if FREE not in self.half[rpm]:
                raise ModelError(
                    f"the cases lack free air (h = inf, d = inf) at {rpm:g} rpm; run the campaign "
                    "on"
                )
        kind = full_kind(rows, self.rpm)
        self.full = {rpm: labels(rows, rpm, kind) for rpm in self.speeds}
        self.law = fit_law(self.half, self.rpm)
        full = self.full[self.rpm]
        half = self.half[self.rpm]
        self.correction = learn(full, half)
        self.mesh = mesh_error(rows, setup)
        self.places = sorted(half | full)
        # Full models among half ones would be steps, unless their difference is learnt or all places have one.
        self.mixed = self.correction.learnt | np.full(6, full.keys() >= set(self.places))
        self.base = half[FREE].wrench
        if FREE in full:
            self.base = np.where(self.mixed, full[FREE].wrench, self.base)

    def row(self, place: Place, rpm: float) -> Label:
        """One row of the set."""
        part = self._full(place, rpm) or self._half(place, rpm) or self._by_law(place, rpm)
        if part is None:
            raise ModelError(
                f"no case at h = {place[0]:g} R, d = {place[1]:g} R and {self.rpm:g} rpm; run the "
                "campaign on"
            )
        # Without a wall zero is exact.
        free_of = TILT & math.isinf(place[1])
        mesh = self.mesh * (rpm / self.rpm) ** 2
        return replace(
            part,
            wrench=self._free(rpm) + np.where(free_of, 0.0, part.wrench),
            scatter=np.where(free_of, 0.0, np.hypot(mesh, part.scatter)),
            sigma=np.where(free_of, 0.0, np.hypot(mesh, part.sigma)),
            made=self._made(place, rpm),
        )

    def _made(self, place: Place, rpm: float) -> str:
        """How a row was made: see ``Label``."""
        mixed = bool(self.mixed[~ODD].any())
        if mixed and self._solved(place, rpm):
            return "solved"
        if place not in self.half[rpm]:
            return "law"
        return "corrected" if mixed else "half"

    def _free(self, rpm: float) -> Array:
        """Free air (6,): the base, its lift as a full model at that speed has it, else a half one; others rpm^2."""
        model = self.half
        if self.mixed[2] and FREE in self.full[rpm]:
            model = self.full
        growth = np.full(6, (rpm / self.rpm) ** 2)
        growth[2] = model[rpm][FREE].wrench[2] / model[self.rpm][FREE].wrench[2]
        return np.asarray(self.base * growth)

    def _solved(self, place: Place, rpm: float) -> bool:
        """Whether a full model gives the row."""
        return bool(self.mixed.any()) and place in self.full[rpm] and FREE in self.full[rpm]

    def _full(self, place: Place, rpm: float) -> Label | None:
        """By the full model at that place and speed, where it counts.

        Its mean is not known better than a half model and what others add to it where the flow swings: both are
        weighted by their errors.
        """
        if not self._solved(place, rpm):
            return None
        solved = added(self.full[rpm], place)
        other = self._half(place, rpm, alone=True) or self._by_law(place, rpm, alone=True)
        if place == FREE or other is None:
            return solved
        return _weighted(solved, other, self.mixed)

    def _half(self, place: Place, rpm: float, alone: bool = False) -> Label | None:
        """By a half model at that speed, with what full models add; ``alone``: those at other places."""
        if place not in self.half[rpm]:
            return None
        half = added(self.half[rpm], place)
        square = (rpm / self.rpm) ** 2
        whole = None
        if not alone and rpm != self.rpm and place in self.half[self.rpm]:
            whole = self._full(place, self.rpm)
        if whole is not None:
            change = whole.wrench - added(self.half[self.rpm], place).wrench
            return replace(
                whole,
                wrench=half.wrench + square * change,
                scatter=np.hypot(half.scatter, square * whole.scatter),
                sigma=np.hypot(half.sigma, square * whole.sigma),
                status=half.status,
            )
        correction = self.correction
        change = correction.left_out(place) if alone else correction.at(place)
        sigma = np.hypot(half.sigma, square * correction.error_at(place))
        return replace(half, wrench=half.wrench + square * change, sigma=sigma)

    def _by_law(self, place: Place, rpm: float, alone: bool = False) -> Label | None:
        """From the campaign's speed; None without a half model where that is asked ``alone``."""
        base = None if alone else self._full(place, self.rpm)
        base = base or self._half(place, self.rpm, alone)
        if base is None:
            return None
        square = (rpm / self.rpm) ** 2
        scale = square * (rpm / self.rpm) ** self.law.exponent
        return replace(
            base,
            wrench=base.wrench * scale,
            amplitude=base.amplitude * scale,
            scatter=base.scatter * scale,
            sigma=np.hypot(base.sigma * scale, self.law.left * square),
        )


def fit_law(solved: dict[float, dict[Place, Label]], reference: float) -> Law:
    """Exponents of the increments by least squares over all positions solved at several speeds.

    One exponent a component: Fx, Fz, My measured, the others (zero in the half model) take 0.
    """
    base = solved[reference]
    others = {rpm: here for rpm, here in solved.items() if rpm != reference}
    pairs = []
    for rpm, here in others.items():
        for place in here:
            if place != FREE and place in base:
                pairs.append((rpm, place))
    if not pairs:
        raise ModelError("the cases lack positions at other rotor speeds; run the campaign on")
    logs = np.zeros(len(pairs))
    at_reference = np.zeros((len(pairs), 6))
    elsewhere = np.zeros((len(pairs), 6))
    for i, (rpm, place) in enumerate(pairs):
        logs[i] = math.log(rpm / reference)
        at_reference[i] = added(base, place).wrench
        elsewhere[i] = added(others[rpm], place).wrench * (reference / rpm) ** 2
    exponent = np.zeros(6)
    error = np.zeros(6)
    left = np.zeros(6)
    for k in np.flatnonzero(~ODD):
        x = at_reference[:, k]
        y = elsewhere[:, k]
        exponent[k] = _exponent(logs, x, y)
        # The jackknife: the spread over fits that lack one place each.
        without = []
        for i in range(len(x)):
            rest = np.arange(len(x)) != i
            without.append(_exponent(logs[rest], x[rest], y[rest]))
        error[k] = math.sqrt((len(x) - 1) * np.var(without))
        missed = y - x * np.exp(exponent[k] * logs)
        left[k] = math.sqrt(np.mean(missed**2))
    positions = len({place for _, place in pairs})
    return Law(exponent, error, left, positions, free=_free_exponent(base, others, reference))


def _free_exponent(
    base: dict[Place, Label], others: dict[float, dict[Place, Label]], reference: float
) -> float:
    """Exponent of the free fan's lift, beyond 2, by least squares over the speeds."""
    logs = np.log([rpm / reference for rpm in others])
    ratio = [here[FREE].wrench[2] / base[FREE].wrench[2] for here in others.values()]
    beyond = np.log(ratio) - 2 * logs
    return float(logs @ beyond / (logs @ logs))


def _exponent(logs: Array, x: Array, y: Array) -> float:
    """a in -2 ... 2 that minimises the squares of y - x exp(a log)."""
    found = least_squares(
        lambda a: y - x * np.exp(a * logs), 0.0, "3-point", (-2.0, 2.0), ftol=None, xtol=1e-14
    )
    return float(found.x[0])


def mesh_error(rows: Sequence[Row], setup: Setup) -> Array:
    """Error (6,) [N, N m] by the mesh of what a place adds to free air, at the campaign's speed.

    Half of the spread of the increment over the meshes of half models, rms over the places computed on all of them;
    zero without any.
    """
    c = setup.campaign
    levels = {1.0, *c.grid_levels}
    found: dict[Place, dict[float, Array]] = {}
    for row in rows:
        p = row.position
        wrench = np.array(row.result.wrench)
        of_campaign = not p.swirl and p.rpm == c.rpm and p.approach == "near"
        on_grid = p.level in levels and p.place in c.grid_at
        if of_campaign and on_grid and math.isfinite(wrench[2]):
            found.setdefault(p.place, {})[p.level] = wrench
    free = found.pop(FREE, {})
    halves = []
    for by_level in found.values():
        if len(by_level) == len(free) == len(levels):
            increments = [by_level[level] - free[level] for level in levels]
            halves.append(np.ptp(increments, axis=0) / 2)
    if not halves:
        return np.zeros(6)
    return np.asarray(np.sqrt(np.mean(np.square(halves), axis=0)))


def write_data(path: Path, made: Assembled) -> None:
    """Write the data set in the format of docs/formats.md."""
    np.savetxt(path, made.table, fmt="%.6g", delimiter=",", header=",".join(COLUMNS), comments="")


def write_marks(path: Path, made: Assembled) -> None:
    """Write the marks, one line for each line of the data set, in the same order."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    kinds = ("amplitude_", "scatter_", "sigma_")
    numbers = chain.from_iterable(map(six, kinds))
    out.writerow(["h_m", "d_m", "rpm", "made", "status", "starts", *numbers])
    for row, mark in zip(made.table, made.marks, strict=True):
        place = [f"{value:.6g}" for value in row[:3]]
        errors = np.concatenate([mark.amplitude, mark.scatter, mark.sigma])
        texts = [f"{error:.3g}" for error in errors]
        out.writerow([*place, mark.made, mark.status, mark.starts, *texts])
    path.write_text(text.getvalue(), encoding="utf-8")
