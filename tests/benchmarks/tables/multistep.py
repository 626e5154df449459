"""Parameters of a model by its motion ahead: the weighted mean of error norms over windows, made least.

Iteratively reweighted least squares (Holland & Welsch 1977, Communications in Statistics 6, 813): every error vector
counts by one over its norm, so that the sum of squares is the sum of norms. Steps are those of Gauss and Newton with
Levenberg's damping, derivatives are differences.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.common.frames import Array

Paths = Callable[[Array], Array]
"""Parameters (k,) to error vectors (m, 3), each already over its usual size."""
ROUNDS = 12
NUDGE = 1e-3
LEAST_NORM = 1e-3
"""Error norms below this share of the usual size do not count more."""
ENOUGH = 1e-4
"""Relative gain of a round below which nothing is left to gain."""


@dataclass(frozen=True)
class Parameter:
    """A number that is fitted: where it starts, its usual size, and its bounds."""

    name: str
    start: float
    size: float
    low: float = -np.inf
    high: float = np.inf


def fit(paths: Paths, parameters: list[Parameter]) -> dict[str, float]:
    """The parameters that make the mean error norm least."""
    size = np.array([p.size for p in parameters])
    low = np.array([p.low for p in parameters]) / size
    high = np.array([p.high for p in parameters]) / size
    x = np.array([p.start for p in parameters]) / size
    errors = paths(x * size)
    damping = 1e-3
    for number in range(1, ROUNDS + 1):
        print(f"round {number} of {ROUNDS}: {_mean_norm(errors):.4f}", file=sys.stderr)
        slopes = _slopes(paths, x, size, errors)
        weights = 1.0 / np.maximum(np.linalg.norm(errors, axis=1), LEAST_NORM)
        normal = np.einsum("mik,m,mil->kl", slopes, weights, slopes)
        downhill = np.einsum("mik,m,mi->k", slopes, weights, errors)
        before = _mean_norm(errors)
        while damping < 1e3:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -downhill)
            tried = np.clip(x + step, low, high)
            there = paths(tried * size)
            if _mean_norm(there) < before:
                x = tried
                errors = there
                damping *= 0.3
                break
            damping *= 10.0
        if before - _mean_norm(errors) < ENOUGH * before:
            break
    return {p.name: float(v) for p, v in zip(parameters, x * size, strict=True)}


def _slopes(paths: Paths, x: Array, size: Array, errors: Array) -> Array:
    """(m, 3, k) by forward differences."""
    out = np.empty((*errors.shape, len(x)))
    for k in range(len(x)):
        moved = x.copy()
        moved[k] += NUDGE
        out[..., k] = (paths(moved * size) - errors) / NUDGE
    return out


def _mean_norm(errors: Array) -> float:
    norms = np.linalg.norm(errors, axis=1)
    return float(np.mean(norms)) if np.isfinite(norms).all() else np.inf
