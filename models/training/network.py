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

from models.frames import Array
from models.training.adam import Rule

INPUTS = 3
# With more than this share of the hidden units changed all are computed: quicker than picking them out.
MANY = 0.7


def genes(hidden: int) -> int:
    """Length of a chromosome (eq. 12): 46 for 3-9-1."""
    return INPUTS * hidden + hidden + hidden + 1


@dataclass(frozen=True)
class Batch:
    """The rows that each of N nets learns: x (N, 4, n), the last input 1; gate, y, weight (N, n), weights sum to 1.

    x is (1, 4, n) where all nets see the same inputs.
    """

    x: Any
    gate: Any
    y: Any
    weight: Any

    @classmethod
    def of(cls, x: Array, gate: Array, y: Array, weight: Array) -> Batch:
        """From numpy, x (N or 1, n, 3); rows of weight 0 are not learnt. Single precision, far finer than the fits."""
        torch.set_num_threads(1)
        x = np.concatenate([x, np.ones((*x.shape[:2], 1))], axis=2)
        parts = (x.transpose(0, 2, 1), gate, y, weight / weight.sum(axis=1, keepdims=True))
        return cls(*(torch.as_tensor(np.ascontiguousarray(p), dtype=torch.float32) for p in parts))


# torch's logistic is several times faster than its tanh here: tanh(a) = 2 s(2a) - 1 and tanh'(a) = 4 s (1 - s).


class PopulationError:
    """The evaluation that ``genetic.evolve`` asks for: weighted mean squared errors (N, pop) of (N, pop, genes).

    Exponentials are what it spends its time on, so the outputs of all hidden units are kept (N x pop x hidden x n
    single floats), and only units with a gene that differs from the last population's are computed. One net at a time,
    to stay in the processor's cache.
    """

    def __init__(self, batch: Batch, hidden: int) -> None:
        self.hidden = hidden
        self._x = batch.x.expand(len(batch.y), -1, -1)
        root = batch.weight.sqrt()
        self._pull, self._target = root * batch.gate, -root * batch.y
        self._units = np.empty((0, 0, 0), dtype=np.float32)
        self._outputs = torch.empty(0)

    def __call__(self, population: Any) -> Array:
        """Errors (N, pop)."""
        theta = np.asarray(population, dtype=np.float32)
        nets, pop, _ = theta.shape
        hidden, rows = self.hidden, self._x.shape[2]
        cut = (INPUTS + 1) * hidden
        units = np.ascontiguousarray(theta[..., :cut].reshape(nets, pop, INPUTS + 1, hidden).swapaxes(2, 3))
        units = 2.0 * units.reshape(nets, pop * hidden, INPUTS + 1)
        if self._units.shape != units.shape:
            self._units = np.full_like(units, np.nan)
            self._outputs = torch.empty((nets, pop * hidden, rows))
        changed = (units != self._units).any(axis=2)
        self._units = units
        first, second, offset = torch.as_tensor(units), theta[..., cut:-1], theta[..., -1]
        v = torch.as_tensor(2.0 * second)[:, :, None, :]
        o = torch.as_tensor(offset - second.sum(axis=-1))[:, :, None, None]
        y = torch.empty((pop, 1, rows))
        out = np.empty((nets, pop))
        for i in range(nets):
            z, new = self._outputs[i], np.flatnonzero(changed[i])
            if len(new) > MANY * pop * hidden:
                torch.mm(first[i], self._x[i], out=z).sigmoid_()
            else:
                z.numpy()[new] = torch.mm(torch.as_tensor(units[i, new]), self._x[i]).sigmoid_().numpy()
            torch.baddbmm(o[i], v[i], z.view(pop, hidden, rows), out=y)
            error = torch.addcmul(self._target[i], y[:, 0], self._pull[i]).numpy()
            np.einsum("pn,pn->p", error, error, out=out[i])
        return out


def gradient(theta: Any, batch: Batch, hidden: int) -> tuple[Any, Any]:
    """Gradient (N, genes) of each net's weighted mean squared error (eq. 11) and that error (N,), theta (N, genes)."""
    nets, _ = theta.shape
    cut = (INPUTS + 1) * hidden
    w, v, o = theta[:, :cut].view(nets, INPUTS + 1, hidden), theta[:, cut:-1], theta[:, -1:]
    if len(batch.x) == 1:
        s = torch.mm((2.0 * w).transpose(1, 2).reshape(nets * hidden, -1), batch.x[0]).view(nets, hidden, -1)
    else:
        s = torch.bmm(2.0 * w.transpose(1, 2), batch.x)
    s.sigmoid_()
    y = torch.baddbmm((o - v.sum(dim=1, keepdim=True))[:, :, None], 2.0 * v[:, None, :], s)[:, 0]
    error = y.mul_(batch.gate).sub_(batch.y)
    pull = 2.0 * batch.weight * error
    mse = error.mul_(pull).sum(dim=1).mul_(0.5)
    pull.mul_(batch.gate)
    total = pull.sum(dim=1, keepdim=True)
    by_v = torch.bmm(s, 2.0 * pull[:, :, None])[..., 0] - total
    slope = torch.addcmul(s, s, s, value=-1.0).mul_(pull[:, None, :])
    if len(batch.x) == 1:
        by_w = torch.mm(slope.view(nets * hidden, -1), batch.x[0].t()).view(nets, hidden, -1).transpose(1, 2)
    else:
        by_w = torch.bmm(batch.x, slope.transpose(1, 2))
    return torch.cat(((4.0 * v[:, None, :] * by_w).flatten(1), by_v, total), dim=1), mse


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
    cut = INPUTS * hidden
    w1: Array = theta[..., :cut].reshape((*theta.shape[:-1], INPUTS, hidden))
    return w1, theta[..., cut : cut + hidden], theta[..., cut + hidden : cut + 2 * hidden], theta[..., -1]
