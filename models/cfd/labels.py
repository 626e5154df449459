"""From the cases at one position to its label: mean wrench, swing, and how far the mean may be from the truth.

The swing of a flow is not all of its error. Near the ground the flow tips over to one side, even without a wall. Which
side is left to chance, and the flow turns slowly, if at all: the mean of one run is that of one direction, and no block
average of that run can tell. Two things can. Without a wall the mean over all directions is zero by symmetry, so what a
case shows there is its error. And where iterations that went round in circles were followed by a march in time, the two
means can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.cfd.case_run import Result, Row
from models.cfd.position import FREE, Place, Position, near
from models.common.frames import Array

# By the mirror plane through axis and wall normal, without swirl.
ODD = np.array([False, True, False, True, False, True])
# Without a wall the fan stands on an axis of symmetry: no side force, no tilt.
TILT = np.array([True, True, False, True, True, False])
# Width over heights, in the coordinate 1 / (0.5 + h): about that of the step from 1.75 to 2 R, where tipping ends.
WIDTH = 0.04
# Worst first.
LABELLED = ("cycling", "drifting", "averaged", "marched", "steady")

Kind = tuple[str, float]
"""Model and level of the mesh."""
HALF: Kind = ("half", 1.0)


@dataclass(frozen=True)
class Label:
    """What a position is labelled with; wrench, amplitude, scatter and sigma (6,) in N and N m.

    ``amplitude`` is what the label leaves out: half the difference of two states, or the swing of a flow that never
    stands still. ``scatter`` is the error of the flow's mean (see above), and in a row of the set of the mesh, which
    differ from row to row. ``sigma``: with it what half models with their correction miss, as far as the label rests on
    them, and what the law of rotor speed leaves. ``status`` of the worst case that went in; ``starts`` their number.

    ``made``, of a row of the set: Fx, Fz and My ``solved`` in a full model with swirl at that speed; ``corrected``: a
    half model and what full models add, at that place at the campaign's speed or else learnt at other places; ``half``:
    a half model alone; ``law``: from the campaign's speed by the law of rotor speed. Fy, Mx and Mz are those of full
    models, learnt where there is none, zero where that cannot be.
    """

    wrench: Array
    amplitude: Array
    scatter: Array
    sigma: Array
    status: str
    starts: int
    made: str = ""


def kind_of(position: Position) -> Kind:
    """Kind of a case."""
    return position.model, position.level


def full_kind(rows: Sequence[Row], rpm: float) -> Kind:
    """The kind of full model that was computed at most positions; the finer mesh where two are equal."""
    places: dict[Kind, set[Place]] = {}
    for row in rows:
        p = row.position
        if p.model == "full" and p.rpm == rpm and row.result.status in LABELLED:
            places.setdefault(kind_of(p), set()).add(p.place)
    return max(places, key=lambda kind: (len(places[kind]), kind[1]), default=("full", 1.0))


def labels(rows: Sequence[Row], rpm: float, kind: Kind = HALF) -> dict[Place, Label]:
    """The label of every position computed in one kind of case at one speed; diverged cases give none."""
    alike = []
    by_place: dict[Place, list[Row]] = {}
    for row in rows:
        p = row.position
        if kind_of(p) == kind and row.result.status in LABELLED:
            alike.append(row)
            if p.rpm == rpm:
                by_place.setdefault(p.place, []).append(row)
    error = MeanError(alike)
    return {place: _label(place, states, error) for place, states in by_place.items()}


def added(by_place: Mapping[Place, Label], place: Place) -> Label:
    """The label of what a place adds to free air, by one kind of case at one speed."""
    label = by_place[place]
    return replace(label, wrench=label.wrench - by_place[FREE].wrench)


def _label(place: Place, states: Sequence[Row], known: MeanError) -> Label:
    wrenches = np.array([row.result.wrench for row in states])
    apart = np.ptp(wrenches, axis=0) / 2
    amplitude = error = apart
    for row in states:
        amplitude = np.maximum(amplitude, _amplitude(row.result))
        error = np.maximum(error, known.of(row))
    zero = ODD & (states[0].position.model == "half")
    wrench = np.where(zero, 0.0, wrenches.mean(axis=0))
    if math.isinf(place[1]):
        # The mirrored state is a solution as well: the mean is zero, exactly, the state's size the amplitude.
        amplitude = np.where(TILT, np.maximum(np.abs(wrench), amplitude), amplitude)
        error = np.where(TILT, 0.0, error)
        wrench = np.where(TILT, 0.0, wrench)
    return Label(
        wrench=wrench,
        amplitude=amplitude,
        scatter=error,
        sigma=error,
        status=min([row.result.status for row in states], key=LABELLED.index),
        starts=len(states),
    )


class MeanError:
    """By how much the means of some cases of one kind missed others that are known better.

    ``found``: of means of iterations that went in circles (True) and of other means, height over R and size (6,) of
    what was missed beyond the error of the better mean, at 1 rpm, N and N m, going as rpm^2; nan where not known.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        self.found: dict[bool, list[tuple[float, Array]]] = {True: [], False: []}
        for row in rows:
            result = row.result
            forbidden = TILT & math.isinf(row.position.d)
            mean = np.array(result.wrench)
            iterated = np.array(result.iterated)
            self._add(row.position, _in_circles(result), np.where(forbidden, mean, np.nan))
            if np.isfinite(iterated).all() and np.isfinite(result.error).all():
                beyond = (iterated - mean) ** 2 - np.square(result.error)
                apart = np.sqrt(np.maximum(beyond, 0.0))
                self._add(row.position, True, np.where(forbidden, iterated, apart))

    def _add(self, position: Position, in_circles: bool, size: Array) -> None:
        """Side forces and tilts are taken together over the directions solved: both, of a half model one."""
        if position.swirl:
            for pair in ([0, 1], [3, 4]):
                size[pair] = np.sqrt(np.mean(size[pair] ** 2))
        else:
            size[ODD] = 0.0
        self.found[in_circles].append((position.h, size / position.rpm**2))

    def of(self, row: Row) -> Array:
        """Error (6,) of the mean of one case, N and N m: its own, or what such means missed at that height if more.

        Its own is that of block averages, else swing and drift.
        """
        result = row.result
        own = np.where(np.isnan(result.error), _amplitude(result), result.error)
        missed = self._near(row.position.h, self.found[_in_circles(result)])
        return np.maximum(own, row.position.rpm**2 * missed)

    def _near(self, h: float, found: Sequence[tuple[float, Array]]) -> Array:
        """Rms (6,) of what was missed near that height; zero where nothing is known."""
        here, _ = near((h, h))
        apart = np.array([near((height, h))[0] - here for height, _ in found])
        size = np.array([size for _, size in found]).reshape(-1, 6)
        known = np.isfinite(size)
        # The nearest counts, however far it is.
        further = apart**2 - (apart**2).min(initial=np.inf)
        weight = np.exp(-0.5 * further / WIDTH**2)[:, None] * known
        square = (weight * np.where(known, size, 0.0) ** 2).sum(axis=0)
        total = np.maximum(weight.sum(axis=0), np.finfo(float).tiny)
        return np.asarray(np.sqrt(square / total))


def _in_circles(result: Result) -> bool:
    """True where nothing but the mean over iterations that did not settle is known."""
    return result.status == "cycling" and result.steps == 0


def _amplitude(result: Result) -> Array:
    """Swing or drift (6,); a drift dies out over about a hundred iterations, twice the span it is taken over."""
    out: Array = np.maximum(result.swing, 2 * np.array(result.drift))
    return out
