"""Speed and memory of the surrogates, each against a plain way of doing the same, in one run.

    python tests/benchmarks surrogates.surrogate_speed [--quick] [--json FILE]

1. GA-Adam-BP, six outputs x five restarts in one batch, against a loop over individuals (numpy) on the same rows,
   population, generations and epochs.
2. Six outputs with spread and trust at one point, against the same five-member nets in torch eager.
3. A grid of a million points. 4. Peak memory. Times are processor seconds of one thread: others may share the machine.
"""

from __future__ import annotations

import json
import resource
import statistics
import time
from collections.abc import Callable
from functools import partial

import command_line
import numpy as np
from numpy.typing import NDArray

import models
from models.corner_law import ClosedForm
from models.dataset import DataSet
from models.training import genetic
from models.training.problem import Problem, frame

Array = NDArray[np.float64]
HIDDEN = 9
RESTARTS = 5


def seconds(work: Callable[[], object]) -> float:
    """Processor seconds of ``work``."""
    start = time.process_time()
    work()
    return time.process_time() - start


RATE = 0.01
"""Of Adam."""


def paper_sized() -> Problem:
    """8 x 8 x 5 points in h, d and rpm: 320 rows, about what the paper's figures show."""
    fan = ClosedForm()
    axes = (
        np.linspace(0.75, 4, 8) * 0.165,
        np.linspace(0.2, 3.8, 8) * 0.165,
        np.linspace(3000, 5000, 5),
    )
    h, d, rpm = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
    h, d, rpm = (np.append(a, [v] * 2) for a, v in ((h, np.inf), (d, np.inf), (rpm, 4000.0)))
    rpm[-1] = 4500.0
    return frame(DataSet(h=h, d=d, rpm=rpm, wrench=fan.wrench(h, d, rpm), source="grid", sha256=""))


def batched(problem: Problem, settings: genetic.Settings, epochs: int) -> Array:
    """What ``models train --method ga-adam-bp`` does, all 30 nets at once."""
    from models.training import network

    nets = 6 * RESTARTS
    y = np.tile((problem.y / problem.scale).T, (RESTARTS, 1))
    gate = np.tile(problem.gate.T, (RESTARTS, 1))
    batch = network.Batch.of(problem.x[None], gate, y, np.ones_like(y))
    rng = np.random.default_rng(0)
    evaluate = partial(network.population_errors, batch=batch, hidden=HIDDEN)
    start, _ = genetic.evolve(evaluate, nets, network.genes(HIDDEN), rng, settings)
    return network.descend(start, batch, HIDDEN, epochs, adam_rate=RATE)


def looped(problem: Problem, settings: genetic.Settings, epochs: int) -> Array:
    """The same work, one individual at a time."""
    rng = np.random.default_rng(0)
    out = []
    for c in [*range(6)] * RESTARTS:
        x = problem.x
        gate = problem.gate[:, c]
        y = problem.y[:, c] / problem.scale[c]
        best = _evolve_plainly(x, gate, y, settings, rng)
        mean = np.zeros_like(best)
        square = np.zeros_like(best)
        for t in range(1, epochs + 1):
            g = _gradient(best, x, gate, y)
            mean, square = 0.9 * mean + 0.1 * g, 0.999 * square + 0.001 * g * g
            best -= RATE / (1 - 0.9**t) * mean / (np.sqrt(square / (1 - 0.999**t)) + 1e-8)
        out.append(best)
    return np.array(out)


def _error(theta: Array, x: Array, gate: Array, y: Array) -> float:
    z = np.tanh(x @ theta[:27].reshape(3, 9) + theta[27:36])
    return float(np.mean((gate * (z @ theta[36:45] + theta[45]) - y) ** 2))


def _gradient(theta: Array, x: Array, gate: Array, y: Array) -> Array:
    z = np.tanh(x @ theta[:27].reshape(3, 9) + theta[27:36])
    pull = 2.0 * gate * (gate * (z @ theta[36:45] + theta[45]) - y) / len(y)
    slope = np.outer(pull, theta[36:45]) * (1.0 - z * z)
    return np.concatenate([(x.T @ slope).ravel(), slope.sum(0), z.T @ pull, [pull.sum()]])


def _evolve_plainly(
    x: Array, gate: Array, y: Array, s: genetic.Settings, rng: np.random.Generator
) -> Array:
    population = [rng.uniform(-1, 1, 46) for _ in range(s.population)]
    errors = [_error(t, x, gate, y) for t in population]
    best = population[int(np.argmin(errors))]
    best_error = min(errors)
    for generation in range(s.generations):
        f = 1.0 / (np.array(errors) + 1e-12)
        children = [
            population[i].copy() for i in rng.choice(s.population, s.population, p=f / f.sum())
        ]
        for k in range(0, s.population - 1, 2):
            if rng.random() < s.crossover_share:
                a = rng.random(46)
                one = children[k]
                two = children[k + 1]
                children[k] = one * (1 - a) + two * a
                children[k + 1] = two * (1 - a) + one * a
        f = 1.0 / (np.array([_error(t, x, gate, y) for t in children]) + 1e-12)
        for k, child in enumerate(children):
            spread = f.max() - f.mean()
            chance = s.m1 * (f.max() - f[k]) / spread if f[k] >= f.mean() and spread > 0 else s.m2
            hit = rng.random(46) < 0.2 * max(s.least_mutation, chance)
            step = s.step * (1 - generation / s.generations) ** 2 * rng.normal(size=46)
            children[k] = np.where(hit, np.clip(child + step, -s.bound, s.bound), child)
        children[0] = best
        population = children
        errors = [_error(t, x, gate, y) for t in children]
        if min(errors) < best_error:
            best = population[int(np.argmin(errors))].copy()
            best_error = min(errors)
    return best.copy()


def one_point(repeats: int) -> dict[str, float]:
    """Median microseconds of one query, its net part, and torch eager on the same nets (a stacked module, no loop)."""
    import torch

    torch.set_num_threads(1)
    model = models.load()
    nets = model.regressor
    one = np.array([[0.1, 0.2, 0.3]])
    w1, b1, w2, b2 = (
        torch.as_tensor(a.reshape(-1, *a.shape[2:])) for a in (nets.w1, nets.b1, nets.w2, nets.b2)
    )

    def stacked() -> tuple[object, object]:
        with torch.no_grad():
            x = torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64)
            y = ((torch.tanh(x @ w1 + b1) * w2).sum(-1) + b2).reshape(5, 6)
            return y.mean(0), y.std(0)

    member = [
        torch.nn.Sequential(
            torch.nn.Linear(3, HIDDEN), torch.nn.Tanh(), torch.nn.Linear(HIDDEN, 1)
        ).double()
        for _ in range(30)
    ]

    def modules() -> tuple[object, object]:
        with torch.no_grad():
            x = torch.tensor([0.1, 0.2, 0.3], dtype=torch.float64)
            y = torch.stack([net(x) for net in member]).reshape(5, 6)
            return y.mean(0), y.std(0)

    def median(work: Callable[[], object], count: int) -> float:
        work()
        return statistics.median(
            seconds(lambda: [work() for _ in range(count)]) / count * 1e6 for _ in range(9)
        )

    return {
        "query_us": median(lambda: model.query(0.2, 0.1, 4000.0), repeats),
        "nets_us": median(lambda: nets.predict(one), repeats),
        "torch_stacked_us": median(stacked, repeats // 4),
        "torch_modules_us": median(modules, repeats // 20),
    }


def main() -> None:
    """Run all and print one table."""
    parser = command_line.parser(__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="a tenth of the generations and epochs"
    )
    parser.add_argument("--json")
    args = parser.parse_args()
    share = 10 if args.quick else 1
    settings = genetic.Settings(generations=100 // share)
    epochs = 1000 // share
    memory = {"start_mib": _peak_mib()}
    model = models.load()
    h, d = np.meshgrid(np.linspace(0.05, 0.8, 1000), np.linspace(0.02, 0.7, 1000))
    grid = seconds(lambda: model.query(h, d, 4000.0))
    memory["grid_mib"] = _peak_mib()
    problem = paper_sized()
    batched(problem, genetic.Settings(generations=1), 5)
    fast, slow = (seconds(lambda w=w: w(problem, settings, epochs)) for w in (batched, looped))
    memory["training_mib"] = _peak_mib()
    point = one_point(2000)
    result = {
        "ga_adam": {
            "rows": len(problem),
            "batched_s": fast,
            "looped_s": slow,
            "ratio": slow / fast,
            "goal": 20,
        },
        "one_point": {
            **point,
            "goal_us": 10,
            "ratio_to_torch": point["torch_stacked_us"] / point["query_us"],
        },
        "million_points_s": grid,
        "peak_memory": memory,
    }
    print(
        f"GA-Adam-BP, 6 outputs x 5 restarts, {len(problem)} rows, {settings.generations} generations, {epochs} epochs"
    )
    print(
        f"  batched {fast:8.2f} s   loop over individuals {slow:8.2f} s   ratio {slow / fast:5.1f} (goal 20)"
    )
    print("six outputs with spread at one point (goal 10 us)")
    print(f"  nets {point['nets_us']:.1f} us   whole query with trust {point['query_us']:.1f} us")
    print(
        f"  torch eager, stacked {point['torch_stacked_us']:.1f} us   30 modules {point['torch_modules_us']:.1f} us"
    )
    print(f"a million points: {grid:.2f} s")
    print(
        "peak memory [MiB]: "
        + ", ".join(f"{k.removesuffix('_mib')} {v:.0f}" for k, v in memory.items())
    )
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            json.dump(result, file, indent=1)


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
