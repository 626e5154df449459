"""What is tried: every effect of the catalogue in every shape, as regressors of one record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.effects import Context, Effect
from models.frames import AXES, Array
from replay.residual.record import Record

Columns = NDArray[np.int64]


AT_SHAPE = (0.8, 1.25)
"""Ratio of a length to the length at which it was linearised."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect in one shape, and where its columns stand in the library."""

    effect: Effect
    shape: tuple[float, ...]
    columns: Columns
    held: tuple[int, ...] = ()
    """Coefficients that are held at zero."""


class Library:
    """Every candidate's regressors in one array (n, axes, K)."""

    def __init__(self, record: Record, effects: Sequence[Effect]) -> None:
        self.candidates: list[Candidate] = []
        self.lacking: dict[str, str] = {}
        self.record = record
        self.x: Array = np.zeros((len(record.time_s), len(record.axes), 0))
        self.scale: Array = np.zeros(0)
        todo: list[tuple[Effect, tuple[float, ...]]] = []
        for effect in effects:
            reason = effect.lacking(record.context)
            if effect.needs_moments and 3 not in record.axes:
                reason = "this log cannot judge moments"
            forces = {AXES.index(a) for a in effect.axes} & {0, 1, 2}
            if forces and not forces & set(record.axes):
                reason = "this log cannot judge the force that it makes"
            if effect.name == "motor_lag" and record.only_answers:
                reason = "the thrust varied hardly more than it answers disturbances; " + effect.excite
            if reason is not None:
                self.lacking[effect.name] = reason
                continue
            todo += [(effect, shape) for shape in effect.shape_grid(record.context)]
        self.add(todo)
        # The vertical part of an accelerometer offset looks like a scale of the thrust: it may be held at zero.
        self.candidates += [self.without(c, 2) for c in self.candidates if c.effect.name == "imu_bias"]

    def add(self, todo: Sequence[tuple[Effect, tuple[float, ...]]]) -> None:
        """Candidates behind those there are."""
        count = len(self.scale)
        parts: list[Array] = []
        for effect, shape in todo:
            x = _evaluate(effect, self.record.context, shape)[:, list(self.record.axes)]
            parts.append(np.nan_to_num(x, posinf=0.0, neginf=0.0))
            width = x.shape[2]
            self.candidates.append(Candidate(effect, shape, np.arange(count, count + width)))
            count += width
        if not parts:
            return
        x = np.concatenate(parts, axis=2)
        # One scale a column, so that Gram matrices are well conditioned; coefficients are scaled back at the end.
        # Axes differ in unit, so the scale is only a size.
        scale = np.sqrt(np.mean(x[self.record.valid] ** 2, axis=(0, 1)))
        scale[scale < 1e-12] = 1.0
        self.x = np.concatenate([self.x, x / scale], axis=2)
        self.scale = np.concatenate([self.scale, scale])

    def without(self, candidate: Candidate, coefficient: int) -> Candidate:
        """The candidate with one of its coefficients held at zero."""
        count = len(self.scale)
        keep = np.arange(len(candidate.columns)) != coefficient
        self.x = np.concatenate([self.x, self.x[:, :, candidate.columns] * keep], axis=2)
        self.scale = np.concatenate([self.scale, self.scale[candidate.columns]])
        held = (*candidate.held, coefficient)
        return replace(candidate, columns=np.arange(count, len(self.scale)), held=held)

    def finer(self, candidate: Candidate, steps: int = 5) -> list[tuple[Effect, tuple[float, ...]]]:
        """Shapes between that of a candidate and its neighbours on the grid, one parameter at a time."""
        out = []
        effect = candidate.effect
        for i, (shape, value) in enumerate(zip(effect.shapes, candidate.shape, strict=True)):
            if not shape.continuous or value in shape.kinds:
                continue
            grid = sorted({c.shape[i] for c in self.candidates if c.effect is effect} - set(shape.kinds))
            at = grid.index(value)
            for near in (grid[at - 1 : at] or [value]) + (grid[at + 1 : at + 2] or [value]):
                between = np.linspace(value, near, steps + 1)[1:-1] if near != value else ()
                out += [(effect, (*candidate.shape[:i], float(v), *candidate.shape[i + 1 :])) for v in between]
        return out


def _evaluate(effect: Effect, ctx: Context, shape: tuple[float, ...]) -> Array:
    with np.errstate(invalid="ignore", over="ignore"):
        return effect.regressors(ctx, shape)


def columns_of(chosen: Sequence[Candidate]) -> Columns:
    """The columns of several candidates, one after the other."""
    return np.concatenate([c.columns for c in chosen]) if chosen else np.empty(0, np.int64)


def place(chosen: Sequence[Candidate], wanted: Candidate) -> slice:
    """Where the coefficients of one of ``chosen`` stand in a joint fit."""
    start = 0
    for candidate in chosen:
        if candidate is wanted:
            break
        start += len(candidate.columns)
    return slice(start, start + len(wanted.columns))


def freedom(candidate: Candidate) -> int:
    """How many numbers are fitted in an effect."""
    shapes = sum(shape.continuous for shape in candidate.effect.shapes)
    return len(candidate.columns) - len(candidate.held) + shapes


def same_kind(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are of one effect and differ only in what may vary continuously."""
    if one.effect is not other.effect or one.held != other.held:
        return False
    return all(
        a == b or (s.continuous and a not in s.kinds and b not in s.kinds)
        for s, a, b in zip(one.effect.shapes, one.shape, other.shape, strict=True)
    )


def out_of_range(candidate: Candidate, coefficients: Array) -> str | None:
    """What is wrong with the size of these coefficients, or None."""
    for c, value in zip(candidate.effect.coefficients, coefficients, strict=True):
        if not c.low <= value <= c.high:
            return f"right shape, but {c.name} = {value:.3g} {c.unit} is outside {c.low:g} to {c.high:g}"
    if candidate.effect.at_shape and not AT_SHAPE[0] <= float(coefficients[0]) / candidate.shape[0] <= AT_SHAPE[1]:
        return f"no {candidate.effect.coefficients[0].name} fits it: the curve is another one"
    return None
