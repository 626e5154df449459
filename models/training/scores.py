"""How good a surrogate is: R^2, errors and coverage per component."""

from __future__ import annotations

from typing import Any

import numpy as np

from models.common.frames import AXES, Array, Mask
from models.dataset import DataSet
from models.surrogate.fan_surrogate import FanSurrogate
from models.training.problem import increments


def measure(model: FanSurrogate, data: DataSet, live: Mask) -> dict[str, Any]:
    """R^2 and MSE per component, of the wrench (N, N m) and of its increments (1, m), and share within 1.96 sigma."""
    answer = model.query(data.h, data.d, data.rpm)
    law = model.free_air_law
    varies = live | (np.ptp(answer.wrench, axis=0) > 1e-9)
    truth = increments(data.wrench, data.rpm, law)
    answered = increments(answer.wrench, data.rpm, law)
    error = np.abs(answer.wrench - data.wrench)
    inside = error <= 1.96 * answer.sigma + 1e-12
    coverage = np.round(inside.mean(axis=0), 4).tolist()
    return {
        "wrench": scores(data.wrench, answer.wrench, varies),
        "increments": scores(truth, answered, live),
        "coverage_95": dict(zip(AXES, coverage, strict=True)),
    }


def scores(truth: Array, answer: Array, live: Mask) -> dict[str, dict[str, float | None]]:
    """``{"Fx": {"r2", "mse"}, ...}`` of (n, 6) against (n, 6); r2 None where undefined or the component is not live."""
    r2 = np.where(live, r_squared(truth, answer), np.nan)
    mse = np.mean((truth - answer) ** 2, axis=0)
    out = {}
    for c, axis in enumerate(AXES):
        out[axis] = {"r2": defined(r2[c]), "mse": float(mse[c])}
    return out


def defined(value: float) -> float | None:
    """NaN as None, which is null in JSON."""
    return None if np.isnan(value) else float(value)


def r_squared(truth: Array, answer: Array) -> Array:
    """R^2 (eq. 17) over the first axis, (n, ...) -> (...), the mean being that of the evaluated set.

    NaN for a constant column: it has no variance to explain.
    """
    error = ((truth - answer) ** 2).sum(axis=0)
    variance = ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    largest = np.maximum(np.abs(truth).max(axis=0), 1e-9)
    constant = variance <= 1e-18 * len(truth) * largest**2
    variance = np.where(constant, np.nan, variance)
    return np.asarray(1.0 - error / variance)
