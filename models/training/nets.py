"""Ensembles of small nets, one for each component of the wrench: by Levenberg-Marquardt, or by the paper's methods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from models.common.frames import Array, Mask
from models.surrogate.net_ensemble import NetEnsemble
from models.training import genetic, levenberg, live_components
from models.training.problem import Index, Problem, drawn, folds

# Nets of an ensemble, each without another fifth of the places: the paper's 8:2 split, five times.
MEMBERS = live_components.FOLDS
# The paper's number.
HIDDEN = 9
# Chosen: the paper does not print it.
ADAM_RATE = 0.03
# Weight decays to choose from: one within the first factor of the least error on unseen places is as good, beyond the
# second weaker ones are not tried. The least keeps the normal equations regular, far below what smooths.
DECAYS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
NEARLY = 1.05
HOPELESS = 1.5
# Folds on which each decay is tried: enough to rank decays that lie a factor of ten apart.
TRIAL_FOLDS = 3
# Rows on which decays are tried at most; the genetic algorithm looks at fewer still.
TRIAL_ROWS = 600
GA_ROWS = 400

Progress = Callable[[str, int, int], None]
"""Called with what is done, how many parts of it, and of how many."""


def silent(*_: object) -> None:
    """No progress is shown."""


def choose_decays(
    problem: Problem, rng: np.random.Generator, progress: Progress = silent
) -> tuple[float, ...]:
    """Weight decay (6) of the nets of each component: the strongest that is nearly as good as any on unseen places.

    Few and noisy data want a strong one, or 46 weights make waves between them.
    """
    problem = problem.take(drawn(len(problem), TRIAL_ROWS, rng))
    fold = folds(problem, MEMBERS, rng)
    seed = int(rng.integers(2**31))
    out = [DECAYS[-1]] * 6
    for component in np.flatnonzero(problem.live).tolist():
        left = np.full(len(DECAYS), np.inf)
        for i, decay in enumerate(DECAYS):
            left[i] = _unexplained(problem, component, fold, decay, seed)
            tried = len(DECAYS) * component + i + 1
            progress("weight decay", tried, 6 * len(DECAYS))
            if left[i] > HOPELESS * left.min():
                break
        strongest = np.argmax(left <= NEARLY * left.min())
        out[component] = DECAYS[strongest]
    return tuple(out)


def _unexplained(problem: Problem, component: int, fold: Index, decay: float, seed: int) -> float:
    """Sum of squared errors of nets with this decay on the folds that they have not seen."""
    target, gate = _targets(problem, component)
    rng = np.random.default_rng(seed)
    left = 0.0
    for k in range(TRIAL_FOLDS):
        seen = fold != k
        x = problem.x[seen]
        net = levenberg.train(x, target[seen], gate[seen], HIDDEN, rng, decay)
        w1, b1, w2, b2 = net
        unseen = fold == k
        hidden = np.tanh(problem.x[unseen] @ w1 + b1)
        error = gate[unseen] * (hidden @ w2 + b2) - target[unseen]
        left += float(np.sum(error**2))
    return left


def _targets(problem: Problem, component: int) -> tuple[Array, Array]:
    """What the net of a component learns (n,), and its gate (n,): both times the root of the row's weight."""
    root = np.sqrt(problem.weight[:, component])
    target = root * problem.y[:, component] / problem.scale[component]
    return target, root * problem.gate[:, component]


def levenberg_nets(
    problem: Problem,
    fold: Index,
    rng: np.random.Generator,
    decays: Sequence[float],
    progress: Progress = silent,
) -> NetEnsemble:
    """Nets by Levenberg-Marquardt with weight decay (6); member k has not seen fold k."""
    w1 = np.zeros((MEMBERS, 6, 3, HIDDEN))
    b1 = np.zeros((MEMBERS, 6, HIDDEN))
    w2 = np.zeros((MEMBERS, 6, HIDDEN))
    b2 = np.zeros((MEMBERS, 6))
    for k in range(MEMBERS):
        seen = problem.take(np.flatnonzero(fold != k))
        for c in np.flatnonzero(problem.live).tolist():
            target, gate = _targets(seen, c)
            net = levenberg.train(seen.x, target, gate, HIDDEN, rng, decays[c])
            w1[k, c], b1[k, c], w2[k, c], b2[k, c] = net
            progress("nets", 6 * k + c + 1, 6 * MEMBERS)
    return NetEnsemble(w1, b1, w2 * problem.scale[:, None], b2 * problem.scale)


def paper_nets(
    problem: Problem,
    rows: Mask,
    method: str,
    rng: np.random.Generator,
    epochs: int,
    rate: float = ADAM_RATE,
    progress: Progress = silent,
) -> NetEnsemble:
    """Nets by one of the paper's methods, members and components in one batch; member k learns ``rows[k]`` (n,)."""
    from models.training import network

    members = len(rows)
    live = np.flatnonzero(problem.live)
    gate = np.tile(problem.gate.T[live], (members, 1))
    target = np.tile((problem.y / problem.scale).T[live], (members, 1))
    weight = np.repeat(rows.astype(float), len(live), axis=0)
    size = network.genes(HIDDEN)
    if method.startswith("ga-"):
        few = min(len(problem), GA_ROWS)
        seen = np.sort(rng.choice(len(problem), few, replace=False))
        small = network.Batch.of(
            x=problem.x[None, seen],
            gate=gate[:, seen],
            y=target[:, seen],
            weight=weight[:, seen],
        )
        evaluate = partial(network.population_errors, batch=small, hidden=HIDDEN)
        tick = partial(progress, "genetic algorithm")
        start, _ = genetic.evolve(evaluate, len(target), size, rng, tick=tick)
    else:
        start = rng.uniform(-1.0, 1.0, (len(target), size))
    batch = network.Batch.of(problem.x[None], gate, target, weight)
    adam_rate = rate if "adam" in method else None
    tick = partial(progress, "descent")
    nets = network.descend(start, batch, HIDDEN, epochs, adam_rate=adam_rate, tick=tick)
    theta = np.zeros((members, 6, size))
    theta[:, live] = nets.reshape(members, len(live), size)
    w1, b1, w2, b2 = network.unpack(theta, HIDDEN)
    return NetEnsemble(w1, b1, w2 * problem.scale[:, None], b2 * problem.scale)
