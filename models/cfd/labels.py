"""From the cases at one position to its label: mean wrench, swing, and how far the mean may be from the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.cfd import mean_error
from models.cfd.case_run import Row
from models.cfd.mean_error import ODD, TILT, MeanError
from models.cfd.position import Place, Position
from models.frames import Array

# Worst first.
LABELLED = ("cycling", "drifting", "averaged", "marched", "steady")

Kind = tuple[str, float]
"""Model and level of the mesh."""
HALF: Kind = ("half", 1.0)


@dataclass(frozen=True)
class Label:
    """What a position is labelled with, wrench and amplitude (6,) in N and N m.

    ``amplitude`` is what the label leaves out: half the difference of two states, or the swing of a flow that never
    stands still. ``error`` is that of the mean (see ``mean_error``). ``status`` of the worst case that went in;
    ``starts`` their number.
    """

    wrench: Array
    amplitude: Array
    error: Array
    status: str
    starts: int


def kind_of(position: Position) -> Kind:
    """Kind of a case."""
    return position.model, position.level


def full_kind(rows: Sequence[Row], rpm: float) -> Kind:
    """The kind of full model that was computed at most positions; the finer mesh where two are equal."""
    places: dict[Kind, set[Place]] = {}
    for row in rows:
        if row.position.model == "full" and row.position.rpm == rpm and row.result.status in LABELLED:
            places.setdefault(kind_of(row.position), set()).add(row.position.place)
    return max(places, key=lambda kind: (len(places[kind]), kind[1]), default=("full", 1.0))


def labels(rows: Sequence[Row], rpm: float, kind: Kind = HALF) -> dict[Place, Label]:
    """The label of every position computed in one kind of case at one speed; diverged cases give none."""
    alike = [row for row in rows if kind_of(row.position) == kind and row.result.status in LABELLED]
    error = mean_error.learn(alike)
    found: dict[Place, list[Row]] = {}
    for row in alike:
        if row.position.rpm == rpm:
            found.setdefault(row.position.place, []).append(row)
    return {place: _label(place, states, error) for place, states in found.items()}


def _label(place: Place, states: Sequence[Row], known: MeanError) -> Label:
    wrenches = np.array([r.result.wrench for r in states])
    apart = np.ptp(wrenches, axis=0) / 2
    amplitude = np.maximum(apart, np.max([mean_error.amplitude(r.result) for r in states], axis=0))
    error = np.maximum(apart, np.max([known.of(r) for r in states], axis=0))
    wrench = np.where(ODD & (states[0].position.model == "half"), 0.0, wrenches.mean(axis=0))
    if math.isinf(place[1]):
        # The mirrored state is a solution as well: the mean is zero, exactly, the state's size the amplitude.
        amplitude = np.where(TILT, np.maximum(np.abs(wrench), amplitude), amplitude)
        error, wrench = np.where(TILT, 0.0, error), np.where(TILT, 0.0, wrench)
    found = {r.result.status for r in states}
    return Label(wrench, amplitude, error, next(s for s in LABELLED if s in found), len(states))
