"""Stacked one-hidden-layer nets in torch: errors of whole populations, and the descent of whole ensembles in one go.

A net is its chromosome: W (n_in x n_hid), b (n_hid), v (n_hid), o, row after row: y = v . tanh(x W + b) + o. Torch is
needed to train the paper's four methods only; what flies is ``models.surrogate.net_ensemble``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from models.common.frames import Array

INPUTS = 3
# The paper gives no rates (a full batch each step): plain descent at one rate, Adam down to another on a cosine.
DESCENT_RATE = 0.05
LAST_ADAM_RATE = 1e-4


def genes(hidden: int) -> int:
    """Length of a chromosome (eq. 12): 46 for 3-9-1."""
    return INPUTS * hidden + hidden + hidden + 1


@dataclass(frozen=True)
class Batch:
    """The rows that each of N nets learns: x (N, n, 3); gate, y, weight (N, n), weights sum to 1."""

    x: Any
    gate: Any
    y: Any
    weight: Any

    @classmethod
    def of(cls, x: Array, gate: Array, y: Array, weight: Array) -> Batch:
        """From numpy, x (N or 1, n, 3); rows of weight 0 are not learnt. Single precision, far finer than the fits."""
        torch.set_num_threads(1)
        return cls(
            x=_single(np.broadcast_to(x, (*y.shape, INPUTS))),
            gate=_single(gate),
            y=_single(y),
            weight=_single(weight / weight.sum(axis=1, keepdims=True)),
        )


def _single(values: Array) -> Any:
    """A tensor in single precision."""
    return torch.from_numpy(np.array(values, dtype=np.float32))


def errors(theta: Any, batch: Batch, hidden: int) -> Any:
    """Weighted mean squared error (eq. 11) of nets theta (N, genes), shape (N,)."""
    w1, b1, w2, b2 = unpack(theta, hidden)
    inner = torch.matmul(batch.x, w1) + b1[:, None]
    outer = torch.matmul(torch.tanh(inner), w2[:, :, None])
    y = outer[..., 0] + b2[:, None]
    error = batch.gate * y - batch.y
    return (batch.weight * error**2).sum(dim=1)


def population_errors(population: Any, batch: Batch, hidden: int) -> Array:
    """Errors (N, pop) of the populations (N, pop, genes) of N nets: what ``genetic.evolve`` asks for.

    One net at a time, to stay in the processor's cache.
    """
    out = []
    nets = torch.as_tensor(population, dtype=torch.float32)
    with torch.no_grad():
        for i, theta in enumerate(nets):
            own = Batch(batch.x[i : i + 1], batch.gate[i], batch.y[i], batch.weight[i])
            error = errors(theta, own, hidden)
            out.append(error.numpy())
    return np.array(out)


def descend(
    start: Array,
    batch: Batch,
    hidden: int,
    epochs: int,
    *,
    adam_rate: float | None = None,
    tick: Callable[[int, int], None] = lambda *_: None,
) -> Array:
    """Train N nets from chromosomes ``start`` (N, genes), full batch.

    By Adam (eqs. 5-10) from ``adam_rate`` on, or without one by plain gradient descent.
    """
    theta = torch.tensor(start, dtype=torch.float32, requires_grad=True)
    if adam_rate is None:
        optimiser = torch.optim.SGD([theta], lr=DESCENT_RATE)
        last = DESCENT_RATE
    else:
        optimiser = torch.optim.Adam([theta], lr=adam_rate)
        last = LAST_ADAM_RATE
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, max(epochs, 1), eta_min=last)
    for epoch in range(1, epochs + 1):
        optimiser.zero_grad()
        total = errors(theta, batch, hidden).sum()
        total.backward()
        optimiser.step()
        schedule.step()
        if epoch % 50 == 0:
            tick(epoch, epochs)
    return np.asarray(theta.detach().double().numpy())


def unpack(theta: Any, hidden: int) -> tuple[Any, Any, Any, Any]:
    """Chromosomes (..., genes) as w1 (..., 3, hidden), b1 (..., hidden), w2 (..., hidden), b2 (...)."""
    cut = INPUTS * hidden
    w1 = theta[..., :cut].reshape((*theta.shape[:-1], INPUTS, hidden))
    b1 = theta[..., cut : cut + hidden]
    w2 = theta[..., cut + hidden : cut + 2 * hidden]
    return w1, b1, w2, theta[..., -1]
