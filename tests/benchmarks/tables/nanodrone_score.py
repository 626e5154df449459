"""The metric of the nano-drone benchmark: mean norm of the error at 1, 10 and 50 steps, and its sum over 1 to 50."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from models.common.frames import Array, rotation_from_quaternion
from replay.predict.rollout import POSITION, QUATERNION, RATES, VELOCITY
from tables.nanodrone_data import Run

STEPS = 50
TOLD = (1, 10, 50)
QUANTITIES = ("position", "velocity", "attitude", "rates")
COLUMNS = {"position": POSITION, "velocity": VELOCITY, "rates": RATES}
Predictor = Callable[[Array, Array], Array]
"""States (n, 13) and rotor speeds (n, steps, 4) [rpm] to the states that follow (n, steps, 13)."""
Score = dict[str, list[float]]
"""By quantity: the error after ``TOLD`` steps, and the sum over all steps."""


def starts(run: Run, stride: int = 1) -> Array:
    """Rows at which windows begin."""
    return np.arange(0, len(run.states) - STEPS, stride)


def inputs_of(run: Run, rows: Array) -> Array:
    """Rotor speeds (n, steps, 4) of windows that begin at ``rows`` (n,)."""
    return np.asarray(run.rpm[rows[:, None] + np.arange(STEPS)])


def score(runs: Sequence[Run], predict: Predictor, *, seam: bool) -> Score:
    """The score of a model.

    ``seam``: as published, where the truth runs on from one flight into the next. The last windows of a flight are
    then compared with the start of the next one. Without it they are left out.
    """
    predicted = [predict(run.states[starts(run)], inputs_of(run, starts(run))) for run in runs]
    if seam:
        truth = [np.concatenate([run.states[1 : 1 + len(starts(run))] for run in runs])]
        predicted = [np.concatenate(predicted)]
    else:
        truth = [run.states[1:] for run in runs]
    out = {}
    for quantity in QUANTITIES:
        by_step = []
        for step in range(STEPS):
            errors = []
            for path, true in zip(predicted, truth, strict=True):
                later = true[step:]
                count = min(len(later), len(path))
                errors.append(error(quantity, path[:count, step], later[:count]))
            by_step.append(float(np.concatenate(errors).mean()))
        out[quantity] = [*(by_step[h - 1] for h in TOLD), sum(by_step)]
    return out


def error(quantity: str, predicted: Array, true: Array) -> Array:
    """Norm of the error (...) of states (..., 13); of the attitude the angle [rad]."""
    if quantity != "attitude":
        columns = COLUMNS[quantity]
        return np.asarray(np.linalg.norm(predicted[..., columns] - true[..., columns], axis=-1))
    a = predicted[..., QUATERNION]
    b = true[..., QUATERNION]
    cosine = np.abs((a * b).sum(axis=-1))
    sine = np.linalg.norm(_difference(a, b), axis=-1)
    return np.asarray(2.0 * np.arctan2(sine, cosine))


def _difference(a: Array, b: Array) -> Array:
    """Vector part (..., 3) of the quaternion that turns a into b."""
    w = a[..., :1]
    v = a[..., 1:]
    x = b[..., :1]
    u = b[..., 1:]
    return np.asarray(w * u - x * v - np.cross(v, u))


def naive(states: Array, inputs: Array) -> Array:
    """Nothing changes, the place included."""
    return np.repeat(states[:, None], inputs.shape[1], axis=1)


def rotations(states: Array) -> Array:
    """(..., 3, 3) body to world of states (..., 13)."""
    return rotation_from_quaternion(states[..., QUATERNION])
