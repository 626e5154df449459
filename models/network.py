"""Stacked one-hidden-layer nets in torch: errors of whole populations and gradients of whole ensembles in one go.

A net is its chromosome: W (n_in x n_hid), b (n_hid), v (n_hid), o, row after row: y = v . tanh(x W + b) + o. Torch is
needed to train the paper's four methods only; what flies is ``models.ensemble``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from models.adam import Rule
from models.wrench import Array

INPUTS = 3


def genes(hidden: int) -> int:
    """Length of a chromosome (eq. 12): 46 for 3-9-1."""
    return INPUTS * hidden + hidden + hidden + 1


@dataclass(frozen=True)
class Batch:
    """The rows that each of N nets learns: x (N, 3, n), gate, y and weight (N, n); weights of a net sum to 1."""

    x: Any
    gate: Any
    y: Any
    weight: Any

    @classmethod
    def of(cls, x: Array, gate: Array, y: Array, weight: Array) -> Batch:
        """From numpy, x (N, n, 3); rows of weight 0 are not learnt. Single precision, far finer than the fits here."""
        torch.set_num_threads(1)
        parts = (x.transpose(0, 2, 1), gate, y, weight / weight.sum(axis=1, keepdims=True))
        return cls(*(torch.as_tensor(np.ascontiguousarray(p), dtype=torch.float32) for p in parts))


# torch's logistic is several times faster than its tanh here: tanh(a) = 2 s(2a) - 1 and tanh'(a) = 4 s (1 - s).


def population_error(batch: Batch, hidden: int) -> Callable[[Array], Array]:
    """The evaluation that ``genetic.evolve`` asks for: (N, pop, genes) -> weighted mean squared errors (N, pop).

    One net's population at a time, so that its hidden layer stays in the processor's cache.
    """
    nets, _, rows = batch.x.shape

    def evaluate(population: Array) -> Array:
        theta = torch.as_tensor(population, dtype=torch.float32)
        pop = theta.shape[1]
        w, b, v, o = _unpack(theta, hidden)
        w = (2.0 * w).transpose(2, 3).reshape(nets, pop * hidden, INPUTS)
        b = (2.0 * b).reshape(nets, pop * hidden, 1)
        o = (o - v.sum(dim=-1))[:, :, None, None]
        v = (2.0 * v)[:, :, None, :].contiguous()
        z = torch.empty((pop * hidden, rows))
        y = torch.empty((pop, 1, rows))
        out = torch.empty((nets, pop))
        for i in range(nets):
            torch.addmm(b[i], w[i], batch.x[i], out=z)
            z.sigmoid_()
            torch.baddbmm(o[i], v[i], z.view(pop, hidden, rows), out=y)
            error = y[:, 0].mul_(batch.gate[i]).sub_(batch.y[i])
            torch.mv(error.mul_(error), batch.weight[i], out=out[i])
        return np.asarray(out.double().numpy())

    return evaluate


def gradient(theta: Any, batch: Batch, hidden: int) -> tuple[Any, Any]:
    """Gradient (N, genes) of each net's weighted mean squared error (eq. 11) and that error (N,), theta (N, genes)."""
    w, b, v, o = _unpack(theta, hidden)
    s = torch.baddbmm(2.0 * b[:, :, None], 2.0 * w.transpose(1, 2), batch.x).sigmoid_()
    y = torch.baddbmm((o - v.sum(dim=1))[:, None, None], 2.0 * v[:, None, :], s)[:, 0]
    error = batch.gate * y - batch.y
    pull = 2.0 * batch.weight * batch.gate * error
    total = pull.sum(dim=1, keepdim=True)
    by_v = 2.0 * torch.bmm(s, pull[:, :, None])[..., 0] - total
    slope = torch.addcmul(s, s, s, value=-1.0).mul_(pull[:, None, :])
    by_b = 4.0 * v * slope.sum(dim=2)
    by_w = 4.0 * v[:, None, :] * torch.bmm(batch.x, slope.transpose(1, 2))
    return torch.cat((by_w.flatten(1), by_b, by_v, total), dim=1), (error * error * batch.weight).sum(dim=1)


def descend(
    start: Array,
    batch: Batch,
    hidden: int,
    rule: Rule,
    epochs: int,
    *,
    mask: Array | None = None,
    tick: Callable[[int, int], None] | None = None,
) -> Array:
    """Train N nets from chromosomes ``start`` (N, genes), full batch, by ``rule``; genes with ``mask`` 0 stay."""
    theta = torch.as_tensor(start, dtype=torch.float32).clone()
    keep = None if mask is None else torch.as_tensor(mask, dtype=torch.float32)
    for t in range(1, epochs + 1):
        g, _ = gradient(theta, batch, hidden)
        rule.step(theta, g if keep is None else g * keep, t, epochs)
        if tick and t % 50 == 0:
            tick(t, epochs)
    return np.asarray(theta.double().numpy())


def unpack(theta: Array, hidden: int) -> tuple[Array, Array, Array, Array]:
    """Chromosomes (..., genes) as w1 (..., 3, hidden), b1 (..., hidden), w2 (..., hidden), b2 (...)."""
    out: tuple[Array, Array, Array, Array] = _unpack(theta, hidden)
    return out


def _unpack(theta: Any, hidden: int) -> Any:
    cut = INPUTS * hidden
    lead = tuple(theta.shape[:-1])
    return (
        theta[..., :cut].reshape((*lead, INPUTS, hidden)),
        theta[..., cut : cut + hidden],
        theta[..., cut + hidden : cut + 2 * hidden],
        theta[..., -1],
    )
