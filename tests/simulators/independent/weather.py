"""Wind at the vehicle: a steady mean and Dryden-like gusts (MIL-F-8785C, first-order forms), world NED."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from .airframes import Array

LENGTH_M = np.array([8.0, 8.0, 2.5])
"""Scale of gusts low over ground: along, across, vertical."""


def coloured(
    rng: np.random.Generator, shape: tuple[int, ...], tau_s: Array | float, dt: float
) -> Array:
    """First-order Markov noise of unit variance along axis 0, in equilibrium from the start."""
    keep = float(np.exp(-dt / tau_s))
    kicks = np.sqrt(1.0 - keep * keep) * rng.standard_normal(shape)
    kicks[0] = rng.standard_normal(shape[1:])
    return lfilter([1.0], [1.0, -keep], kicks, axis=0)


def wind(
    rng: np.random.Generator, steps: int, mean: tuple[float, float], intensity: float, dt: float
) -> Array:
    """(steps, 3) [m/s]; ``intensity``: standard deviation of the horizontal gusts over the mean speed."""
    speed = float(np.hypot(*mean))
    out = np.zeros((steps, 3))
    out[:, :2] = mean
    for axis, share in enumerate((1.0, 1.0, 0.4)):
        tau = LENGTH_M[axis] / max(speed, 0.3)
        out[:, axis] += share * intensity * max(speed, 0.1) * coloured(rng, (steps,), tau, dt)
    return out
