"""Levenberg-Marquardt for one small tanh net, which converges where Adam has not yet."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from models.common.frames import Array

# Most evaluations of one net, and the share of the cost below which a step ends it.
EVALUATIONS = 300
STANDSTILL = 1e-4


def train(
    x: Array, y: Array, gate: Array, hidden: int, rng: np.random.Generator, decay: float
) -> tuple[Array, Array, Array, float]:
    """Minimise mean((gate x net(x) - y)^2) + decay |theta|^2 from a random start.

    ``x`` (n, n_in), ``y`` and ``gate`` (n,). Returns w1 (n_in, hidden), b1 (hidden,), w2 (hidden,) and b2.
    """
    n, n_in = x.shape
    x1 = np.concatenate([x, np.ones((n, 1))], axis=1)
    split = (n_in + 1) * hidden
    inner_start = rng.uniform(-2.0, 2.0, split)
    outer_start = rng.uniform(-0.3, 0.3, hidden + 1)
    start = np.concatenate([inner_start, outer_start])
    shrink = np.sqrt(decay * n) * np.eye(start.size)

    def inner(theta: Array) -> Array:
        weights = theta[:split].reshape(n_in + 1, hidden)
        return np.tanh(x1 @ weights)

    def residuals(theta: Array) -> Array:
        net = inner(theta) @ theta[split:-1] + theta[-1]
        return np.concatenate([gate * net - y, shrink @ theta])

    def jacobian(theta: Array) -> Array:
        z = inner(theta)
        slope = (1.0 - z * z) * theta[split:-1] * gate[:, None]
        by_inner = x1[:, :, None] * slope[:, None, :]
        by_outer = z * gate[:, None]
        by_net = np.column_stack([by_inner.reshape(n, split), by_outer, gate])
        return np.concatenate([by_net, shrink])

    found = least_squares(
        residuals, start, jacobian, method="lm", ftol=STANDSTILL, max_nfev=EVALUATIONS
    )
    first, b1, w2, b2 = np.split(found.x, (split - hidden, split, found.x.size - 1))
    return first.reshape(n_in, hidden), b1, w2, float(b2[0])
