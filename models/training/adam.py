"""Adam as the paper prints it (eqs. 5-10) and plain gradient descent, as rules that update parameters in place."""

from __future__ import annotations

import math
from typing import Any, Protocol

# The paper gives none of these (a full batch each step): step from ALPHA to ALPHA_END on a cosine.
ALPHA, ALPHA_END = 1e-2, 1e-4
# Kingma and Ba 2015, algorithm 1.
DECAY_1, DECAY_2, EPSILON = 0.9, 0.999, 1e-8
# Chosen: the paper prints none.
DESCENT_RATE = 0.05


class Rule(Protocol):
    """One optimiser: ``step`` changes ``theta`` in place along the gradient ``g``; t counts from 1."""

    def step(self, theta: Any, g: Any, t: int, last: int) -> None:
        """Do step ``t`` of ``last``."""
        ...


class Descent:
    """Back-propagation's own rule: theta <- theta - rate g."""

    def __init__(self, rate: float = DESCENT_RATE) -> None:
        self.rate = rate

    def step(self, theta: Any, g: Any, t: int, last: int) -> None:
        """Do step ``t`` of ``last``."""
        theta -= self.rate * g


class Adam:
    """s <- l1 s + (1 - l1) g; q <- l2 q + (1 - l2) g^2; theta <- theta - alpha s^ / (sqrt(q^) + eps).

    s^ = s / (1 - l1^t), q^ = q / (1 - l2^t): l^t is the t-th power, s = q = 0 before t = 1. Elementwise: nets stacked
    in one array train as if each were alone. Torch tensors and numpy arrays both do.
    """

    def __init__(
        self,
        alpha: float = ALPHA,
        alpha_end: float | None = ALPHA_END,
        decays: tuple[float, float] = (DECAY_1, DECAY_2),
        epsilon: float = EPSILON,
    ) -> None:
        self.alpha, self.alpha_end, self.decays, self.epsilon = alpha, alpha_end, decays, epsilon
        self._s: Any = 0.0
        self._q: Any = 0.0

    def step(self, theta: Any, g: Any, t: int, last: int) -> None:
        """Do step ``t`` of ``last``."""
        l1, l2 = self.decays
        self._s = l1 * self._s + (1 - l1) * g
        self._q = l2 * self._q + (1 - l2) * g * g
        alpha = self.alpha
        if self.alpha_end is not None:
            alpha = self.alpha_end + 0.5 * (alpha - self.alpha_end) * (1 + math.cos(math.pi * (t - 1) / max(last, 1)))
        theta -= (alpha / (1 - l1**t)) * self._s / ((self._q / (1 - l2**t)) ** 0.5 + self.epsilon)
