"""Levenberg-Marquardt for one small tanh net: damped Gauss-Newton, which converges where Adam has not yet."""

from __future__ import annotations

import numpy as np

from models.frames import Array

# Most steps of one net.
ITERATIONS = 150
# Over where this many steps take off less than half a per cent.
PATIENCE, STANDSTILL = 10, 0.995
# Keeps the normal equations regular; far below what smooths.
LEAST_DECAY = 1e-7
DAMPING = (1e-2, 3.0, 4.0)
"""Start, divisor after a step that helps, factor after one that does not (Marquardt 1963; any values near these do)."""
LEAST_DAMPING = 1e-9
TRIALS = 8
"""Dampings tried for one step: the last is 4^8 times the first, a step along the gradient."""


def train(
    x: Array, y: Array, gate: Array, hidden: int, rng: np.random.Generator, decay: float = LEAST_DECAY
) -> tuple[Array, Array, Array, float]:
    """Minimise mean((gate x net(x) - y)^2) + decay |theta|^2 from a random start.

    ``x`` (n, n_in), ``y`` and ``gate`` (n,). Returns w1 (n_in, hidden), b1 (hidden,), w2 (hidden,) and b2.
    """
    n, n_in = x.shape
    x1 = np.concatenate([x, np.ones((n, 1))], axis=1)
    split = (n_in + 1) * hidden
    theta = np.concatenate([rng.uniform(-2.0, 2.0, split), rng.uniform(-0.3, 0.3, hidden + 1)])

    def forward(t: Array) -> tuple[Array, Array, float]:
        z = np.tanh(x1 @ t[:split].reshape(n_in + 1, hidden))
        error = gate * (z @ t[split:-1] + t[-1]) - y
        return z, error, float(error @ error) / n + decay * float(t @ t)

    damping, relax, stiffen = DAMPING
    z, error, cost = forward(theta)
    jacobian = np.empty((n, theta.size))
    past = np.inf
    for iteration in range(ITERATIONS):
        if iteration % PATIENCE == 0:
            if cost > STANDSTILL * past:
                break
            past = cost
        slope = (1.0 - z * z) * theta[split:-1] * gate[:, None]
        for i in range(n_in + 1):
            np.multiply(x1[:, [i]], slope, out=jacobian[:, i * hidden : (i + 1) * hidden])
        np.multiply(z, gate[:, None], out=jacobian[:, split:-1])
        jacobian[:, -1] = gate
        normal = jacobian.T @ jacobian / n
        normal[np.diag_indices_from(normal)] += decay
        gradient = jacobian.T @ error / n + decay * theta
        before = cost
        for _ in range(TRIALS):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            trial = forward(theta - step)
            if trial[2] < cost:
                theta = theta - step
                z, error, cost = trial
                damping = max(damping / relax, LEAST_DAMPING)
                break
            damping *= stiffen
        if cost >= before:
            break
    return (
        theta[:split].reshape(n_in + 1, hidden)[:-1],
        theta[split - hidden : split],
        theta[split:-1],
        float(theta[-1]),
    )
