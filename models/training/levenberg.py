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
    start = np.concatenate([rng.uniform(-2.0, 2.0, split), rng.uniform(-0.3, 0.3, hidden + 1)])
    shrink = np.sqrt(decay * n) * np.eye(start.size)

    def inner(theta: Array) -> Array:
        return np.tanh(x1 @ theta[:split].reshape(n_in + 1, hidden))

    def residuals(theta: Array) -> Array:
        net = inner(theta) @ theta[split:-1] + theta[-1]
        return np.concatenate([gate * net - y, shrink @ theta])

    def jacobian(theta: Array) -> Array:
        z = inner(theta)
        slope = (1.0 - z * z) * theta[split:-1] * gate[:, None]
        by_first = (x1[:, :, None] * slope[:, None, :]).reshape(n, split)
        by_second = z * gate[:, None]
        return np.concatenate([np.column_stack([by_first, by_second, gate]), shrink])

    theta = least_squares(
        residuals, start, jacobian, method="lm", ftol=STANDSTILL, max_nfev=EVALUATIONS
    ).x
    w1 = theta[: split - hidden].reshape(n_in, hidden)
    b1 = theta[split - hidden : split]
    return w1, b1, theta[split:-1], float(theta[-1])
