"""From cases to a data set: one label a position, the speed axis by a fitted law, every row marked with its making."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.cfd.campaign import Row
from models.cfd.config import Setup
from models.cfd.grid import spread
from models.cfd.position import Place, near
from models.cfd.table import UNITS
from models.dataset import COLUMNS
from models.errors import ModelError
from models.frames import AXES, Array

# By the mirror plane through axis and wall normal, without swirl.
ODD = np.array([False, True, False, True, False, True])
# Without a wall the fan stands on an axis of symmetry: no side force, no tilt.
TILT = np.array([True, True, False, True, True, False])
# Worst first.
LABELLED = ("cycling", "drifting", "marched", "steady")


@dataclass(frozen=True)
class Label:
    """What a position is labelled with, wrench and amplitude (6,) in N and N m.

    ``amplitude`` is what the label leaves out: half the difference of two states, or the swing of a flow that never
    stands still. ``status`` of the worst case that went in; ``starts`` their number.
    """

    wrench: Array
    amplitude: Array
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
    """How a row was made.

    ``even`` (Fx, Fz, My): ``solved`` or by ``law``; ``odd`` (Fy, Mx, Mz): ``solved`` or ``filled``.
    """

    even: str
    odd: str
    status: str
    starts: int
    amplitude: Array
    sigma: Array


@dataclass(frozen=True)
class Assembled:
    """Rows of the data set, ``table`` (n, 9) in the columns of docs/formats.md, and a mark for each."""

    table: Array
    marks: tuple[Mark, ...]
    law: Law


def labels(rows: Sequence[Row], rpm: float) -> dict[Place, Label]:
    """The half model's label of every position at one speed on the mesh of level 1; diverged cases give none."""
    out: dict[Place, Label] = {}
    found: dict[Place, list[Row]] = {}
    for row in rows:
        p = row.position
        if not p.swirl and p.level == 1.0 and p.rpm == rpm and row.result.status in LABELLED:
            found.setdefault(p.place, []).append(row)
    for place, states in found.items():
        wrenches = np.array([r.result.wrench for r in states])
        # A drift dies out over about a hundred iterations, twice the span it is taken over.
        swing = np.max([np.maximum(r.result.swing, 2 * np.array(r.result.drift)) for r in states], axis=0)
        amplitude = np.maximum(np.ptp(wrenches, axis=0) / 2, swing)
        wrench = np.where(ODD, 0.0, wrenches.mean(axis=0))
        if math.isinf(place[1]):
            # The mirrored state is a solution as well: the mean of the two is zero, half their difference the state.
            amplitude = np.where(TILT, np.maximum(np.abs(wrench), amplitude), amplitude)
            wrench = np.where(TILT, 0.0, wrench)
        found_status = {r.result.status for r in states}
        status = next(s for s in LABELLED if s in found_status)
        out[place] = Label(wrench, amplitude, status, len(states))
    return out


def assemble(rows: Sequence[Row], setup: Setup) -> Assembled:
    """The data set from all cases. Raises ModelError without free air or without a case at another speed."""
    c = setup.campaign
    speeds = (c.rpm, *c.other_rpm)
    solved = {rpm: labels(rows, rpm) for rpm in speeds}
    for rpm in speeds:
        if (math.inf, math.inf) not in solved[rpm]:
            raise ModelError(f"the cases lack free air (h = inf, d = inf) at {rpm:g} rpm; run the campaign on")
    law = fit_law(solved, c.rpm)
    odd = _Odd(rows, c.rpm)
    grid = spread(rows, setup).increment
    table, marks = [], []
    for rpm in sorted(speeds):
        ratio = rpm / c.rpm
        free = solved[rpm][math.inf, math.inf]
        for place in sorted(solved[c.rpm]):
            base = solved[c.rpm][place]
            here = solved[rpm].get(place)
            scale = ratio ** (2.0 + law.exponent)
            increment = (base.wrench - solved[c.rpm][math.inf, math.inf].wrench) * scale
            label = here or Label(free.wrench + increment, base.amplitude * scale, base.status, base.starts)
            sideways, odd_made = odd.at(place)
            wrench = np.where(ODD, sideways * ratio**2, label.wrench)
            by_law = np.zeros(6) if here else law.left * ratio**2
            sigma = np.sqrt((grid * ratio**2) ** 2 + label.amplitude**2 + by_law**2)
            sigma[ODD] = np.nan
            table.append([place[0] * setup.fan.radius_m, place[1] * setup.fan.radius_m, rpm, *wrench])
            even = "solved" if here else "law"
            odd_here = odd_made if rpm == c.rpm else "filled"
            marks.append(Mark(even, odd_here, label.status, label.starts, label.amplitude, sigma))
    return Assembled(np.array(table), tuple(marks), law)


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


class _Odd:
    """Fy, Mx, Mz from the cases with swirl: solved where there is one, else weighted by nearness to those there are."""

    def __init__(self, rows: Sequence[Row], rpm: float) -> None:
        full = [r for r in rows if r.position.swirl and r.position.rpm == rpm and r.result.status in LABELLED]
        self.known = {r.position.place: np.array(r.result.wrench) for r in full}

    def at(self, place: Place) -> tuple[Array, str]:
        """Wrench (6,) of which the odd components count, and how it was made."""
        made = "solved" if place in self.known else "filled"
        if not self.known:
            return np.zeros(6), made
        if made == "solved":
            wrench = self.known[place]
        else:
            where = np.array([near(k) for k in self.known])
            apart = np.linalg.norm(where - near(place), axis=1)
            weight = apart**-3.0
            wrench = weight @ np.array(list(self.known.values())) / weight.sum()
        if math.isinf(place[1]):
            wrench = np.where(TILT, 0.0, wrench)
        return wrench, made


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
            *(f"sigma_{n}" for n in names),
        ]
    )
    for row, mark in zip(made.table, made.marks, strict=True):
        numbers = [f"{v:.3g}" for v in (*mark.amplitude, *mark.sigma)]
        out.writerow([*(f"{v:.6g}" for v in row[:3]), mark.even, mark.odd, mark.status, mark.starts, *numbers])
    path.write_text(text.getvalue(), encoding="utf-8")


def solved_share(made: Assembled) -> NDArray[np.bool_]:
    """Which rows (n,) have Fx, Fz and My from the solver itself."""
    return np.array([m.even == "solved" for m in made.marks])
